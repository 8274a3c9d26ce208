"""Joint torques of the drives that a mechanism's model states."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from ident.estimation.equations import Equations
from ident.estimation.loads import SLIP
from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion


def stated_drive_torques(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Torques of rotors, friction and springs as the model states them, N m or N (N, n).

    Coulomb friction changes its sign as `tanh(q̇ / SLIP)`, so that noise of a resting joint's velocity is no friction.

    Args:
        mechanism: The mechanism, with its drives.
        motion: Motion of its joints, checked (N samples).
    """
    drives = [mechanism.drives.get(freedom, NO_DRIVE) for freedom in mechanism.tree.freedoms]

    def each(value: Callable[[Drive], float]) -> np.ndarray:
        return np.array([value(drive) for drive in drives], float)

    rotors = each(lambda drive: drive.all_rotor) * motion.ddq
    friction = each(lambda drive: drive.all_viscous) * motion.dq
    friction += each(lambda drive: drive.coulomb) * np.tanh(motion.dq / SLIP)
    return np.asarray(rotors + friction + each(lambda drive: drive.stiffness) * _stretched(mechanism, motion.q))


def stated_drive_channels(equations: Equations, motion: Motion) -> np.ndarray:
    """Part of the drives, as the model states them, in the channels of equations: zero in a wrench (N, C)."""
    out = np.zeros((len(motion), len(equations.channels)))
    if equations.torques and equations.mechanism.drives:
        torques = stated_drive_torques(equations.mechanism, motion)
        out[:, -len(equations.torques) :] = torques[:, list(equations.torques)]
    return out


def _stretched(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Coordinates of the freedoms from the references of their springs, zero for a ball without springs (N, n)."""
    tree, columns = mechanism.tree, [np.zeros((len(q), 0))]
    for body, own in zip(tree.bodies, tree.body_coordinates(q), strict=True):
        drives = [mechanism.drives.get(name, NO_DRIVE) for name in body.freedom_names]
        reference = np.array([drive.springref for drive in drives])
        if not any(drive.stiffness for drive in drives):
            columns.append(np.zeros((len(q), body.freedoms)))
        elif body.is_ball:
            turned = Rotation.from_rotvec(reference).inv() * Rotation.from_quat(own, scalar_first=True)
            columns.append(turned.as_rotvec())
        else:
            columns.append(own - reference)
    return np.hstack(columns)
