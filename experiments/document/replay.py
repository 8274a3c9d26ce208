"""Replay of a mechanism: poses, forces and channels over time, thinned for a page, or as a file of Rerun's viewer."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.document.figures import INKS
from experiments.document.typography import visible
from ident.files.limits import library
from ident.geometry.inertia import pseudo_inertia
from ident.mechanism.body import BASE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND, pose_in_base
from sim.models.model_mechanism import Shape, shapes

FRAMES, SAMPLES, NUMBERS = 300, 2000, 100_000
"""Largest number of postures, of drawn samples of the channels, and of numbers that either may take together."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A motion to replay on a page.

    Attributes:
        mechanism: The mechanism.
        recording: Recording with its wrenches.
        motion: Its motion (N samples).
        channels: Name and unit of each channel.
        drawn: Indices of the samples whose channels are drawn (M,), as of `every_nth`.
        curves: The channels at these samples, by label (M, C).
        inks: Their colours, as indices into `figures.INKS`; by default in order.
        estimate: Estimated φ of the bodies (10 b,); None if none was estimated.
        identified: Number of each body's ten parameters that the recording determines (b,).
        spans: Spans of time to shade, s.
        shaded: Meaning of the shaded spans.
        remark: A sentence on the curves.
        parameters: Shown for each pressed base parameter: `text`, and the index of the tree's body.
        findings: Shown for each pressed finding: `where` in words, `body`, `channels` and `span`; one without `where`
            cannot be pressed.
    """

    mechanism: Mechanism
    recording: Recording
    motion: Motion
    channels: Sequence[tuple[str, str]]
    drawn: np.ndarray
    curves: Mapping[str, np.ndarray]
    inks: Sequence[int] = ()
    estimate: np.ndarray | None = None
    identified: np.ndarray | None = None
    spans: Sequence[tuple[float, float]] = ()
    shaded: str = ""
    remark: str = ""
    parameters: Sequence[Mapping[str, Any]] = ()
    findings: Sequence[Mapping[str, Any]] = field(default_factory=tuple)

    def to_page(self) -> dict[str, Any]:
        """The replay in JSON types."""
        shown = evenly(len(self.recording.time), min(FRAMES, NUMBERS // (7 * len(self.mechanism.tree.bodies))))
        poses, solids = self.poses(shown), shapes(self.mechanism)
        bodies, forces = self._bodies(), list(self.forces(shown, poses))
        center, radius = _extent(poses, solids, [each.get("estimate") for each in bodies])
        gravity = self.mechanism.gravity
        size = float(np.linalg.norm(gravity))
        return {
            "up": _short(-gravity / size) if size else [0, 0, 1],
            "center": _short(center),
            "radius": _short(radius),
            "bodies": bodies,
            "estimated": self.estimate is not None,
            "shapes": [
                {"body": each.body, "vertices": _short(each.vertices.ravel()), "faces": each.faces.ravel().tolist()}
                for each in solids
            ],
            "axes": list(self._axes()),
            "arrows": [
                {"name": visible(name), "points": _short(points.ravel()), "forces": _short(force.ravel())}
                for name, points, force in forces
            ],
            "largest": max((np.linalg.norm(_short(force), axis=1).max() for _, _, force in forces), default=0),
            "frames": _short(self.recording.time[shown]),
            "poses": _short(_seven_numbers(poses)),
            "time": _short(self.recording.time[self.drawn]),
            "every": int(self.drawn[1] - self.drawn[0]) if len(self.drawn) > 1 else 1,
            "channels": [(visible(name), unit) for name, unit in self.channels],
            "curves": list(self.curves),
            "inks": [k % len(INKS) for k in self.inks or range(len(self.curves))],
            "values": [_short(values.T) for values in self.curves.values()],
            "spans": _short(np.array(self.spans)),
            "shaded": self.shaded,
            "remark": self.remark,
            "parameters": [_readable(each) for each in self.parameters],
            "findings": [_readable(each) for each in self.findings],
        }

    def poses(self, shown: np.ndarray) -> np.ndarray:
        """Poses of the bodies at some samples, in the base frame or a moving base's inertial frame (F, b, 4, 4).

        Args:
            shown: Indices of the samples (F,).
        """
        poses = self.mechanism.tree.poses(self.motion.q[shown])
        base = self.motion.base_poses
        return poses if base is None else base[shown][:, None] @ poses

    def _bodies(self) -> list[dict[str, Any]]:
        tree, arm = self.mechanism.tree, self.mechanism
        out: list[dict[str, Any]] = [
            {"name": visible(body.name), "parent": body.parent, "told": None} for body in tree.bodies
        ]
        if self.estimate is None:
            return out
        for k, i in enumerate(tree.inertial):
            own = slice(10 * k, 10 * k + 10)
            identified = None if self.identified is None else float(self.identified[k]) / 10
            prior = None if arm.prior is None else ellipsoid(arm.prior[own])
            out[i] |= {"told": identified, "prior": prior, "estimate": ellipsoid(self.estimate[own])}
        return out

    def _axes(self) -> Iterator[dict[str, Any]]:
        """Axes of hinges and slides, in the frames of the bodies that they move."""
        for i, body in enumerate(self.mechanism.tree.bodies):
            if body.moves and not body.is_ball:
                linear, angular = body.twist[:3], body.twist[3:]
                point, direction = (np.cross(angular, linear), angular) if body.turns else (np.zeros(3), linear)
                yield {"body": i, "point": _short(point), "direction": _short(direction), "slides": not body.turns}

    def forces(self, shown: np.ndarray, poses: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Yields the measured forces on the mechanism: name, points of application in m and forces in N (F, 3).

        Args:
            shown: Indices of the samples (F,).
            poses: Poses of the bodies at them, of `poses`, whose axes the forces are in.
        """
        base = None if self.motion.base_poses is None else self.motion.base_poses[shown]
        T_base = np.eye(4) if base is None else base
        names = self.mechanism.tree.names
        for name in (x for x in self.recording.wrenches if x == GROUND or x in self.recording.sensors):
            wrench = self.recording.wrench(name)
            if wrench.frame == "world":
                pose = T_base @ pose_in_base(wrench, poses, base)
            else:
                carrier = T_base if wrench.body is None else poses[:, names.index(wrench.body)]
                pose = carrier @ (wrench.pose[shown] if wrench.pose.ndim == 3 else wrench.pose)
            pose = np.broadcast_to(pose, (len(shown), 4, 4))
            force = (pose[:, :3, :3] @ np.nan_to_num(wrench.on_mechanism[shown, :3, None]))[..., 0]
            yield name, pose[:, :3, 3], force


