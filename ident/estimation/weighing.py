"""Mass and mounting of a wrench sensor on a rotating body, with the load as a point mass.

    F = o_F - m R g        M = o_M + g × m c        in the sensor's axes, g gravity less its acceleration

R is the identity if the sensor's axes are as stated; any other rotation is estimated in closed form (Kabsch, Acta
Cryst. A32, 1976, doi:10.1107/S0567739476001873).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ExcitationError
from ident.geometry.se3 import hat

TURNS_LEAST = 0.05
"""Standard deviation of gravity's direction in the sensor, over all axes, above which weight and offsets separate."""

TURNED, BETTER = np.radians(10), 0.7
"""Rotation of a sensor's axes from which it is an error, and the largest part of the forces' residual that may remain
with it."""


@dataclass(frozen=True, eq=False)
class Weighing:
    """Mass and first moments in the sensor's frame, and its mounting.

    Attributes:
        mass: Mass, kg.
        std: Standard deviation of the mass, kg.
        moment: First moments `m c`, kg m (3,).
        rotation: Rotation of the stated axes that fits the forces best, identity unless clearly better (3, 3).
        opposite: True if the forces have the opposite sign.
    """

    mass: float
    std: float
    moment: np.ndarray
    rotation: np.ndarray
    opposite: bool

    @property
    def angle(self) -> float:
        """Angle of the rotation, rad."""
        return float(Rotation.from_matrix(self.rotation).magnitude())


def weighed(wrench: np.ndarray, gravity: np.ndarray) -> Weighing:
    """Estimates mass, first moments and mounting from the wrench on a sensor's load.

    Args:
        wrench: Measured wrench of the sensor on its load, N and N m (N, 6).
        gravity: Acceleration of gravity less that of the sensor, in its axes, m/s² (N, 3).

    Raises:
        ExcitationError: Gravity hardly changes its direction in the sensor, so that weight and offset do not separate.
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    g, f = gravity - gravity.mean(axis=0), force - force.mean(axis=0)
    size = np.linalg.norm(gravity, axis=1).mean()
    if not size or np.sqrt((g**2).sum(axis=1).mean()) < TURNS_LEAST * size:
        raise ExcitationError(
            "The sensor keeps its direction to gravity, so that what it carries cannot be told from its offsets; turn "
            "it further, about more than one axis."
        )
    total = (g**2).sum()
    mass = -float((f * g).sum() / total)
    left = f + mass * g
    std = float(np.sqrt((left**2).mean() / total))
    across = hat(gravity)
    design = np.concatenate([across, np.broadcast_to(np.eye(3), across.shape)], axis=2).reshape(-1, 6)
    first = np.linalg.lstsq(design, moment.ravel(), rcond=1e-9)[0]
    rotation, opposite = _turned(f, g, left)
    return Weighing(mass, std, first[:3], rotation, opposite)


def _turned(f: np.ndarray, g: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, bool]:
    """Rotation, and True for the opposite sign, with which forces fit gravity clearly better; else the identity."""
    best, out = BETTER**2 * (left**2).sum(), (np.eye(3), bool((f * g).sum() > 0))
    for opposite in (False, True):
        R = Rotation.align_vectors(f if opposite else -f, g)[0].as_matrix()
        along = g @ R.T
        mass = (f * along).sum() / (along**2).sum()
        squares = ((f - mass * along) ** 2).sum()
        if squares < best:
            best, out = squares, (R, opposite)
    return out
