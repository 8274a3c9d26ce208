"""Report on a simulated study: tables, figures, key numbers, and the terminal's text."""

import dataclasses
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from experiments.data.simulated_study import CHANNELS, SimulatedStudy, axes, summary, touches, trajectory_summary
from experiments.document.document import Document, Plot
from experiments.document.replay import Replay, every_nth
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import number
from experiments.document.writer import sentences
from experiments.reports import study_figures, study_tables
from ident.mechanism.motion import Motion

RECORDING = "recording.npz"
"""File of the simulated recording."""

OUTPUTS = (*RESULTS, RECORDING)
"""Patterns of the files that it writes."""


def lines(study: SimulatedStudy) -> list[str]:
    """Sentences with the main numbers."""
    errors = {model.title: [*_errors(study, name)] for name, model in study.file.models.items()}
    return sentences("study.txt", study=study, errors=errors, axes=axes, touches=touches)


def _errors(study: SimulatedStudy, name: str) -> Iterator[str]:
    """Yields the largest error of each estimator of a model."""
    for each in study.file.models[name].estimators:
        if each != "trajectory":
            yield f"{np.abs(study.fit(name, each).error).max():.3f} {each}"
    if "trajectory" in study.file.models[name].estimators:
        largest = study.trajectory(name).largest_error
        yield "trajectory not determined" if largest is None else f"{number(largest)} trajectory"


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