def every_nth(N: int, numbers: int) -> np.ndarray:
    """Indices of every n-th of N samples, so that charts with so many numbers per sample stay within the limits."""
    return np.arange(0, N, -(-N // min(SAMPLES, max(2, NUMBERS // numbers))))


def evenly(N: int, most: int) -> np.ndarray:
    """Indices of at most so many of N samples, evenly spaced, including the first and the last."""
    return np.unique(np.linspace(0, N - 1, max(2, min(N, most))).round().astype(int))


def ellipsoid(phi: np.ndarray) -> list[list[float]] | None:
    """Three semi-axes and the centre of the uniform ellipsoid with these parameters; None without mass.

    Its second moments per mass about the centre are Σ/m - r rᵀ, a fifth of the squared semi-axes; negative ones, of
    bodies that are not physical, are drawn as zero.
    """
    J = pseudo_inertia(phi)
    if not J[3, 3] > 0:
        return None
    centre = J[:3, 3] / J[3, 3]
    squares, directions = np.linalg.eigh(J[:3, :3] / J[3, 3] - np.outer(centre, centre))
    semi_axes = directions * np.sqrt(5 * np.maximum(squares, 0))
    return [*_short(semi_axes.T), _short(centre)]


def _extent(
    poses: np.ndarray, solids: Sequence[Shape], ellipsoids: Sequence[list[list[float]] | None]
) -> tuple[np.ndarray, float]:
    """Centre and radius of a ball around the bodies in all poses, with their shapes and ellipsoids."""
    points = [poses[..., :3, 3].reshape(-1, 3), np.zeros((1, 3))]
    on_bodies = [(each.body, each.vertices) for each in solids if each.body >= 0]
    for i, numbers in enumerate(ellipsoids):
        if numbers is not None:
            *semi_axes, centre = np.array(numbers)
            on_bodies.append((i, centre + np.concatenate([semi_axes, np.negative(semi_axes)])))
    for i, corners in on_bodies:
        box = np.array([corners.min(axis=0), corners.max(axis=0)])
        points.append((box @ np.swapaxes(poses[:, i, :3, :3], 1, 2) + poses[:, i, None, :3, 3]).reshape(-1, 3))
    every = np.concatenate(points)
    center = (every.min(axis=0) + every.max(axis=0)) / 2
    return center, max(float(np.linalg.norm(every - center, axis=1).max()), 1e-3)


def _seven_numbers(poses: np.ndarray) -> np.ndarray:
    """Position and quaternion of each body, body after body (F, 7 b)."""
    quaternions = Rotation.from_matrix(poses[..., :3, :3].reshape(-1, 3, 3)).as_quat(scalar_first=True)
    numbers = np.concatenate([poses[..., :3, 3], quaternions.reshape(*poses.shape[:2], 4)], axis=-1)
    return numbers.reshape(len(poses), -1)


def _short(x: Any) -> Any:
    """Numbers as lists, rounded to five digits, as a pixel is a thousandth of the width; None if not finite."""
    # Python's own numbers take half as long as numpy's.
    if isinstance(x, np.ndarray):
        x = x.tolist()
    if isinstance(x, list):
        return [_short(each) for each in x]
    return float(f"{x:.5g}") + 0.0 if isfinite(x) else None


def _readable(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with texts free of marks of writing direction."""
    return {key: visible(value) if isinstance(value, str) else value for key, value in content.items()}


RERUN = "replay.rrd"
"""Name of the file in a folder of results."""

APPLICATION = "multicontact"
"""Name by which the viewer groups recordings."""

SOLID, LINK, FORCE = (np.array(color, np.uint8) for color in ([120, 150, 180], [90, 90, 90], [191, 33, 33]))
"""Colours of shapes, of the lines between joints and of forces: red, green, blue."""

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


def write_rerun(replay: Replay, path: Path) -> None:
    """Writes a replay as an `.rrd` file, at the times of the drawn channels.

    Entities are `mechanism/bodies/BODY` with their shapes, `mechanism/links` between joints, `mechanism/forces/RERUN`
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
            origin=_path("channels", name), name=f"{name}, {unit}", plot_legend=blueprint.PlotLegend(visible=k == 0)
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
    # Lines are thin beside the ball around the motion, and the largest arrow nearly reaches its edge, as on the page.
    style = {"radii": 0.01 * page["radius"]}
    pairs = [(body.parent, i) for i, body in enumerate(tree.bodies) if body.parent >= 0]
    if pairs:
        strips = poses[..., :3, 3][:, pairs].reshape(-1, 2, 3)
        columns = rerun.LineStrips3D.columns(strips=strips).partition([len(pairs)] * len(poses))
        yield ("mechanism", "links"), rerun.LineStrips3D.from_fields(colors=LINK, **style), time, columns
    scale = 0.8 * page["radius"] / page["largest"] if page["largest"] else 0.0
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
