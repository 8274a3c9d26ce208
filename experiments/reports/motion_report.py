"""Reports on motions: joint angles from markers, and designed excitations, with the motions as recordings."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from experiments.data.paper import RANDOM_START
from experiments.document import tabular, typography
from experiments.document.figures import empty_figure
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import of_deviations
from experiments.document.writer import Document, Plot, sentences
from experiments.studies.designed_excitation import Design
from experiments.studies.user_files import Angles
from ident.display.plots import Figure, add_legend, few_ticks, label_above
from ident.files.atomic import save_arrays
from ident.geometry.inertia import with_bodies
from ident.recordings.recording import STATES
from ident.tolerances import NAMED
from sim.markers.lengths import Scaling, write_scaled
from sim.markers.trial_fit import Postures
from sim.models.notes import joint_name

ANGLES = (*RESULTS, "angles.csv", "angles.npz", "covariance.npz", "model_scaled.xml")
"""Patterns of the files of angles."""


def markers_table(postures: Postures) -> tabular.Table:
    """Distance of each marker from the fit, in frames that count, and the frames in which it is missing or outlying."""
    distances, outlying = postures.distances, postures.outlying
    there = [(x[np.isfinite(x)], x[np.isfinite(x) & ~out]) for x, out in zip(distances.T, outlying.T, strict=True)]
    columns: dict[str, Sequence[tabular.Cell]] = {
        "marker": postures.marked.labels,
        "rms_mm": [1e3 * float(np.sqrt(np.mean(kept**2))) if kept.size else np.nan for _, kept in there],
        "largest_mm": [1e3 * float(every.max()) if every.size else np.nan for every, _ in there],
        "missing_frames": np.isnan(distances).sum(axis=0).tolist(),
        "outlying_frames": outlying.sum(axis=0).tolist(),
    }
    return tabular.Table("Distances of the markers from the fit", *tabular.columns(**columns), decimals=2)


def joints_table(postures: Postures) -> tabular.Table:
    """Range and standard deviation of each degree of freedom, and the number of frames beyond the model's range."""
    marked, model = postures.marked, postures.marked.model
    rows: list[tuple[tabular.Cell, ...]] = []
    for k, (d, name) in enumerate(zip(marked.dofs, marked.dof_names, strict=True)):
        j, there = int(model.dof_jntid[d]), postures.determined[:, k]
        slide = marked.dofs_of(j) == 6 and d - model.jnt_dofadr[j] < 3
        slide = slide or model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE
        scale, lowest, highest, std = 1e3 if slide else np.degrees(1.0), np.nan, np.nan, np.nan
        if there.any():
            std = scale * float(np.sqrt((postures.std[there, k] ** 2).mean()))
        if there.any() and marked.dofs_of(j) == 1:
            q = scale * postures.qpos[there, model.jnt_qposadr[j]]
            lowest, highest = float(q.min()), float(q.max())
        unit, undetermined = "mm" if slide else "°", int((~there).sum())
        rows.append((name, unit, lowest, highest, std, undetermined, beyond_range(postures, j)))
    heads = ("coordinate", "unit", "lowest", "highest", "std", "frames_not_determined", "frames_beyond_range")
    return tabular.Table("Coordinates", heads, rows)


def beyond_range(postures: Postures, j: int) -> int:
    """Number of frames in which a hinge, slide or ball is beyond its range by more than its noise."""
    marked, model = postures.marked, postures.marked.model
    own = np.flatnonzero(model.dof_jntid[marked.dofs] == j)
    if not model.jnt_limited[j] or marked.dofs_of(j) == 6:
        return 0
    first, (low, high) = int(model.jnt_qposadr[j]), model.jnt_range[j]
    if marked.dofs_of(j) == 3:
        q = postures.qpos[:, first : first + 4]
        value, low = 2 * np.arctan2(np.linalg.norm(q[:, 1:], axis=1), np.abs(q[:, 0])), -np.inf
    else:
        value = postures.qpos[:, first]
    margin = 2 * np.nan_to_num(postures.std[:, own].max(axis=1))
    beyond = (value < low - margin) | (value > high + margin)
    return int((beyond & postures.determined[:, own].all(axis=1)).sum())


