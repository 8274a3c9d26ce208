"""Report on a simulated study: tables, figures, key numbers, and the terminal's text."""

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from experiments.cli.print_options import layout_of
from experiments.data.simulated import Study
from experiments.data.study_file import StudyFile
from experiments.document import report
from experiments.document.page import Said
from experiments.document.replay import Replay, every_nth
from experiments.document.results import Results
from experiments.document.terminal import wrapped
from experiments.reports import study_figures, study_tables
from experiments.reports.study_tables import touches
from experiments.studies import monte_carlo
from experiments.studies.simulated import simulated
from ident.mechanism.axes import angle
from ident.mechanism.motion import Motion


def summary(study: Study) -> dict[str, Any]:
    """Key numbers for scripts; those of a model end with its name."""
    file, numbers = study.file, dict[str, Any]()
    for name in file.models:
        fit, suffix = study.fit(name), file.suffix(name)
        numbers |= {
            f"condition_number{suffix}": fit.estimate.condition_number,
            f"rank{suffix}": fit.base.rank,
            f"rows{suffix}": fit.estimate.rows,
            f"epsilon{suffix}": fit.estimate.epsilon,
            f"largest_error{suffix}": float(np.abs(fit.error).max()),
        }
    published = file.published.get("condition_number", {})
    numbers |= {f"paper_condition_number{file.suffix(name)}": number for name, number in published.items()}
    for name, entry in file.tables.items():
        if entry["kind"] == "wrench errors":
            errors = study_tables.table(study, name)
            rows = {str(channel): dict(zip(errors.columns[1:], row, strict=True)) for channel, *row in errors.rows}
            numbers["wrench_errors"] = rows
    numbers |= axes(study) if study.recovers else {}
    numbers |= touches(study) if study.touching else {}
    recording = study.recording
    return numbers | {
        "tracking_error_rad": recording.provenance["tracking_error_rad"],
        "noise": dict(recording.noise),
    }


def axes(study: Study) -> dict[str, float]:
    """Key numbers of the recovered axes."""
    recovered, tree = study.recovered, study.known.tree
    first = tree.moving[0]
    drawn = tree.poses(np.zeros(len(tree.moving)))[first, :3, :3] @ tree.bodies[first].twist[3:]
    alone = [axis.vector for axis in recovered.separate]
    return {
        "tilt_recovered_deg": float(np.degrees(angle(recovered.axes[0].vector, drawn))),
        "axis_error_deg": float(np.degrees(study.axis_error.max())),
        "axis_std_deg": float(np.degrees(max(axis.std for axis in recovered.axes))),
        "axis_difference_alone_deg": float(np.degrees(max([0.0, *(angle(alone[0], other) for other in alone[1:])]))),
        "rank_axes_apart": study.rank_apart,
        "axes_parallel_p_value": float(np.nanmin(recovered.p_values)) if len(alone) > 1 else 1.0,
    }


def trajectory_summary(study: Study) -> dict[str, float | None]:
    """Key numbers of the trajectory estimates, which take longer than all others."""
    numbers: dict[str, float | None] = {}
    for name, model in study.file.models.items():
        if "trajectory" in model.estimators:
            fitted, suffix = study.trajectory(name), study.file.suffix(name)
            numbers |= {f"largest_error{suffix}": fitted.largest_error, f"rms_z{suffix}": fitted.rms_z}
    return numbers


def text(study: Study) -> str:
    """Text for the terminal."""
    return wrapped("\n".join([*(study_tables.table(study, name).text() for name in study.file.tables), *lines(study)]))


def lines(study: Study) -> list[str]:
    """Sentences with the main numbers."""
    shown = [*_conditions(study), *_errors(study), *(_axes(study) if study.recovers else [])]
    if study.touching:
        found = touches(study)
        shown.append(
            f"All contacts touch in {found['fraction_all_touch']:.0%} of the samples, "
            f"none in {found['fraction_none_touches']:.0%}"
        )
    return shown


