"""Drives at their bound, against non-negative least squares."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ident.trajectory.fit.fitted import Prior, Start, TrajectoryFit
from ident.trajectory.fit.piece import Noise
from ident.trajectory.fit.positive_drives import with_positive

NONE = np.zeros(0)
NOISE = Noise(np.zeros((3, 0)), NONE, NONE, np.zeros((3, 0)), NONE, np.zeros((3, 0)), NONE)
P = 6
DRIVES = np.arange(P) >= 2


def solver(A, y):
    """Fits of linear equations with some parameters held."""

    def solve(begin, *, free, rounds):
        theta = begin.theta.copy()
        theta[free] = np.linalg.lstsq(A[:, free], y - A[:, ~free] @ theta[~free], rcond=None)[0]
        share = A.T @ A, A.T @ (y - A @ theta)
        names = [f"x{k}" for k in range(P)]
        prior = Prior(np.zeros(P), np.zeros((P, P)))
        return TrajectoryFit(names, [], prior, theta, [share], free, [NOISE], [], [], (), "converged")

    return solve


def problem(seed):
    """Correlated columns: drives that are negative together need not be negative one by one."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(30, P)) @ rng.normal(size=(P, P))
    return A, A @ rng.normal(size=P) + 3 * rng.normal(size=30)


def fitted(seed):
    A, y = problem(seed)
    every = np.ones(P, bool)
    fit = with_positive(solver(A, y), DRIVES, Start(np.zeros(P), [NOISE], []), every, 10)
    best = lsq_linear(A, y, bounds=(np.where(DRIVES, 0.0, -np.inf), np.inf), tol=1e-12)
    return fit, best, lambda x: np.linalg.norm(A @ x - y)


@pytest.mark.parametrize("seed", range(40))
def test_drives_are_those_of_non_negative_least_squares(seed):
    fit, best, cost = fitted(seed)
    assert (fit.theta[DRIVES] >= 0).all()
    np.testing.assert_array_equal(fit.bounded, DRIVES & (fit.theta == 0))
    # A drive at the bound would be negative if it were free.
    held = np.flatnonzero(fit.bounded)
    assert (fit.scores(np.eye(P)[held])[0] <= 1e-9).all()
    assert cost(fit.theta) == pytest.approx(cost(best.x), rel=1e-9)


def test_a_drive_that_is_freed_again_was_negative_beside_others():
    """In some of these problems, not all drives that are negative at first end at their bound."""
    freed = 0
    for seed in range(40):
        A, y = problem(seed)
        first = np.linalg.lstsq(A, y, rcond=None)[0]
        freed += bool((DRIVES & (first < 0) & (fitted(seed)[0].theta > 0)).any())
    assert freed > 3
