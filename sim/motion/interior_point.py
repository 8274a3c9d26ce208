"""Minimisation of a smooth function subject to linear limits, each on the variables of a single block.

minimise    f(x)        subject to  |A_j x_j| ≤ 1  for every block j

by a primal-dual interior-point method. With slacks s± = 1 ∓ A x, multipliers λ± and decreasing barrier weights μ, steps
p solve

    (B + Σ) p = -∇φ,     φ = f - μ Σ log s⁺ s⁻,     Σ_j = A_jᵀ (λ⁺/s⁺ + λ⁻/s⁻) A_j,     then λ± = (μ ± λ± A p)/s±

where B approximates ∇²f by damped BFGS updates (Nocedal and Wright, *Numerical Optimization*, 2006, procedure 18.2 and
chapter 19, doi:10.1007/978-0-387-40065-5). Time grows linearly with the number of limits.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

Function = Callable[[np.ndarray], tuple[float, np.ndarray]]
"""Value of f at a point (n, w), and its gradient there."""

BARRIERS = (2.0, 0.2, 0.02, 0.002)
"""Weights of the barrier, μ times the number of rows, in the unit of f: it costs less than twice the last weight."""

SETTLED = 0.005
"""Predicted decrease, relative to a weight, below which the method goes on to the next weight."""

SIGNS = np.array([1.0, -1.0])[:, None, None]
"""Signs of upper and lower limits."""


@dataclass(frozen=True, eq=False)
class _Point:
    """A point x (n, w) with value and gradient of f, and the slacks s± (2, n, m)."""

    x: np.ndarray
    value: float
    gradient: np.ndarray
    slacks: np.ndarray

    def barred(self, weight: float) -> float:
        """Value of f with the barrier, φ."""
        return self.value - weight * float(np.log(self.slacks).sum())


def minimum(function: Function, start: np.ndarray, limits: np.ndarray, iterations: int) -> np.ndarray:
    """Local minimum of a function within limits.

    Args:
        function: f and its gradient.
        start: Initial point, strictly inside the limits (n, w).
        limits: Rows A_j of n blocks (n, m, w).
        iterations: Largest number of steps.

    Returns:
        The visited point of least value (n, w).
    """
    here = best = _Point(start, *function(start), 1 - SIGNS * _times(limits, start))
    number, (barrier, *later) = limits[:, :, 0].size, BARRIERS
    curvature, multipliers = np.eye(start.size), barrier / number / here.slacks
    for _ in range(iterations):
        step, slope, multipliers = _step(here, curvature, multipliers, limits, barrier / number)
        there = None
        if -slope > SETTLED * barrier:
            there = _descended(function, here, step, slope, limits, barrier / number)
        if there is not None:
            curvature = _updated(curvature, (there.x - here.x).ravel(), (there.gradient - here.gradient).ravel())
            here, best = there, min(best, there, key=lambda point: point.value)
        elif later:
            barrier = later.pop(0)
        else:
            break
    return best.x


def _step(
    here: _Point, curvature: np.ndarray, multipliers: np.ndarray, limits: np.ndarray, weight: float
) -> tuple[np.ndarray, float, np.ndarray]:
    """A step p (n, w), the slope of φ along it, and the multipliers after it (2, n, m)."""
    n, _, w = limits.shape
    central = weight / here.slacks
    # Near μ/s, their values for a pure barrier method.
    multipliers = np.clip(multipliers, central / 1e3, central * 1e3)
    gradient = here.gradient + _times(np.swapaxes(limits, 1, 2), central[0] - central[1])
    matrix = curvature.reshape(n, w, n, w).copy()
    stiffness = (multipliers / here.slacks).sum(axis=0)
    matrix[range(n), :, range(n)] += np.swapaxes(limits, 1, 2) @ (stiffness[:, :, None] * limits)
    step = -cho_solve(cho_factor(matrix.reshape(n * w, -1)), gradient.ravel()).reshape(n, w)
    after = (weight + SIGNS * multipliers * _times(limits, step)) / here.slacks
    return step, float(np.sum(gradient * step)), after


def _descended(
    function: Function, here: _Point, step: np.ndarray, slope: float, limits: np.ndarray, weight: float
) -> _Point | None:
    """Point after a backtracking line search with the Armijo condition, None if no step length satisfies it.

    A step attains at least 1e-4 of the predicted decrease, and at most .99 of the distance to the nearest limit.
    """
    loss = SIGNS * _times(limits, step)
    length = min(1.0, 0.99 / float((loss / here.slacks).max()))
    before = here.barred(weight)
    for _ in range(12):
        x = here.x + length * step
        there = _Point(x, *function(x), here.slacks - length * loss)
        if there.barred(weight) <= before + 1e-4 * length * slope:
            return there
        length /= 2
    return None


def _updated(B: np.ndarray, s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Approximate Hessian after a step s that changed the gradient by y, by a damped BFGS update."""
    if np.array_equal(B, np.eye(len(B))) and s @ y > 0:
        B = B * (s @ y) / (s @ s)
    Bs = B @ s
    expected, actual = s @ Bs, s @ y
    if actual < 0.2 * expected:
        part = 0.8 * expected / (expected - actual)
        y = part * y + (1 - part) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / expected + np.outer(y, y) / (s @ y))


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Each block's matrix (n, m, w) times its vector (n, w)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
