"""Loads that the model lacks, as an explanation of torques that are much larger than the model's."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ident.mechanism.mechanism import Mechanism

FAR_BETTER = 0.5
"""Squared residual of one explanation over that of another below which it is far better. On simulated arms of seven
joints it is below 0.1 with loads, and from 0.9 up with factors of units and gears."""


@dataclass(frozen=True)
class TorqueLoad:
    """Load on a body of the model that explains the torques best.

    Attributes:
        body: The body's name.
        mass: Mass of the load over that of all bodies of the model.
        against_factors: Squared residual with it over that with a factor on each torque instead.
    """

    body: str
    mass: float
    against_factors: float

    @property
    def better(self) -> bool:
        """True if it explains the torques far better than factors do, and is no heavier than the model."""
        return self.possible and abs(self.mass) < 1 and self.against_factors < FAR_BETTER

    @property
    def possible(self) -> bool:
        """True if factors do not explain the torques far better than it does."""
        return self.against_factors < 1 / FAR_BETTER


def best_load(
    mechanism: Mechanism,
    measured: np.ndarray,
    predicted: np.ndarray,
    columns: Iterable[np.ndarray],
    uncertain: np.ndarray,
) -> TorqueLoad:
    """The load that leaves the smallest residual, each torque weighted by its prediction's uncertainty.

    Args:
        mechanism: The mechanism.
        measured: Torques (N, n).
        predicted: Predicted torques (N, n).
        columns: Torques of unit parameters φ of each body (N, n, 10).
        uncertain: Norm of each prediction's uncertainty (n,).
    """
    weight = 1 / np.maximum(uncertain, 1e-300)
    gains = (measured * predicted).sum(axis=0) / np.maximum((predicted**2).sum(axis=0), 1e-300)
    by_factors = max(float((((measured - gains * predicted) * weight) ** 2).sum()), 1e-300)
    whole = max(float(mechanism.known[::10].sum()), 1e-300)
    left, candidates = ((measured - predicted) * weight).ravel(), []
    for k, each in enumerate(columns):
        rows = (each * weight[:, None]).reshape(-1, 10)
        norms = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        phi = np.linalg.lstsq(rows / norms, left, rcond=1e-8)[0] / norms
        residual = float(((left - rows @ phi) ** 2).sum())
        name = mechanism.tree.names[mechanism.tree.inertial[k]]
        candidates.append(TorqueLoad(name, float(phi[0]) / whole, residual / by_factors))
    return min(candidates, key=lambda each: each.against_factors)
