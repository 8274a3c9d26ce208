"""A user's model and log made ready to be fitted: one set of samples, channels and columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.estimation.robust import independent
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor, drive_names, joint_torque_regressor
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.parameters.structure import Sensors
from ident.recordings.despike import despiked
from ident.recordings.log import read_log
from ident.recordings.mapping import KINDS
from ident.recordings.npz import LIMIT
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff, low_pass, settling, smoothed
from ident.recordings.suggestion import suggested_mapping
from ident.recordings.wrench import GROUND, total_wrench
from sim.models.couplings import check_torques
from sim.models.mujoco_model import compiled, gravity_in_base, mechanism_bodies, parameters_from_model, tree_from_model

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
DRIVE = ("viscous", "coulomb", "rotor")


@dataclass(frozen=True, eq=False)
class Prepared:
    """Everything that a fit needs.

    Attributes:
        tree: The mechanism.
        prior: φ of the model file (10 b,).
        base: Its base parameters for these sensors.
        sensors: What is measured.
        gravity: Acceleration of gravity as `base_wrench_regressor` takes it, m/s² (3,).
        motion: Motion of the base, None at rest.
        rate: Samples per second.
        time: Sample times, s (N,).
        states: Joint coordinates, velocities and accelerations.
        frame: Pose of the frame in which the wrench is written, the ground sensor's (4, 4).
        wrench: Total wrench in that frame, NaN in channels that are not measured (N, 6).
        channels: Names of the C channels that are fitted: measured components of the wrench, then joint torques.
        measured: Their measurements (N, C).
        Y: Their regressor of φ and of the drives (N, C, 10 b + d).
        drives: Names of the d columns of friction and rotor inertia.
        log: The log as it was read.
        cutoff: Cut-off of the low-pass, Hz; None where the log's own derivatives were taken.
        edge: Samples left out at either end, where the filter settles.
        notes: What was detected and done.
        stuck: Channels left out because they never change, though the model says that they do, with their values.
    """

    tree: Tree
    prior: np.ndarray
    base: BaseParameters
    sensors: Sensors
    gravity: np.ndarray
    motion: BaseMotion | None
    rate: float
    time: np.ndarray
    states: tuple[np.ndarray, np.ndarray, np.ndarray]
    frame: np.ndarray
    wrench: np.ndarray
    channels: tuple[str, ...]
    measured: np.ndarray
    Y: np.ndarray
    drives: tuple[str, ...]
    log: Recording
    cutoff: float | None
    edge: int
    notes: tuple[str, ...]
    stuck: tuple[str, ...]

    @property
    def reduced(self) -> np.ndarray:
        """Columns of the base parameters and the drives (N, C, r + d)."""
        P = len(self.base.parameters)
        return np.concatenate([self.base.reduce(self.Y[..., :P]), self.Y[..., P:]], axis=2)


def prepare(
    source: Path,
    log_path: Path,
    *,
    base: str | None = None,
    columns: Path | None = None,
    cutoff: str | float | None = None,
    drive: tuple[str, ...] = (),
    ignore: tuple[str, ...] = (),
    fix: Mapping[str, Sequence[float]] | None = None,
    limit: int = LIMIT,
) -> Prepared:
    """Reads a model and a log.

    Args:
        source: MJCF or URDF file.
        log_path: CSV or npz file.
        base: Body whose frame is {0}, by default the world.
        columns: Mapping of the log's columns.
        cutoff: Cut-off of the low-pass in Hz, `auto`, or None for the log's own velocities and accelerations.
        drive: Friction and rotor columns for joint torques.
        ignore: Equality constraints and tendons to leave out.
        fix: Joints that do not move and are not in the log, as for `tree_from_model`.
        limit: Bytes that a npz file may take in memory.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    model = compiled(source)
    tree = tree_from_model(model, base, ignore=ignore, fix=fix)
    prior, gravity = parameters_from_model(model, base), gravity_in_base(model, base)
    log = read_log(log_path, Mechanism(tree, gravity, prior), columns, limit=limit)
    rate = log.rate
    log, notes = _without_spikes(log, tree.joints)
    still = {name.format(joint) for joint in fix or () for names in KINDS.values() for name in names}
    if unread := [name for name in log.unused if name in still]:
        notes.append(f"Columns of joints that --fix holds still were not read: {', '.join(unread)}.")
    log, constant = _without_constant(log, tree.joints)
    cutoff = _cutoff(log, tree.joints, cutoff)
    states = _states(log, tree.joints, cutoff)
    motion = None if log.base is None else base_motion_from_poses(log.base, rate, cutoff)
    frame, wrench = _wrench(tree, log, states[0], rate, cutoff)
    torques = log.torques(tree.joints)
    torques = torques if torques is None or cutoff is None else low_pass(torques, rate, cutoff)

    known = np.isfinite(wrench).all(axis=0)
    to_sensor = coAd(inverse(frame))
    Y = to_sensor @ base_wrench_regressor(tree, *states, gravity=gravity, base=motion)
    predicted = dict(zip(COMPONENTS, (Y @ prior).T, strict=True))
    Y = Y[:, known]
    measured, names = wrench[:, known], [c for c, k in zip(COMPONENTS, known, strict=True) if k]
    drives: tuple[str, ...] = ()
    there = np.zeros(0, dtype=bool) if torques is None else np.isfinite(torques).all(axis=0)
    if drive and not there.any():
        notes.append(f"The log has no joint torques for the drive columns {', '.join(drive)}.")
    if torques is not None:
        Y_joint = joint_torque_regressor(tree, *states, gravity=gravity, base=motion, drive=drive)
        predicted |= dict(zip(tree.freedoms, (Y_joint[..., : len(prior)] @ prior).T, strict=True))
    if torques is not None and there.any():
        Y_joint = Y_joint[:, there]
        check_torques(model, mechanism_bodies(model, base), ignore, np.array(tree.joints)[there].tolist())
        drives = drive_names(tree, drive)
        Y = np.concatenate([np.pad(Y, ((0, 0), (0, 0), (0, len(drives)))), Y_joint], axis=1)
        measured = np.concatenate([measured, torques[:, there]], axis=1)
        names += [name for name, k in zip(tree.freedoms, there, strict=True) if k]
    if not names and constant:
        raise InputError(
            f"Every measured channel of {log_path} is constant ({', '.join(constant)}); nothing is to fit."
        )
    if not names:
        raise InputError(
            f"{log_path} has neither a wrench nor a joint torque to fit. {suggested_mapping(log.unused, tree.joints)}"
        )
    stuck = _stuck(constant, predicted, notes)
    seen = to_sensor[known] if known.any() else None
    sensors = Sensors(bool(known.any()), len(names) > known.sum(), motion is not None, seen)
    found = find_base_parameters(tree, gravity=gravity, sensors=sensors)
    notes += _hidden(tree, gravity, sensors, found, names)
    notes += [found.remark] if found.remark else []
    P = len(found.parameters)
    separable = independent(found.reduce(Y[..., :P]), Y[..., P:])
    if len(separable) < len(drives):
        lost = [name for k, name in enumerate(drives) if k not in separable]
        notes.append(f"{', '.join(lost)} cannot be told from the links' inertias, which take them up.")
        drives = tuple(drives[k] for k in separable)
        Y = np.concatenate([Y[..., :P], Y[..., P:][..., separable]], axis=2)
    return Prepared(
        tree=tree,
        prior=prior,
        base=found,
        sensors=sensors,
        gravity=gravity,
        motion=motion,
        rate=rate,
        time=log.time,
        states=states,
        frame=frame,
        wrench=wrench,
        channels=tuple(names),
        measured=measured,
        Y=Y,
        drives=drives,
        log=log,
        cutoff=cutoff,
        edge=0 if cutoff is None else settling(rate, cutoff),
        notes=(*log.notes, *notes),
        stuck=stuck,
    )


