"""Channels as a model predicts them, with its bodies and the drives that it states."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.loads import SLIP
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.axes import Axes
from ident.model.regressor import CHUNK, base_wrench_regressor, drive_signals, joint_torque_regressor


def stated_drive_torques(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Torques of rotors, friction and springs as the model states them, N m or N (N, n).

    Coulomb friction changes its sign as `tanh(q̇ / SLIP)`, so that noise of a resting joint's velocity is no friction.

    Args:
        mechanism: The mechanism, with its drives.
        motion: Motion of its joints, checked (N samples).
    """
    tree = mechanism.tree
    drives = [mechanism.drives.get(freedom, NO_DRIVE) for freedom in tree.freedoms]
    signals = drive_signals(tree, Axes.of(tree), *motion.states, SLIP, mechanism.springrefs)
    values, at = {kind: np.array([each.value(kind) for each in drives], float) for kind in signals}, 0
    for body, own in zip(tree.bodies, tree.body_coordinates(motion.q), strict=True):
        part = slice(at, at := at + body.freedoms)
        if body.is_ball and values["spring"][part].any():
            reference = Rotation.from_rotvec(mechanism.springrefs[part])
            turned = reference.inv() * Rotation.from_quat(own, scalar_first=True)
            signals["spring"][:, part] = turned.as_rotvec()
    return np.sum([values[kind] * signal for kind, signal in signals.items()], axis=0)


def stated_drive_channels(equations: Equations, motion: Motion) -> np.ndarray:
    """Part of the drives, as the model states them, in the channels of equations: zero in a wrench (N, C)."""
    out = np.zeros((len(motion), len(equations.channels)))
    if equations.torques and equations.mechanism.drives:
        torques = stated_drive_torques(equations.mechanism, motion)
        out[:, -len(equations.torques) :] = torques[:, list(equations.torques)]
    return out


def predicted_channels(
    mechanism: Mechanism, motion: Motion, frame: np.ndarray, *, torques: bool = False
) -> dict[str, np.ndarray]:
    """Components of the total wrench in a frame, and joint torques if requested, as the model predicts them (N,) each.

    It predicts with its prior and with the drives that it states.
    """
    in_frame = coAd(inverse(frame))
    wrenches, felt = [], []
    for first in range(0, len(motion), CHUNK):
        part = motion[first : first + CHUNK]
        given: dict[str, Any] = {"gravity": mechanism.gravity, "base": part.base}
        Y = base_wrench_regressor(mechanism.tree, *part.states, **given)
        wrenches.append(Y @ mechanism.known @ in_frame.T)
        if torques:
            links = joint_torque_regressor(mechanism.tree, *part.states, **given) @ mechanism.known
            felt.append(links + stated_drive_torques(mechanism, part) if mechanism.drives else links)
    predicted = dict(zip(COMPONENTS, np.concatenate(wrenches).T, strict=True))
    return predicted | (dict(zip(mechanism.tree.freedoms, np.concatenate(felt).T, strict=True)) if torques else {})
