"""Report on joint angles from markers: angles as files, tables of markers, joints and lengths, a figure and a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from matplotlib.figure import Figure

from experiments.document import figures, report
from experiments.document.layout import PAPER, Layout
from experiments.document.page import PAGE, Said, write_report
from experiments.document.results import Results
from experiments.document.terminal import wrapped
from ident.files.atomic import save_arrays
from sim.markers.scaled_file import write_scaled
from sim.markers.trial_fit import Postures
from sim.models.names import joint_name

if TYPE_CHECKING:
    from experiments.studies.angles import Angles

OUTPUTS = (*report.OUTPUTS, PAGE, "angles.csv", "angles.npz", "covariance.npz", "model_scaled.xml")

MM = 1e3
"""Millimetres per metre."""

FAR_OFF = 0.05
"""Share of outlying frames of a marker above which a sentence says so."""


def markers_table(postures: Postures) -> report.Table:
    """Distance of each marker from the fit, in frames that count, and the frames in which it is missing or outlying."""
    distances, outlying = postures.distances, postures.outlying
    kept = np.where(outlying | np.isnan(distances), np.nan, distances)
    columns: dict[str, Sequence[report.Cell]] = {
        "marker": postures.marked.labels,
        "rms_mm": [MM * float(np.sqrt(np.mean(x**2))) if x.size else np.nan for x in map(_finite, kept.T)],
        "largest_mm": [MM * float(x.max()) if x.size else np.nan for x in map(_finite, distances.T)],
        "missing_frames": np.isnan(distances).sum(axis=0).tolist(),
        "outlying_frames": outlying.sum(axis=0).tolist(),
    }
    return report.Table("Distances of the markers from the fit", *report.columns(**columns), decimals=2)


def _finite(x: np.ndarray) -> np.ndarray:
    return x[np.isfinite(x)]


def joints_table(postures: Postures) -> report.Table:
    """Range and standard deviation of each degree of freedom, and the number of frames beyond the model's range."""
    marked, model = postures.marked, postures.marked.model
    rows: list[tuple[report.Cell, ...]] = []
    for k, (d, name) in enumerate(zip(marked.dofs, marked.dof_names, strict=True)):
        j, there = int(model.dof_jntid[d]), postures.determined[:, k]
        slide = marked.dofs_of(j) == 6 and d - model.jnt_dofadr[j] < 3
        slide = slide or model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE
        scale = MM if slide else np.degrees(1.0)
        values = (np.nan, np.nan)
        if marked.dofs_of(j) == 1 and there.any():
            q = scale * postures.qpos[there, model.jnt_qposadr[j]]
            values = float(q.min()), float(q.max())
        std = scale * float(np.sqrt((postures.std[there, k] ** 2).mean())) if there.any() else np.nan
        rows.append((name, "mm" if slide else "°", *values, std, int((~there).sum()), beyond_range(postures, j)))
    heads = ("coordinate", "unit", "lowest", "highest", "std", "frames_not_determined", "frames_beyond_range")
    return report.Table("Coordinates", *report.columns(**dict(zip(heads, zip(*rows, strict=True), strict=True))))


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


def scale_table(found: "Angles") -> report.Table:
    """Factors on the lengths of segments."""
    lengths = found.scaling
    assert lengths is not None
    columns = {
        "bodies": [", ".join(group) for group in lengths.groups],
        "factor": lengths.factors.tolist(),
        "std": lengths.std.tolist(),
    }
    return report.Table("Factors on the lengths of segments", *report.columns(**columns), decimals=4)


def residuals_figure(found: "Angles") -> Figure:
    """RMS distance of the markers from the fit over time."""
    distances = MM * np.where(found.postures.outlying, np.nan, found.postures.distances)
    seen = np.isfinite(distances)
    by_frame = np.sqrt(np.nansum(distances**2, axis=1) / np.maximum(seen.sum(axis=1), 1))
    with figures.paper_style():
        figure = Figure(figsize=(figures.text_width(), 1.9))
        ax = figure.subplots()
        ax.plot(found.markers.time, by_frame, color="C0", lw=0.8)
        ax.set_xlabel("Time (s)", labelpad=2)
        ax.set_ylabel("Distance, RMS (mm)", labelpad=2)
        ax.set_ylim(bottom=0)
        ax.margins(x=0)
    return figure


