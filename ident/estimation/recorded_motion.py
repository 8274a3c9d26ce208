"""Motion from coordinates and their derivatives, a recording's own or low-passed ones, and poses of tracked bodies.

    pose        F⁻¹ T_body(q) M
    channels    p,        r - ½ (E - Eᵀ)∨,        E = Rᵀ_measured R,        to be compared with measured p and r

F is the frame of the tracker, M that of the markers on the body, and r any measure of the orientation: only the turn E
between the measured and the predicted one matters.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.estimation.setup_parameters import TRACKER
from ident.geometry.se3 import continuous_quaternions, inverse, pose, turning, without_jumps
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff, smoothed
from ident.recordings.times import Sampled, side_by_side
from ident.tolerances import LEAST_SAMPLES

Smoother = Callable[[np.ndarray, float, float], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Function of samples (N, k), their rate and a cut-off, Hz, that returns them smoothed and their derivatives."""

USUAL = 0.1
"""Default cut-off over the sampling rate, for the first estimate of motions for which none can be chosen."""

WIDTH = 6
"""Channels of a tracked body; its measured orientation, rotation matrix and r, has twice as many numbers."""

ALIGNED = 100
"""Approximate number of samples by which unknown frames are aligned: a start, as they are estimated from all."""

UNIT = 0.01
"""Largest deviation of a quaternion's norm from 1."""


