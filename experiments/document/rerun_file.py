"""A replay as a file of Rerun's viewer: bodies, forces, and channels over one time."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.document.document import Document
from experiments.document.figures import INKS
from experiments.document.replay import Replay
from experiments.document.symbols import visible
from ident.files.limits import library
from ident.mechanism.body import BASE
from sim.models.shapes import Shape, shapes

NAME = "replay.rrd"
"""Name of the file in a folder of results."""

APPLICATION = "multicontact"
"""Name by which the viewer groups recordings."""

ARROW = 0.8
"""Length of the largest force's arrow, over the radius of the ball around the motion, as on the page."""

SOLID, LINK, FORCE = (np.array(color, np.uint8) for color in ([120, 150, 180], [90, 90, 90], [191, 33, 33]))
"""Colours of shapes, of the lines between joints and of forces: red, green, blue."""

THICK = 0.01
"""Radius of these lines and of the forces' arrows, over that of the ball around the motion."""

Entity = tuple[str, ...]
"""Path of an entity in the viewer's tree, by its parts."""

Moving = tuple[Entity, Any, np.ndarray, Any]
"""Path, style, times in s, and the library's columns of values."""


def check_installed() -> Any:
    """The library, so that a long computation does not end without it.

    Raises:
        InputError: It is not installed.
    """
    with library("rerun", "This"):
        return import_module("rerun")


def with_rerun(document: Document) -> Document:
    """The document with a file of its replay, if it has one."""
    if document.replay is None:
        return document
    return replace(document, files={**document.files, NAME: partial(write_rerun, document.replay)})


def write_rerun(replay: Replay, path: Path) -> None:
    """Writes a replay as an `.rrd` file, at the times of the drawn channels.

    Entities are `mechanism/bodies/BODY` with their shapes, `mechanism/links` between joints, `mechanism/forces/NAME`
    and `channels/CHANNEL/CURVE`; the mechanism stands in the world as its model says.

    Raises:
        InputError: The library is not installed.
    """
    rerun = check_installed()
    stream = rerun.RecordingStream(APPLICATION, recording_id=APPLICATION, send_properties=False)
    stream.save(path, default_blueprint=_layout(replay))
    stream.send_recording_name(path.stem)
    for entity, content in _resting(rerun, replay):
        stream.log(_path(*entity), content, static=True, strict=True)
    for entity, style, time, columns in (*_moving(rerun, replay), *_curves(rerun, replay)):
        if style is not None:
            stream.log(_path(*entity), style, static=True, strict=True)
        times = [rerun.TimeColumn("time", duration=time)]
        rerun.send_columns(_path(*entity), times, columns, recording=stream, strict=True)
    stream.flush()
    stream.disconnect()


def _layout(replay: Replay) -> Any:
    """The viewer's layout: the mechanism beside a chart of each channel, the first with a legend."""
    from rerun import blueprint

    charts = [
        blueprint.TimeSeriesView(
            origin=_path("channels", name),
            name=f"{name}, {unit}",
            plot_legend=blueprint.PlotLegend(visible=k == 0),
        )
        for k, (name, unit) in enumerate(_channels(replay))
    ]
    scene = blueprint.Spatial3DView(origin="/", contents="/mechanism/**", name="mechanism")
    parts = blueprint.Horizontal(scene, blueprint.Grid(*charts), column_shares=[2, 3])
    return blueprint.Blueprint(parts, collapse_panels=True)


def _path(*parts: str) -> str:
    from rerun import new_entity_path

    return str(new_entity_path([visible(part) for part in parts]))


def _resting(rerun: Any, replay: Replay) -> Iterator[tuple[Entity, Any]]:
    """Yields what does not change: axes, the mechanism's place in the world, and shapes on bodies."""
    pose, names = replay.mechanism.pose, replay.mechanism.tree.names
    yield (), rerun.ViewCoordinates.RIGHT_HAND_Z_UP
    yield ("mechanism",), rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
    for k, each in enumerate(shapes(replay.mechanism)):
        on = () if each.body == BASE else ("bodies", names[each.body])
        yield ("mechanism", *on, f"shape {k}"), _solid(rerun, each)


def _solid(rerun: Any, shape: Shape) -> Any:
    """A convex solid whose faces are flat, each with corners of its own."""
    corners = shape.vertices[shape.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return rerun.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0),
        triangle_indices=np.arange(3 * len(corners)).reshape(-1, 3),
        albedo_factor=SOLID,
    )


def _moving(rerun: Any, replay: Replay) -> Iterator[Moving]:
    """Yields what moves: poses of bodies, links between joints, and forces."""
    tree, poses, time = replay.mechanism.tree, replay.poses(replay.drawn), replay.recording.time[replay.drawn]
    for i, name in enumerate(tree.names):
        quaternions = Rotation.from_matrix(poses[:, i, :3, :3]).as_quat()
        columns = rerun.Transform3D.columns(translation=poses[:, i, :3, 3], quaternion=quaternions)
        yield ("mechanism", "bodies", name), None, time, columns
    page = replay.to_page()
    style = {"radii": THICK * page["radius"]}
    pairs = [(body.parent, i) for i, body in enumerate(tree.bodies) if body.parent >= 0]
    if pairs:
        strips = poses[..., :3, 3][:, pairs].reshape(-1, 2, 3)
        columns = rerun.LineStrips3D.columns(strips=strips).partition([len(pairs)] * len(poses))
        yield ("mechanism", "links"), rerun.LineStrips3D.from_fields(colors=LINK, **style), time, columns
    scale = ARROW * page["radius"] / page["largest"] if page["largest"] else 0.0
    for name, points, forces in replay.forces(replay.drawn, poses):
        columns = rerun.Arrows3D.columns(origins=points, vectors=scale * forces)
        yield ("mechanism", "forces", name), rerun.Arrows3D.from_fields(colors=FORCE, **style), time, columns


def _curves(rerun: Any, replay: Replay) -> Iterator[Moving]:
    """Yields each curve of each channel, without the samples that it lacks."""
    from matplotlib.colors import to_rgba

    time = replay.recording.time[replay.drawn]
    inks = [INKS[k % len(INKS)] for k in replay.inks or range(len(replay.curves))]
    for k, (channel, _) in enumerate(_channels(replay)):
        for (label, values), ink in zip(replay.curves.items(), inks, strict=True):
            there = np.isfinite(values[:, k])
            style = rerun.SeriesLines(names=label, colors=[round(255 * x) for x in to_rgba(ink)])
            yield ("channels", channel, label), style, time[there], rerun.Scalars.columns(scalars=values[there, k])


def _channels(replay: Replay) -> list[tuple[str, str]]:
    """Names, which the viewer can show, and units of the channels."""
    return [(visible(name), unit) for name, unit in replay.channels]
