"""Minima within limits agree with those of another method."""

import numpy as np
import pytest
from scipy.optimize import minimize

from sim.motion.interior_point import minimum


def convex(rng, n, w):
    """A quadratic function plus one of fourth order, and its gradient, of points (n, w)."""
    root, pull = rng.normal(size=(n * w, n * w)), 5 * rng.normal(size=n * w)

    def function(x):
        flat = x.ravel()
        value = np.sum((root @ flat) ** 2) / 2 + np.sum(flat**4) / 4 - pull @ flat
        return float(value), (root.T @ root @ flat + flat**3 - pull).reshape(x.shape)

    return function


@pytest.mark.parametrize("seed", range(8))
def test_constrained_minima_are_those_of_sequential_quadratic_programming(seed):
    rng = np.random.default_rng(seed)
    n, m, w = 3, 12, 4
    function, limits = convex(rng, n, w), rng.normal(size=(n, m, w))
    visited = []

    def watched(x):
        visited.append(abs(np.einsum("nmw,nw->nm", limits, x)).max())
        return function(x)

    x = minimum(watched, np.zeros((n, w)), limits, 400)
    rows = np.zeros((n, m, n, w))
    rows[range(n), :, range(n)] = limits
    rows = rows.reshape(n * m, n * w)
    rows = np.vstack([rows, -rows])
    theirs = minimize(
        lambda x: function(x.reshape(n, w))[0],
        np.zeros(n * w),
        jac=lambda x: function(x.reshape(n, w))[1].ravel(),
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: 1 - rows @ x, "jac": lambda x: -rows},
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert max(visited) < 1
    # The barrier's last weight bounds its cost, and this is its remainder.
    assert -1e-9 < function(x)[0] - theirs.fun < 0.004
    assert abs(limits @ x[:, :, None]).max() > 0.99
