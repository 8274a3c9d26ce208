"""Report on a simulated study: tables, figures, key numbers, and the terminal's text."""

import dataclasses
from functools import partial
from typing import Any

import numpy as np

from experiments.data.simulated import CHANNELS, SimulatedStudy, axes, summary, touches, trajectory_summary
from experiments.document.document import Document, Plot
from experiments.document.replay import Replay, every_nth
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import number
from experiments.reports import study_figures, study_tables
from ident.mechanism.motion import Motion

RECORDING = "recording.npz"
"""File of the simulated recording."""

OUTPUTS = (*RESULTS, RECORDING)
"""Patterns of the files that it writes."""


def lines(study: SimulatedStudy) -> list[str]:
    """Sentences with the main numbers."""
    shown = [*_conditions(study), *_errors(study), *(_axes(study) if study.recovers else [])]
    if study.touching:
        numbers = touches(study)
        shown.append(
            f"All contacts touch in {100 * numbers['fraction_all_touch']:.0f} % of the samples, "
            f"none in {100 * numbers['fraction_none_touches']:.0f} %"
        )
    return shown


def _conditions(study: SimulatedStudy) -> list[str]:
    file, shown = study.file, []
    for name, model in file.models.items():
        estimate = study.fit(name).estimate
        published, shape = (file.published.get(what, {}).get(name) for what in ("condition_number", "shape"))
        printed = f" (paper: {published}{' at {} × {}'.format(*shape) if shape else ''})" if published else ""
        at = f"{estimate.rows} × {study.fit(name).base.rank}"
        line = f"Condition number, {model.title}: {estimate.condition_number:.4g} at {at}{printed}"
        if model.axes == "recovered" and model.parameters is None:
            tilt = axes(study)["tilt_recovered_deg"]
            line += f"; what tells these columns apart is the tilt alone, {tilt:.3g} deg as recovered"
        shown.append(line)
    return shown


def _errors(study: SimulatedStudy) -> list[str]:
    shown = []
    for name, model in study.file.models.items():
        errors = [
            f"{np.abs(study.fit(name, each).error).max():.3f} {each}"
            for each in model.estimators
            if each != "trajectory"
        ]
        if "trajectory" in model.estimators:
            largest = study.trajectory(name).largest_error
            errors.append("trajectory not determined" if largest is None else f"{number(largest)} trajectory")
        shown.append(f"Largest error, {model.title}: {', '.join(errors)}")
    return shown


def _axes(study: SimulatedStudy) -> list[str]:
    numbers, groups = axes(study), len(study.recovered.groups)
    decided = "all joints were given one direction" if groups == 1 else f"there are {groups} directions"
    return [
        f"Recovered axes: {numbers['axis_error_deg']:.3f} deg from the true ones, predicted standard deviation "
        f"{numbers['axis_std_deg']:.3f} deg",
        f"Recovered joint by joint they are {numbers['axis_difference_alone_deg']:.3f} deg apart (rank "
        f"{study.rank_apart}); a Wald test tells them from parallel with p = {numbers['axes_parallel_p_value']:.2f}, "
        f"so {decided}",
    ]


def replay(study: SimulatedStudy) -> Replay:
    """Replay of the simulated motion, with the total wrench: true, measured, and predicted by the models."""
    arm, recording = (
        dataclasses.replace(study.known, tree=study.problem.true),
        study.problem.with_cells(study.recording),
    )
    # Models that share others' parameters predict nearly the same as with their own.
    predicted = {model.title: name for name, model in study.file.models.items() if model.parameters is None}
    curves = {what: what for what in ("true", "measured")} | predicted
    drawn = every_nth(len(recording.time), len(curves) * len(CHANNELS))
    return Replay(
        mechanism=arm,
        recording=recording,
        motion=Motion(*recording.joint_states(arm.tree.joints)),
        channels=list(zip(CHANNELS, study_tables.UNITS, strict=True)),
        drawn=drawn,
        curves={label: study_figures.wrench(study, what)[drawn] for label, what in curves.items()},
        inks=study_figures.page_inks(study, curves.values()),
        remark="Torques are about the origin of the base frame; models are fitted to the wrenches that they know.",
    )


def document(study: SimulatedStudy, provenance: dict[str, Any]) -> Document:
    """All tables and figures that the file describes, the summary, a replay, and the recording with its load cells."""
    file = study.file
    models = [model.title for model in file.models.values()]
    about = (
        f"Simulated from the scene '{file.scene.identity['name']}' and identified anew, a model at a time: "
        f"{'; '.join(models)}."
    )
    return Document(
        file.title,
        about,
        lines=lines(study),
        tables={name: study_tables.table(study, name) for name in file.tables},
        figures={
            name: Plot(partial(study_figures.figure, study, name), e["caption"]) for name, e in file.figures.items()
        },
        numbers={
            "summary": summary(study) | {"trajectory": trajectory_summary(study)},
            "provenance": provenance,
        },
        replay=replay(study),
        recordings={RECORDING: study.problem.with_cells(study.recording)},
    )