def _conditions(study: Study) -> list[str]:
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


def _errors(study: Study) -> list[str]:
    shown = []
    for name, model in study.file.models.items():
        errors = [
            f"{np.abs(study.fit(name, each).error).max():.3f} {each}"
            for each in model.estimators
            if each != "trajectory"
        ]
        if "trajectory" in model.estimators:
            largest = study.trajectory(name).largest_error
            errors.append("trajectory not determined" if largest is None else f"{report.number(largest)} trajectory")
        shown.append(f"Largest error, {model.title}: {', '.join(errors)}")
    return shown


def _axes(study: Study) -> list[str]:
    numbers, groups = axes(study), len(study.recovered.groups)
    decided = "all joints were given one direction" if groups == 1 else f"there are {groups} directions"
    return [
        f"Recovered axes: {numbers['axis_error_deg']:.3f} deg from the true ones, predicted standard deviation "
        f"{numbers['axis_std_deg']:.3f} deg",
        f"Recovered joint by joint they are {numbers['axis_difference_alone_deg']:.3f} deg apart (rank "
        f"{study.rank_apart}); a Wald test tells them from parallel with p = {numbers['axes_parallel_p_value']:.2f}, "
        f"so {decided}",
    ]


def said(study: Study) -> Said:
    """The page's text besides tables and figures."""
    models = [model.title for model in study.file.models.values()]
    about = (
        f"Simulated from the scene '{study.file.scene.identity['name']}' and identified anew, a model at a time: "
        f"{'; '.join(models)}."
    )
    return Said(study.file.title, about, lines=lines(study), replay=replay(study))


def replay(study: Study) -> Replay:
    """Replay of the simulated motion, with the total wrench: true, measured, and predicted by the models."""
    arm, recording = (
        dataclasses.replace(study.known, tree=study.problem.true),
        study.problem.with_cells(study.recording),
    )
    # Models that share others' parameters predict nearly the same as with their own.
    predicted = {model.title: name for name, model in study.file.models.items() if model.parameters is None}
    curves = {what: what for what in ("true", "measured")} | predicted
    drawn = every_nth(len(recording.time), len(curves) * len(study_tables.CHANNELS))
    return Replay(
        mechanism=arm,
        recording=recording,
        motion=Motion(*recording.joint_states(arm.tree.joints)),
        channels=list(zip(study_tables.CHANNELS, study_tables.UNITS, strict=True)),
        drawn=drawn,
        curves={label: study_figures.wrench(study, what)[drawn] for label, what in curves.items()},
        inks=study_figures.page_inks(study, curves.values()),
        remark="Torques are about the origin of the base frame; models are fitted to the wrenches that they know.",
    )


def results(study: Study) -> Results:
    """All tables and figures that the file describes, and the summary."""
    return Results(
        tables={name: study_tables.table(study, name) for name in study.file.tables},
        figures={name: (study_figures.figure(study, name), e["caption"]) for name, e in study.file.figures.items()},
        numbers={"summary": summary(study) | {"trajectory": trajectory_summary(study)}},
    )


def run(args: argparse.Namespace, file: StudyFile, source: Path | None = None) -> Results:
    """Runs a study and writes and prints its results.

    Args:
        args: The command line, whose values precede the file's.
        file: The study.
        source: Its path; None for a study of the package.
    """
    given = {name: getattr(args, name, None) for name in ("seed", "samples", "tilt_deg", "azimuth_deg", "noise_scale")}
    file = file.with_options(**{name: value for name, value in given.items() if value is not None})
    layout = layout_of(args)
    study = simulated(file)
    names = {name for model in file.models for name in study.fit(model).base.names}
    monte_carlo_files = [f"monte_carlo_{name}" for name in file.trials] + ["figure_monte_carlo"]
    layout.check([*file.tables, *file.figures, *monte_carlo_files], sorted(names), study.known.bodies)
    return monte_carlo.conclude(args, study, results(study), text(study), said(study), source)
