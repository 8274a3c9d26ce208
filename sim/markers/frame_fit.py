"""Least-squares fit of one posture of a model to the positions of its markers.

    min over q of  Σ_m w_m |x_m - p_m(q)|²

by the Levenberg-Marquardt method with MuJoCo's Jacobians. Damping keeps coordinates that the markers do not determine.
At convergence the gradient is zero, so that damping causes no bias.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from sim.markers.kinematics import Kinematics

ROUNDS = 100
"""Largest number of steps; most are needed if a posture is far from the initial guess."""

SETTLED = 1e-7
"""Step in rad or m at which the fit has converged; the next step would be far smaller."""

GAIN = 1e-10
"""Relative decrease of the cost below which the fit has converged: the remaining error is a hundred-thousandth of a
standard deviation."""

LEAST, MOST = 1e-9, 1e6
"""Range of the damping, m²/rad²: the least keeps normal equations solvable, beyond the most no step lowers the cost."""

LONGEST = 0.5
"""Longest step of a degree of freedom in rad or m; beyond it the positions are not linear."""


class Posture(NamedTuple):
    """A fitted posture.

    Attributes:
        qpos: Coordinates (nq,).
        residual: Measured less fitted positions, NaN where a marker is missing (M, 3).
        cost: Weighted sum of squares, m².
    """

    qpos: np.ndarray
    residual: np.ndarray
    cost: float


def fitted(
    kinematics: Kinematics, qpos: np.ndarray, measured: np.ndarray, weights: np.ndarray, rounds: int = ROUNDS
) -> Posture:
    """Posture that fits best, from an initial guess.

    Args:
        kinematics: Kinematics of the model.
        qpos: Initial guess (nq,).
        measured: Positions, NaN where a marker is missing, m (M, 3).
        weights: Weights of squared distances, zero for missing markers (M,).
        rounds: Largest number of steps.
    """
    visible, damping = np.flatnonzero(weights > 0), LEAST
    w, x = weights[visible, None], measured[visible]
    now = Posture(qpos, measured - kinematics.positions(qpos), 0.0)
    now = now._replace(cost=_cost(w, now.residual[visible]))
    for _ in range(rounds):
        J = kinematics.jacobian()[visible]
        normal, gradient = normal_equations(J, w, now.residual[visible])
        while True:
            step = _step(normal, gradient, damping)
            size = float(np.abs(step).max(initial=0.0))
            trial = kinematics.moved(now.qpos, step)
            residual = x - kinematics.positions(trial)[visible]
            cost = _cost(w, residual)
            if cost <= now.cost or size < SETTLED or damping > MOST:
                break
            damping *= 10
        damping = max(damping / 10, LEAST)
        gain = now.cost - cost
        if gain >= 0:
            now = Posture(trial, measured - kinematics.positions(trial), cost)
        if size < SETTLED or damping > MOST / 10 or 0 <= gain <= GAIN * cost:
            break
    return now


def normal_equations(J: np.ndarray, w: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`JᵀWJ` (n, n) and `JᵀWr` (n,) of markers (M, 3, n), their weights (M, 1) and residuals (M, 3)."""
    rows = J.reshape(-1, J.shape[-1])
    weighted = (np.repeat(w, 3)[:, None] * rows).T
    return weighted @ rows, weighted @ residual.ravel()


def _step(normal: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    damped = normal.copy()
    damped.flat[:: len(normal) + 1] += damping
    _, step, fault = lapack.dposv(damped, gradient)
    if fault:
        step = np.linalg.lstsq(damped, gradient, rcond=None)[0]
    return step * min(1.0, LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))


def _cost(w: np.ndarray, residual: np.ndarray) -> float:
    return float((w * residual**2).sum())
