"""A rigid body by its mass, centre of mass and inertia about that, with standard deviations."""

from typing import NamedTuple

import numpy as np

from ident.geometry.inertia import com_from_parameters

QUANTITIES = ("mass", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Quantities of a rigid body: mass in kg, centre of mass in m, inertia about the centre of mass in kg m²."""

SIZE = 0.1
"""Typical radius of gyration and distance of the centre of mass from the sensor, m."""


class RigidBody(NamedTuple):
    """A rigid body in some frame.

    Attributes:
        values: Mass, centre of mass, and inertia about it in the axes of the frame, as `QUANTITIES` (10,).
        std: Standard deviations from the noise (10,).
        std_setup: Standard deviations including those of set-up errors (10,).
        told: True for identifiable values (10,).
    """

    values: np.ndarray
    std: np.ndarray
    std_setup: np.ndarray
    told: np.ndarray


def described(phi: np.ndarray) -> np.ndarray:
    """φ of one body (10,) as `QUANTITIES` (10,)."""
    mass, com, inertia = com_from_parameters(phi)
    return np.array([mass, *com, *inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])