def base_motion_from_poses(T: np.ndarray, rate: float, cutoff: float | None) -> BaseMotion:
    """Motion of a base from its poses alone, low-passed and differentiated.

    Args:
        T: Poses in an inertial frame (N, 4, 4).
        rate: Samples per second.
        cutoff: Cut-off of the low-pass, Hz; without it `chosen_cutoff` of the positions and quaternions.
    """
    quaternion = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True)
    # Of the two quaternions of each rotation the one near the sample's before.
    flips = np.cumprod(np.sign((quaternion[1:] * quaternion[:-1]).sum(axis=1)))
    quaternion[1:] *= flips[:, None]
    x = np.hstack([T[:, :3, 3], quaternion])
    x, dx, ddx = smoothed(x, rate, cutoff or chosen_cutoff(x, rate))
    size = np.linalg.norm(x[:, 3:], axis=1, keepdims=True)
    turns, rates, accelerations = (part[:, 3:] / size for part in (x, dx, ddx))

    def twice_in_body(rate_of_change: np.ndarray) -> np.ndarray:
        """Vector part of `2 q⁻¹ q̇`: the angular velocity in the body's frame."""
        w, u = turns[:, :1], turns[:, 1:]
        s, v = rate_of_change[:, :1], rate_of_change[:, 1:]
        return 2 * (w * v - s * u - np.cross(u, v))

    position = np.hstack([x[:, :3], turns])
    velocity = np.hstack([dx[:, :3], twice_in_body(rates)])
    return BaseMotion.from_free_joint(position, velocity, np.hstack([ddx[:, :3], twice_in_body(accelerations)]))


