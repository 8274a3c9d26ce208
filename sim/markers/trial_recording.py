"""Postures of a trial as a recording, joint positions with their noise and the base's poses, and exchanged labels."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ident.errors import InputError
from ident.files.table import BASE
from ident.geometry.se3 import without_jumps
from ident.recordings.recording import Recording
from sim.markers.marked_model import MarkedModel
from sim.markers.trial_fit import Postures
from sim.models.mujoco_model import BEYOND, mechanism_bodies
from sim.models.notes import body_id, body_name, joint_name

_BALL, _FREE, _SLIDE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{kind}")) for kind in ("BALL", "FREE", "SLIDE"))


def recording(
    postures: Postures,
    time: np.ndarray,
    base: str | None,
    provenance: Mapping[str, Any] | None = None,
    felt: Recording | None = None,
) -> Recording:
    """Recording of a trial: `JOINT_position` of all joints and `base:pose` of a moving base.

    The position of a ball is a quaternion; its noise is that of each component of a rotation vector. The noise of a
    channel is the root mean square of the standard deviations of all frames. A coordinate that the markers do not
    determine in some frames is interpolated there; one that they determine in no frame has no channel.

    Args:
        postures: Fitted postures.
        time: Times of the frames, s (N,).
        base: Body whose frame is {0}, None for the world's.
        provenance: Origin of the markers.
        felt: A recording of wrenches on the same clock, which are added, interpolated at the frames.

    Raises:
        InputError: The markers determine no joint, or never the base.
    """
    marked = postures.marked
    streams: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    units, noise = dict[str, str](), dict[str, float]()
    determined: np.ndarray = postures.determined
    std = postures.std
    notes: list[str] = []
    for j in joints(marked, base):
        own = np.flatnonzero(marked.model.dof_jntid[marked.dofs] == j)
        there, name = determined[:, own].all(axis=1), joint_name(marked.model, j)
        first, ball = int(marked.model.jnt_qposadr[j]), int(marked.model.jnt_type[j]) == _BALL
        if not there.any():
            notes.append(f"The markers do not determine joint '{name}', which has no channel.")
            continue
        channel = f"{name}_position"
        values = without_jumps(postures.qpos[:, first : first + 4]) if ball else postures.qpos[:, first]
        streams[channel] = time, np.where(there.reshape(-1, 1) if ball else there, values, np.nan)
        units[channel] = "1" if ball else "m" if marked.model.jnt_type[j] == _SLIDE else "rad"
        if np.isfinite(postures.sigma):
            noise[channel] = float(np.sqrt((std[there][:, own] ** 2).mean()))
        if not there.all():
            notes.append(f"Joint '{name}' is interpolated in {int((~there).sum())} frames that do not determine it.")
    if not streams:
        raise InputError("The markers determine no joint below the base; more of them need a site in the model.")
    if (carrying := _carrying(marked, base)) is not None:
        there = determined[:, carrying].all(axis=1)
        if there.sum() < 2:
            raise InputError(f"The markers never determine the pose of the base '{base}'; it needs three or more.")
        streams[BASE] = time, np.where(there.reshape(-1, 1), _poses(postures, base), np.nan)
        if not there.all():
            notes.append(f"The base is interpolated in {int((~there).sum())} frames that do not determine it.")
    if felt is not None:
        channels = [f"{name}_{kind}" for name in felt.wrenches for kind in ("force", "torque")]
        streams |= {channel: felt.as_measured(channel) for channel in channels}
        units |= {channel: felt.units[channel] for channel in channels if channel in felt.units}
        noise |= {channel: felt.noise[channel] for channel in channels if channel in felt.noise}
    more = {"units": units, "noise": noise, "provenance": dict(provenance or {}), "notes": notes}
    rate = (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else None
    return Recording.from_streams(streams, rate=rate, sensors={} if felt is None else felt.sensors, **more)


def joints(marked: MarkedModel, base: str | None) -> list[int]:
    """Ids of the joints that move beyond the base, except free ones."""
    model = marked.model
    members = set(mechanism_bodies(model, base, BEYOND)) - ({body_id(model, base)} if base is not None else set())
    moving = {int(model.dof_jntid[d]) for d in marked.dofs}
    return [j for j in sorted(moving) if model.jnt_bodyid[j] in members and model.jnt_type[j] != _FREE]


def _carrying(marked: MarkedModel, base: str | None) -> np.ndarray | None:
    """Indices of the degrees of freedom that move the base (k,); None if it rests."""
    model = marked.model
    if base is None:
        return None
    b, carriers = body_id(model, base), set()
    while b:
        carriers.add(body_name(model, b))
        b = int(model.body_parentid[b])
    own = [body_name(model, int(model.dof_bodyid[d])) in carriers for d in marked.dofs]
    return np.flatnonzero(own) if any(own) else None


def _poses(postures: Postures, base: str | None) -> np.ndarray:
    """Poses of the base in the world, row by row (N, 16)."""
    model = postures.marked.model
    data, b = mujoco.MjData(model), body_id(model, str(base))
    out = np.tile(np.eye(4), (len(postures.qpos), 1, 1))
    for T, qpos in zip(out, postures.qpos, strict=True):
        data.qpos = qpos
        mujoco.mj_kinematics(model, data)
        T[:3, :3], T[:3, 3] = data.xmat[b].reshape(3, 3), data.xpos[b]
    return out.reshape(-1, 16)


class Swap(NamedTuple):
    """Two labels that seem exchanged.

    Attributes:
        labels: The two labels.
        frames: Number of frames in which they seem exchanged.
    """

    labels: tuple[str, str]
    frames: int


def swaps(postures: Postures, measured: np.ndarray) -> list[Swap]:
    """Pairs of outlying markers that are twice as near each other's fitted positions as their own, most frames first.

    Args:
        postures: Fitted postures.
        measured: Positions that they were fitted to (N, M, 3).
    """
    labels, places, own = postures.marked.labels, measured - postures.residuals, postures.distances
    outlying = postures.outlying
    candidates = []
    for a, b in combinations(np.flatnonzero(outlying.any(axis=0)), 2):
        both = outlying[:, a] & outlying[:, b]
        crossed = [
            np.linalg.norm(measured[both, one] - places[both, other], axis=1) < 0.5 * own[both, one]
            for one, other in ((a, b), (b, a))
        ]
        if frames := int((crossed[0] & crossed[1]).sum()):
            candidates.append(Swap((labels[a], labels[b]), frames))
    return sorted(candidates, key=lambda swap: -swap.frames)