def scale_table(lengths: Scaling) -> tabular.Table:
    """Factors on the lengths of segments."""
    bodies = [", ".join(group) for group in lengths.groups]
    columns = tabular.columns(bodies=bodies, factor=lengths.factors.tolist(), std=lengths.std.tolist())
    return tabular.Table("Factors on the lengths of segments", *columns, deviations={"factor": "std"})


def residuals_figure(angles: Angles) -> Figure:
    """RMS distance of the markers from the fit over time."""
    distances = 1e3 * np.where(angles.postures.outlying, np.nan, angles.postures.distances)
    visible = np.isfinite(distances)
    by_frame = np.sqrt(np.nansum(distances**2, axis=1) / np.maximum(visible.sum(axis=1), 1))
    with empty_figure(1.9, wide=True) as figure:
        ax = figure.subplots()
        ax.plot(angles.markers.time, by_frame, color="C0", lw=0.8)
        ax.set_xlabel("Time (s)", labelpad=2)
        ax.set_ylabel("Distance, RMS (mm)", labelpad=2)
        ax.set_ylim(bottom=0)
        ax.margins(x=0)
    return figure


def angles_lines(angles: Angles) -> list[str]:
    """Sentences on the main results of a trial."""
    fit, model = angles.postures, angles.postures.marked.model
    joints = sorted({int(model.dof_jntid[d]) for d in fit.marked.dofs})
    more = {"beyond": {joint_name(model, j): beyond_range(fit, j) for j in joints}, "far_off": 0.05}
    more |= {"outlying": dict(zip(fit.marked.labels, fit.outlying.sum(axis=0).tolist(), strict=True))}
    more |= {"noise": f"{1e3 * fit.sigma:.2f} mm" if np.isfinite(fit.sigma) else "unknown, markers are too few"}
    return sentences("angles.txt", angles=angles, fit=fit, **more)


def angles_document(angles: Angles, model: Path, markers: Path, provenance: dict[str, Any]) -> Document:
    """Tables and a figure, angles and their covariance, and the scaled model if there is one.

    Args:
        angles: The fitted angles.
        model: Model file.
        markers: File of the markers.
        provenance: Provenance of the results.
    """
    postures, lengths = angles.postures, angles.scaling
    tables = {"table_markers": markers_table(postures), "table_joints": joints_table(postures)}
    covariance = {"time": angles.markers.time, "names": np.array(postures.marked.dof_names)}
    covariance |= {"covariance": postures.covariance}
    files: dict[str, Callable[[Path], object]] = {"covariance.npz": lambda path: save_arrays(path, covariance)}
    if lengths is not None:
        tables["table_lengths"] = scale_table(lengths)
        files["model_scaled.xml"] = lambda path: write_scaled(path, postures.marked.spec, lengths.model)
    return Document(
        f"Joint angles of {model.name} from {markers.name}",
        lines=angles_lines(angles),
        heading="The trial",
        tables=tables,
        figures={"figure_residuals": Plot(partial(residuals_figure, angles), "Distances of the markers from the fit.")},
        numbers={"provenance": provenance},
        recordings=dict.fromkeys(("angles.csv", "angles.npz"), angles.recording),
        files=files,
    )


PER = ("", "/s", "/s²")
"""Suffixes of units for position, velocity and acceleration."""


def table_quality(design: Design) -> tabular.Table:
    """All criteria before and after."""
    old, new = design.before.quality, design.after.quality
    rows = [(name, old[name], new[name]) for name in old]
    names = {name: tabular.heading(name) for name in old} | {"log_det_information": "log det of the information"}
    return tabular.Table("Criteria", ("criterion", "before", "after"), rows, decimals=4, names=names)


def table_deviations(design: Design) -> tabular.Table:
    """Predicted standard deviations of base parameters before and after, prior ones, and their geometric means."""
    title = (
        f"Excitation of {', '.join(design.problem.joints)}: predicted standard deviations, SI units, of {design.start} "
        "and the designed one"
    )
    std = {} if design.known is None else {"std_known": design.known}
    std |= {"std_before": design.before.std, "std_after": design.after.std}
    names = (*design.problem.names, "geometric mean")
    with np.errstate(divide="ignore"):
        means = {name: np.append(values, np.exp(np.log(values).mean())) for name, values in std.items()}
    digits = {name: of_deviations(values) for name, values in means.items()}
    columns = tabular.columns(parameter=names, **means)
    return tabular.Table(title, *columns, digits=digits, bodies=design.problem.mechanism.bodies)