def _without_spikes(log: Recording, joints: Sequence[str]) -> tuple[Recording, list[str]]:
    """The log with isolated gross outliers interpolated."""
    measured, notes = dict(log.measured), []
    for kind, symbol in zip(KINDS, ("q", "dq", "ddq", "torques"), strict=True):
        names = [name for name in (f"{joint}_{kind}" for joint in joints) if name in log.measured]
        values, counts = despiked(np.reshape([log[name] for name in names], (len(names), len(log.time))).T)
        measured |= zip(names, values.T, strict=True)
        if counts.any():
            notes.append(f"{counts.sum()} gross outliers in {symbol} were interpolated.")
    for name in log.wrenches:
        values, counts = despiked(log.wrench(name).values)
        measured |= {f"{name}_force": values[:, :3], f"{name}_torque": values[:, 3:]}
        if counts.any():
            parts = ", ".join(f"{n} in {c}" for n, c in zip(counts, COMPONENTS, strict=True) if n)
            notes.append(f"Gross outliers of the wrench '{name}' were interpolated: {parts}.")
    return replace(log, measured=measured), notes


def _without_constant(log: Recording, joints: Sequence[str]) -> tuple[Recording, dict[str, float]]:
    """The log without the ground's components and the joints' torques that never change, and these with their values.

    The noise of such a channel, by which others would be weighted, is zero.
    """
    constant: dict[str, float] = {}
    measured = dict(log.measured)

    def leave_out(channel: str, names: Sequence[str]) -> None:
        values = log[channel].reshape(len(log.time), -1)
        still = np.ptp(values, axis=0) == 0
        constant.update((name, float(x) + 0.0) for name, x, s in zip(names, values[0], still, strict=True) if s)
        measured[channel] = np.where(still, np.nan, values).reshape(log[channel].shape)

    if GROUND in log.wrenches:
        leave_out(f"{GROUND}_force", COMPONENTS[:3])
        leave_out(f"{GROUND}_torque", COMPONENTS[3:])
    for joint in joints:
        if f"{joint}_torque" in log.measured:
            leave_out(f"{joint}_torque", (joint,))
    return replace(log, measured=measured), constant


def _stuck(constant: dict[str, float], predicted: dict[str, np.ndarray], notes: list[str]) -> tuple[str, ...]:
    """Those of the constant channels that the model says change; a note on the others."""
    largest = max((np.abs(x).max() for x in predicted.values()), default=0.0)
    stuck = [name for name in constant if np.ptp(predicted[name]) > 1e-6 * largest]
    still = [name for name in constant if name not in stuck]
    if still:
        notes.append(f"{', '.join(still)} never change, nor do they by the model, and are left out.")
    return tuple(f"{name} ({constant[name]:g})" for name in stuck)


def _hidden(tree: Tree, gravity: np.ndarray, sensors: Sensors, found: BaseParameters, channels: list[str]) -> list[str]:
    """A note on what the missing components of the wrench keep out of sight."""
    if not sensors.base_wrench:
        return []
    every = find_base_parameters(tree, gravity=gravity, sensors=replace(sensors, channels=None)).rank
    if every == found.rank:
        return []
    return [
        f"{every - found.rank} of {every} base parameters cannot be seen in {', '.join(channels)}, whatever the "
        "motion; they take the other components of the wrench."
    ]


def _has_rates(log: Recording, joints: Sequence[str]) -> bool:
    """Whether there are velocities and accelerations, which a log has of all joints or of none."""
    return any(f"{joint}_velocity" in log.measured and f"{joint}_acceleration" in log.measured for joint in joints)


def _cutoff(log: Recording, joints: Sequence[str], cutoff: str | float | None) -> float | None:
    if cutoff is None and _has_rates(log, joints):
        return None
    if cutoff is None or cutoff == "auto":
        if not joints:
            raise InputError("Nothing moves on this base: name another one (--base), or a cut-off in Hz (--cutoff).")
        return chosen_cutoff(log.of_joints(joints, "position"), log.rate)
    try:
        value = float(cutoff)
    except ValueError:
        value = np.nan
    if not 0 < value < log.rate / 2:
        raise InputError(
            f"A cut-off is 'auto' or from 0 to {log.rate / 2:g} Hz, half the sampling rate, got '{cutoff}'."
        )
    return value


def _states(log: Recording, joints: Sequence[str], cutoff: float | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if cutoff is not None:
        return smoothed(log.of_joints(joints, "position"), log.rate, cutoff)
    return log.joint_states(joints)


def _wrench(
    tree: Tree, log: Recording, q: np.ndarray, rate: float, cutoff: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the ground sensor's frame, and the total wrench in it (Eq. 17); on a moving base of contacts alone."""
    ground = log.wrench(GROUND) if GROUND in log.wrenches else None
    contacts = [log.wrench(name) for name in log.wrenches if name != GROUND]
    if ground is None and log.base is None and not contacts:
        return np.eye(4), np.full((len(q), 6), np.nan)
    if ground is None and log.base is None:
        raise InputError("On a base at rest the wrench 'ground' has to be measured besides the contacts'.")
    total = total_wrench(tree, q, ground, contacts)
    return total.frame, total.values if cutoff is None else low_pass(total.values, rate, cutoff)
