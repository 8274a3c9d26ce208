"""Motion from coordinates and their derivatives: a recording's own, or low-passed ones at a chosen cut-off."""

from collections.abc import Callable, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from ident.errors import InputError
from ident.geometry.se3 import continuous_quaternions, turning, without_jumps
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from ident.recordings.smoothing import PADDING, chosen_cutoff, smoothed

Smoother = Callable[[np.ndarray, float, float], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Function of samples (N, k), their rate and a cut-off, Hz, that returns them smoothed and their derivatives."""

USUAL = 0.1
"""Default cut-off over the sampling rate, for the first estimate of motions for which none can be chosen."""


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
    """Positions and quaternions without jumps of sign (N, 7) of poses (N, 4, 4)."""
    return np.hstack([T[:, :3, 3], continuous_quaternions(T[:, :3, :3])])


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
            if (samples := len(recording.time)) <= PADDING:
                message = f"An identification needs more than {PADDING} samples, got {samples}."
                raise InputError(message) from None
            return USUAL * recording.rate
    try:
        value = float(cutoff)
    except ValueError:
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