def table_limits(design: Design) -> tabular.Table:
    """Used range and limits of each joint."""
    limits, both = design.limits, (design.before.motion, design.after.motion)
    rows: list[tuple[tabular.Cell, ...]] = []
    for k, joint in enumerate(design.problem.joints):
        unit = design.problem.units[joint]
        used = {f"lowest position, {unit}": ([x.q[:, k].min() for x in both], limits.low)}
        used |= {f"highest position, {unit}": ([x.q[:, k].max() for x in both], limits.high)}
        rates = zip(STATES[1:], PER[1:], (limits.velocity, limits.acceleration), strict=True)
        for order, (kind, per, largest) in enumerate(rates, start=1):
            used[f"largest {kind}, {unit}{per}"] = [abs(x.states[order][:, k]).max() for x in both], largest
        rows += [(joint, what, *map(float, (*own, limit[k]))) for what, (own, limit) in used.items()]
    return tabular.Table("Limits", ("joint", "quantity", "before", "after", "limit"), rows)


def excitation_figure(design: Design) -> Figure:
    """Position, velocity and acceleration of each moving joint, before and after, with their limits."""
    limits, joints, time = design.limits, design.problem.joints, design.time
    fastest = limits.velocity, limits.acceleration
    bounds = ((limits.low, limits.high), *((-each, each) for each in fastest))
    first, last = (f"{each.quality['condition_number']:.3g}" for each in (design.before, design.after))
    with empty_figure(0.6 + 1.05 * len(joints), wide=True) as drawing:
        axes = drawing.subplots(len(joints), 3, sharex=True, squeeze=False)
        for (k, column), ax in np.ndenumerate(axes):
            low, high = (float(bound[k]) for bound in bounds[column])
            old, new = (each.motion.states[column][:, k] for each in (design.before, design.after))
            # A longer motion before is drawn as long as the designed one.
            old = old[: len(time)]
            ax.plot(time, new, color="C0", lw=1.0, zorder=3, label=f"designed: condition number {last}")
            ax.plot(time[: len(old)], old, color="0.6", label=f"before: {first}")
            for limit in (low, high):
                ax.axhline(limit, color="C1", lw=0.7, ls="--", label="limits")
            few_ticks(ax)
            ax.set(xlim=(time[0], time[-1]), ylim=(1.08 * low - 0.08 * high, 1.08 * high - 0.08 * low))
            unit = f"{design.problem.units[joints[k]]}{PER[column]}"
            label_above(ax, f"{typography.label(joints[k])}, {STATES[column]} ({unit})")
        for ax in axes[-1]:
            ax.set_xlabel("Time (s)", labelpad=2)
        add_legend(drawing)
    return drawing


def excitation_lines(design: Design) -> list[str]:
    """Sentences for the terminal and the page, besides the tables."""
    motion, limits = design.before.motion, design.limits
    # What is faster before by more than a twentieth is said.
    beyond = abs(motion.dq).max(axis=0) > 1.05 * limits.velocity
    beyond |= abs(motion.ddq).max(axis=0) > 1.05 * limits.acceleration
    long, short = (len(each.motion.q) - 1 for each in (design.before, design.after))
    problem, own = design.problem, design.problem.parameters.names
    names = with_bodies(own, problem.mechanism.bodies) if len(own) <= NAMED else ""
    more = {"names": names, "most": NAMED, "compared": design.start != RANDOM_START}
    more |= {"fast": [name for name, fast in zip(problem.joints, beyond, strict=True) if fast], "alike": 0.1}
    return sentences("excite.txt", design=design, long=long, short=short, **more)


def excitation_document(design: Design, model: str, provenance: dict[str, Any]) -> Document:
    """Tables and a figure of a design, and its motion as a recording."""
    caption = f"Position, velocity and acceleration of the joints that move: designed, and before, {design.start}."
    return Document(
        f"Excitation of {Path(model).name}",
        lines=excitation_lines(design),
        tables={
            "table_deviations": table_deviations(design),
            "table_quality": table_quality(design),
            "table_limits": table_limits(design),
        },
        figures={"figure_excitation": Plot(partial(excitation_figure, design), caption)},
        numbers={"provenance": provenance},
        recordings=dict.fromkeys(("trajectory.csv", "trajectory.npz"), design.recording),
    )