def joint_states(tree: Tree, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint coordinates, velocities and accelerations from coordinates and their derivatives (3, …, n_q)."""
    velocities, accelerations = [], []
    for body, *own in zip(tree.bodies, *(tree.body_coordinates(x) for x in states), strict=True):
        rates = turning(np.array(own)) if body.is_ball else own[1:]
        velocities.append(rates[0])
        accelerations.append(rates[1])
    return states[0], np.concatenate(velocities, axis=-1), np.concatenate(accelerations, axis=-1)


def base_motion(states: np.ndarray) -> BaseMotion:
    """Motion of a base from its position and quaternion and their derivatives (3, …, 7)."""
    w, dw = turning(states[..., 3:])
    velocity, acceleration = (np.concatenate([states[d, ..., :3], x], axis=-1) for d, x in ((1, w), (2, dw)))
    return BaseMotion.from_free_joint(states[0], velocity, acceleration)


def base_motion_from_poses(
    T: np.ndarray, rate: float, cutoff: float | None, smoother: Smoother = smoothed
) -> BaseMotion:
    """Motion of a base from its poses alone, smoothed and differentiated.

    Args:
        T: Poses in an inertial frame (N, 4, 4).
        rate: Samples per second.
        cutoff: Cut-off, Hz; None for `chosen_cutoff` of the positions and quaternions.
        smoother: Function that smooths, by default a low-pass.
    """
    x = base_coordinates(T)
    return base_motion(np.stack(smoother(x, rate, cutoff or chosen_cutoff(x, rate))))


def base_coordinates(T: np.ndarray) -> np.ndarray:
    """Positions and quaternions without jumps of sign of poses (N, 4, 4), NaN where one is missing (N, 7)."""
    there, out = np.isfinite(T).all(axis=(1, 2)), np.full((len(T), 7), np.nan)
    out[there] = np.hstack([T[there, :3, 3], continuous_quaternions(T[there, :3, :3])])
    return out


_CHOSEN = WeakKeyDictionary[Recording, dict[tuple[str, ...], float]]()


def usual_cutoff(recording: Recording, joints: Sequence[str]) -> float:
    """`chosen_cutoff` of the joints' coordinates, or those of a base alone, Hz, computed once for each recording.

    Raises:
        InputError: None can be chosen.
    """
    chosen, key = _CHOSEN.setdefault(recording, {}), tuple(joints)
    if key not in chosen:
        moving = recording.base if not joints else None
        states = coordinates(recording, joints) if moving is None else base_coordinates(moving)
        chosen[key] = chosen_cutoff(states, recording.rate)
    return chosen[key]


def motion_cutoff(
    recording: Recording, joints: Sequence[str], cutoff: str | float | None, filters: bool
) -> float | None:
    """Cut-off of the low-pass of a recording's states, Hz; None for its own velocities and accelerations.

    Args:
        recording: The recording.
        joints: Names of its joints.
        cutoff: As for `ident.estimation.preparation.prepared`, also `filters`.
        filters: True if the estimator fits low-passed samples.

    Raises:
        InputError: None can be chosen, or it is out of range.
    """
    # A recording has velocities and accelerations of all joints or of none.
    rates = any({f"{joint}_velocity", f"{joint}_acceleration"} <= recording.measured.keys() for joint in joints)
    if recording.still or (cutoff is None and rates):
        return None
    if cutoff is None or cutoff == "auto":
        if not joints and recording.base is None:
            raise InputError("Nothing moves on this base: name another one (--base), or a cut-off in Hz (--cutoff).")
        try:
            return usual_cutoff(recording, joints)
        except InputError:
            if filters:
                raise
            if (samples := len(recording.time)) < LEAST_SAMPLES:
                message = f"An identification needs at least {LEAST_SAMPLES} samples, got {samples}."
                raise InputError(message) from None
            return USUAL * recording.rate
    try:
        value = float(cutoff)
    except (ValueError, OverflowError):
        value = np.nan
    if not 0 < value < recording.rate / 2:
        raise InputError(
            f"A cut-off is 'auto' or from 0 to {recording.rate / 2:g} Hz, half the sampling rate, got '{cutoff}'."
        )
    return value


def recorded_motion(
    mechanism: Mechanism, recording: Recording, cutoff: float | None, smoother: Smoother = smoothed
) -> Motion:
    """Motion of the joints, and of a base on a carrier or tracked, smoothed by a low-pass or another function."""

    def states(tree: Tree) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if recording.still:
            none = np.zeros((len(recording.time), len(tree.freedoms)))
            return coordinates(recording, tree.joints), none, none
        if cutoff is None:
            return recording.joint_states(tree.joints)
        return joint_states(tree, np.stack(smoother(coordinates(recording, tree.joints), recording.rate, cutoff)))

    base, none = None, np.zeros((len(recording.time), 6))
    if recording.base is not None:
        T, rate = recording.base, recording.rate
        base = BaseMotion(T, none, none) if recording.still else base_motion_from_poses(T, rate, cutoff, smoother)
    if mechanism.carrier is not None:
        base = mechanism.carrier.motion(*states(mechanism.carrier.tree))
    return Motion(*states(mechanism.tree), base)


def coordinates(recording: Recording, joints: Sequence[str]) -> np.ndarray:
    """Joint coordinates, quaternions without jumps of sign (N, n_q)."""
    columns = [recording[f"{joint}_position"] for joint in joints]
    continuous = [without_jumps(x) if x.ndim == 2 else x[:, None] for x in columns]
    return np.hstack([np.empty((len(recording.time), 0)), *continuous])


class Tracked(NamedTuple):
    """Tracked body with the frames of tracker and markers.

    Attributes:
        body: Index of the body.
        frame: Pose of the tracker's frame, as for `Tracker` (4, 4).
        markers: Pose of the markers' frame in the body's (4, 4).
        of_frame: Name of the tracker's frame in the set-up, of none that is stated.
    """

    body: int
    frame: np.ndarray
    markers: np.ndarray
    of_frame: str


def check_tracked(mechanism: Mechanism, recording: Recording, resting: Collection[str]) -> None:
    """Refuses tracked bodies that joints do not move, with too few poses, or with one pose while joints move them.

    Args:
        mechanism: The mechanism.
        recording: The recording.
        resting: Names of the joints that rest.
    """
    tree = mechanism.tree
    bodies = [tree.names[i] for i in sorted(tree.moved)]
    for name, tracker in recording.trackers.items():
        if tracker.body not in bodies:
            raise InputError(
                f"The tracker '{name}' needs a body that joints move, one of {', '.join(bodies)}; poses of the base "
                f"belong under [base] of the columns file. Got '{tracker.body}'."
            )
        position, orientation = f"{name}_position", f"{name}_orientation"
        for channel, size in ((position, 3), (orientation, 4)):
            if (shape := recording[channel].shape)[1:] != (size,):
                raise InputError(f"The tracker '{name}' needs a channel '{channel}' (N, {size}), got shape {shape}.")
        x = _of_tracked(recording, name).values
        norm, whole = np.linalg.norm(x[:, 3:], axis=1), x[np.isfinite(x).all(axis=1)]
        if (wrong := np.abs(norm - 1) > UNIT).any():
            at = int(wrong.argmax())
            raise InputError(f"'{orientation}' needs quaternions of norm 1; sample {at} has {norm[at]:.3g}.")
        moving = {tree.bodies[k].joint for k in tree.chain(tree.names.index(tracker.body)) if tree.bodies[k].moves}
        number = len(np.unique(whole, axis=0)) if moving - {*resting} else len(whole)
        if number < LEAST_SAMPLES:
            raise InputError(
                f"The tracked body '{name}' needs at least {LEAST_SAMPLES} poses, samples that have both {position} "
                f"and {orientation}, and different ones where joints move '{tracker.body}'; got {number}."
            )


def _of_tracked(recording: Recording, name: str) -> Sampled:
    """Positions and orientations of a tracked body, NaN where a sample is missing (N, 3 + 4)."""
    return side_by_side([recording.as_measured(f"{name}_{kind}") for kind in ("position", "orientation")])


def measured_poses(recording: Recording, name: str) -> Sampled:
    """Channels of a tracked body and its orientations, as for `reading`, NaN where a sample is missing (N, 6 + 12)."""
    time, x = _of_tracked(recording, name)
    there, values = np.isfinite(x).all(axis=1), np.full((len(x), 3 * WIDTH), np.nan)
    turned = Rotation.from_quat(x[there, 3:], scalar_first=True)
    r = (turned.mean().inv() * turned).as_rotvec()
    values[there] = np.hstack([x[there, :3], r, turned.as_matrix().reshape(-1, 9), r])
    return Sampled(time, values)


def reading(T: np.ndarray, references: np.ndarray) -> list:
    """Channels of a pose in the tracker's frame (4, 4), beside the measured orientation (12,)."""
    E = references[:9].reshape(3, 3).T @ T[:3, :3]
    turn = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]]) / 2
    return [*T[:3, 3], *(references[9:] + turn)]