def lines(found: "Angles") -> list[str]:
    """Sentences on the main results of a trial."""
    postures, labels = found.postures, found.postures.marked.labels
    N, M = postures.distances.shape
    base = "the world's frame" if found.base is None else f"the frame of '{found.base}'"
    sigma = f"{MM * postures.sigma:.2f} mm" if np.isfinite(postures.sigma) else "unknown, markers are too few"
    out = [
        f"{M} markers in {N} frames; {{0}} is {base}. Noise of a coordinate of a marker: {sigma}.",
        *([f"No site belongs to {', '.join(found.unmatched)}; left out."] if found.unmatched else []),
    ]
    for swap in found.swaps:
        a, b = swap.labels
        out.append(f"The labels of '{a}' and '{b}' seem exchanged in {swap.frames} of {N} frames.")
    exchanged = {label for swap in found.swaps for label in swap.labels}
    for k in np.flatnonzero(postures.outlying.mean(axis=0) > FAR_OFF):
        if labels[k] not in exchanged:
            number = int(postures.outlying[:, k].sum())
            out.append(f"Marker '{labels[k]}' is far from where the others have it in {number} of {N} frames.")
    model = postures.marked.model
    for j in sorted({int(model.dof_jntid[d]) for d in postures.marked.dofs}):
        if number := beyond_range(postures, j):
            out.append(f"Joint '{joint_name(model, j)}' is beyond its range in {number} of {N} frames.")
    return [*out, *found.recording.notes]


def results(found: "Angles", provenance: dict[str, Any]) -> Results:
    """All tables, figures and numbers."""
    tables = {"table_markers": markers_table(found.postures), "table_joints": joints_table(found.postures)}
    if found.scaling is not None:
        tables["table_lengths"] = scale_table(found)
    drawn = {"figure_residuals": (residuals_figure(found), "Distances of the markers from the fit.")}
    return Results(tables, drawn, {"provenance": provenance})


def write(
    found: "Angles",
    folder: Path,
    model: Path,
    markers: Path,
    provenance: dict[str, Any],
    formats: Sequence[str],
    layout: Layout = PAPER,
) -> str:
    """Writes everything into a folder: angles, their covariance, tables, a page, and the scaled model if there is one.

    Args:
        found: The fitted angles.
        folder: The folder.
        model: Model file; `markers` the file of the markers.
        provenance: Provenance of the results.
        formats: Formats of the figures.
        layout: Layout of tables and figures in print.

    Returns:
        A sentence if the layout cannot be applied, else an empty one.
    """
    shown, every = results(found, provenance), list(dict.fromkeys(["png", *formats]))
    layout, refused = shown.chosen(layout)
    shown.write(folder, every, layout)
    for suffix in ("csv", "npz"):
        found.recording.save(folder / f"angles.{suffix}")
    names = np.array(found.postures.marked.dof_names)
    covariance = {"time": found.markers.time, "names": names, "covariance": found.postures.covariance}
    save_arrays(folder / "covariance.npz", covariance)
    if found.scaling is not None:
        write_scaled(folder / "model_scaled.xml", found.postures.marked.spec, found.scaling.model)
    said = Said(
        f"Joint angles of {model.name} from {markers.name}",
        lines=lines(found),
        heading="The trial",
        files=["angles.csv", "angles.npz", "covariance.npz", *(["model_scaled.xml"] if found.scaling else [])],
    )
    write_report(folder, shown, every, said)
    return refused


def text(found: "Angles") -> str:
    """Text for the terminal."""
    tables = [markers_table(found.postures), joints_table(found.postures)]
    tables += [scale_table(found)] if found.scaling is not None else []
    return wrapped("\n".join([*(table.text() for table in tables), *lines(found)]))
