"""A user's model and log made ready to be fitted: one set of samples, channels and columns."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.base_parameters import BaseParameters, find_base_parameters
from ident.regressor import base_wrench_regressor, drive_names, joint_torque_regressor
from ident.robust import independent
from ident.se3 import coAd, inverse
from ident.structure import Sensors
from ident.tree import BaseMotion, Tree
from ident.wrench import Contact, total_wrench
from sim.despike import despiked
from sim.log import GROUND, Log, read_log
from sim.mujoco_model import compiled, gravity_in_base, parameters_from_model, tree_from_model
from sim.smoothing import chosen_cutoff, low_pass, settling, smoothed

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
    log: Log
    cutoff: float | None
    edge: int
    notes: tuple[str, ...]

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

    Raises:
        ValueError: Something is missing or does not fit; the message names it.
    """
    model = compiled(source)
    tree = tree_from_model(model, base, ignore=ignore)
    prior, gravity = parameters_from_model(model, base), gravity_in_base(model, base)
    joints = [tree.bodies[i] for i in tree.moving]
    log = read_log(
        log_path,
        tree.joints,
        tree.names,
        columns,
        slides=[body.joint for body in joints if not (body.is_ball or body.twist[3:].any())],
        balls=[body.joint for body in joints if body.is_ball],
        weight=float(prior.reshape(-1, 10)[:, 0].sum() * np.linalg.norm(gravity)),
    )
    rate = log.rate
    log, notes = _without_spikes(log)
    cutoff = _cutoff(log, rate, cutoff)
    states = _states(log, rate, cutoff)
    motion = None if log.base is None else base_motion_from_poses(log.base, rate, cutoff)
    frame, wrench = _wrench(tree, log, states[0], rate, cutoff)
    torques = None if log.torques is None else log.torques if cutoff is None else low_pass(log.torques, rate, cutoff)

    known = np.isfinite(wrench).all(axis=0)
    Y = base_wrench_regressor(tree, *states, gravity=gravity, base=motion)
    Y = (coAd(inverse(frame)) @ Y)[:, known]
    measured, names = wrench[:, known], [c for c, k in zip(COMPONENTS, known, strict=True) if k]
    drives: tuple[str, ...] = ()
    if drive and torques is None:
        notes.append(f"The log has no joint torques for the drive columns {', '.join(drive)}.")
    if torques is not None and np.isfinite(torques).all(axis=0).any():
        there = np.isfinite(torques).all(axis=0)
        Y_joint = joint_torque_regressor(tree, *states, gravity=gravity, base=motion, drive=drive)[:, there]
        drives = drive_names(tree, drive)
        Y = np.concatenate([np.pad(Y, ((0, 0), (0, 0), (0, len(drives)))), Y_joint], axis=1)
        measured = np.concatenate([measured, torques[:, there]], axis=1)
        names += [name for name, k in zip(tree.freedoms, there, strict=True) if k]
    if not names:
        raise ValueError(f"{log_path} has neither a wrench nor a joint torque to fit.")
    sensors = Sensors(bool(known.any()), len(names) > known.sum(), motion is not None)
    found = find_base_parameters(tree, gravity=gravity, sensors=sensors)
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


def _without_spikes(log: Log) -> tuple[Log, list[str]]:
    """The log with isolated gross outliers interpolated."""
    changes: dict[str, Any] = {}
    notes = []
    for name in ("q", "dq", "ddq", "torques"):
        if getattr(log, name) is not None:
            changes[name], counts = despiked(getattr(log, name))
            if counts.any():
                notes.append(f"{counts.sum()} gross outliers in {name} were interpolated.")
    wrenches = {}
    for name, wrench in log.wrenches.items():
        values, counts = despiked(wrench.values)
        wrenches[name] = replace(wrench, values=values)
        if counts.any():
            parts = ", ".join(f"{n} in {c}" for n, c in zip(counts, COMPONENTS, strict=True) if n)
            notes.append(f"Gross outliers of the wrench '{name}' were interpolated: {parts}.")
    return replace(log, wrenches=wrenches, **changes), notes


def _cutoff(log: Log, rate: float, cutoff: str | float | None) -> float | None:
    if cutoff is None and log.dq is not None and log.ddq is not None:
        return None
    if cutoff is None or cutoff == "auto":
        return chosen_cutoff(log.q, rate)
    try:
        value = float(cutoff)
    except ValueError:
        value = np.nan
    if not 0 < value < rate / 2:
        raise ValueError(f"A cut-off is 'auto' or from 0 to {rate / 2:g} Hz, half the sampling rate, got '{cutoff}'.")
    return value


def _states(log: Log, rate: float, cutoff: float | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if cutoff is not None:
        return smoothed(log.q, rate, cutoff)
    if log.dq is None or log.ddq is None:
        raise ValueError("Without a cut-off the log has to have joint velocities and accelerations.")
    return log.q, log.dq, log.ddq


def _wrench(tree: Tree, log: Log, q: np.ndarray, rate: float, cutoff: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the ground sensor's frame, and the total wrench in it (Eq. 17); on a moving base of contacts alone."""
    moved = None if log.base is None else log.base
    ground = log.wrenches.get(GROUND)
    frame = np.eye(4) if ground is None else ground.pose
    contacts = []
    for name, wrench in log.wrenches.items():
        if name == GROUND:
            continue
        if not np.isfinite(wrench.values).all():
            raise ValueError(
                f"The wrench '{name}' on '{wrench.body}' needs all six components; only the ground's may lack some."
            )
        make = Contact.applied_to_link if wrench.applied_to_link else Contact
        contacts.append(make(str(wrench.body), wrench.values, wrench.pose))
    if ground is None and moved is None and not contacts:
        return frame, np.full((len(q), 6), np.nan)
    if ground is None and moved is None:
        raise ValueError("On a base at rest the wrench 'ground' has to be measured besides the contacts'.")
    others = total_wrench(tree, q, None, contacts).wrench
    total = (coAd(inverse(frame)) @ others[..., None])[..., 0]
    if ground is not None:
        total = total + (ground.values if ground.applied_to_link else -ground.values)
    return frame, total if cutoff is None else low_pass(total, rate, cutoff)