def aligned(mechanism: Mechanism, recording: Recording, motion: Motion) -> dict[str, Tracked]:
    """Tracked bodies of a recording, with unknown frames aligned by the model's poses along a motion.

    They minimise `Σ ‖F⁻¹ T_body M - T_measured‖²`, from the best of the tracker's 24 turns by right angles. The best M
    for an F is the mean of `T_body⁻¹ F T_measured`.
    """
    # Few recordings have poses, and the import takes long.
    from scipy.optimize import least_squares

    tree, trackers = mechanism.tree, recording.trackers
    poses, base, pairs = tree.poses(motion.q), motion.base_poses, list[tuple[np.ndarray, np.ndarray]]()
    poses = poses if base is None else base[:, None] @ poses
    for name, tracker in trackers.items():
        kept = np.flatnonzero(recording.covered((f"{name}_position", f"{name}_orientation")))
        kept = kept[:: max(1, len(kept) // ALIGNED)]
        pairs.append((poses[kept, tree.names.index(tracker.body)], recording.poses(name)[kept]))

    def frames(x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Poses of tracker and markers of each body, from a rotation vector and a position of the tracker."""
        own = pose(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:])
        for each, (T, measured) in zip(trackers.values(), pairs, strict=True):
            F = own if each.frame is None else each.frame
            M = inverse(T) @ F @ measured
            mean = pose(Rotation.from_matrix(M[:, :3, :3]).mean().as_matrix(), M[:, :3, 3].mean(axis=0))
            yield F, mean if each.markers is None else each.markers

    def errors(x: np.ndarray) -> np.ndarray:
        each = zip(frames(x), pairs, strict=True)
        return np.concatenate([(inverse(F) @ T @ M - measured)[:, :3].ravel() for (F, M), (T, measured) in each])

    starts = (np.append(turn.as_rotvec(), np.zeros(3)) for turn in Rotation.create_group("O"))
    fits = [least_squares(errors, x, method="lm") for x in starts]
    solved = frames(min(fits, key=lambda fit: fit.cost).x)
    return {
        name: Tracked(tree.names.index(each.body), F, M, TRACKER if each.frame is None else "a stated frame")
        for (name, each), (F, M) in zip(trackers.items(), solved, strict=True)
    }
