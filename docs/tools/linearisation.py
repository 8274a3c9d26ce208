"""One linearisation of the trajectory estimate: a tree of 29 joints with torques, with and without its structure."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from docs.tools.mechanisms import humanoid
from ident.estimation.equations import Equations
from ident.estimation.measurement import Measurement
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.model.regressor import drive_names
from ident.parameters.base_parameters import STANDARD_GRAVITY, find_base_parameters
from ident.parameters.structure import Sensors
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.fit.piece import Noise, Piece, Predictor
from ident.trajectory.fit.piece_equations import Linearised, linearised

STEP, PER_KNOT = 0.01, 5
"""Time between samples, s, and samples between knots."""

DRIVES = "rotor", "viscous", "coulomb"
"""Kinds of the drives' columns."""


@dataclass(frozen=True, eq=False)
class _Dense:
    """Measurement whose channels are taken to depend on all coordinates and parameters."""

    measurement: Measurement

    def __getattr__(self, name: str) -> Any:
        return getattr(self.measurement, name)

    def dependence(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Masks of ones."""
        of_states, of_theta = self.measurement.dependence(columns)
        return np.ones_like(of_states), np.ones_like(of_theta)


def ways(samples: int) -> tuple[Callable[[], Linearised], Callable[[], Linearised]]:
    """Linearisation of a recording with the structure of the tree, and without it."""
    measurement = torques_of(humanoid())
    rng = np.random.default_rng(0)
    n, channels, p = measurement.coordinates, len(measurement.equations.channels), len(measurement.names)
    time = STEP * np.arange(samples)
    spline = Spline.over(time[0], time[-1], STEP * PER_KNOT)
    coefficients, theta, wrenches = rng.normal(size=(spline.size, n)), rng.normal(size=p), np.zeros((samples, 2, 0))
    noise = Noise(
        states=np.full((3, n), 0.01),
        channels=np.full(channels, 5.0),
        jerk=np.full(n, 1e-3),
        states_rho=np.full((3, n), 0.5),
        channels_rho=np.full(channels, 0.5),
        floor_states=np.zeros((3, n)),
        floor_channels=np.zeros(channels),
    )
    x = spline.evaluate(coefficients, time)[:3]
    measured = measurement.values(x, wrenches, theta).T + 5 * rng.normal(size=(samples, channels))
    piece = Piece(spline, time, (x[0] + 0.01 * rng.normal(size=(samples, n)), None, None), time, measured, wrenches)

    def way(predictor: Predictor) -> Callable[[], Linearised]:
        root = 0.1 * np.eye(p)
        return partial(linearised, predictor, piece, coefficients, theta=theta, noise=noise, root=root)

    return way(measurement), way(_Dense(measurement))


def torques_of(tree: Tree) -> Measurement:
    """Measurement of the torques of all joints of a tree on a base at rest, with drives and offsets."""
    mechanism = Mechanism(tree, STANDARD_GRAVITY, np.random.default_rng(1).normal(size=10 * len(tree.inertial)))
    joints = tree.freedoms
    parameters = find_base_parameters(mechanism, sensors=Sensors(base_wrench=False, joint_torques=True))
    equations = Equations(
        mechanism,
        parameters,
        torques=tuple(range(len(joints))),
        channels=tuple(f"torque({joint})" for joint in joints),
        drives=drive_names(tree, DRIVES),
        offsets=tuple(range(len(joints))),
    )
    return Measurement(equations, np.eye(4), (), {}, ())
