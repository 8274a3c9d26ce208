"""A rigid body by its mass, its centre of mass and its inertia about that, and how well each is known."""

from typing import NamedTuple

import numpy as np

from ident.geometry.inertia import com_from_parameters

QUANTITIES = ("mass", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""What rigid bodies are described by: kg, m of the centre of mass, kg m² about the centre of mass."""

SIZE = 0.1
"""Radius of gyration, m, and distance of the centre of mass from where it is weighed, that are taken for likely."""


class RigidBody(NamedTuple):
    """A rigid body in some frame.

    Attributes:
        values: Mass, centre of mass, and inertia about it in the axes of the frame, as `QUANTITIES` (10,).
        std: Standard deviations from the noise (10,).
        std_setup: The same with what is left open of the set-up (10,).
        told: Which of the values the data tell (10,).
    """

    values: np.ndarray
    std: np.ndarray
    std_setup: np.ndarray
    told: np.ndarray


def described(phi: np.ndarray) -> np.ndarray:
    """φ of one body (10,) as `QUANTITIES` (10,)."""
    mass, com, inertia = com_from_parameters(phi)
    return np.array([mass, *com, *inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])
