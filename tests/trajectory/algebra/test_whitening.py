"""Innovations and their halves."""

import numpy as np
import pytest

from ident.trajectory.algebra.whitening import innovations


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_halves_have_the_variances_that_are_said(rho):
    """Uncorrelated, since innovations are their sum and have variance one."""
    rng, std = np.random.default_rng(0), np.array([0.1, 3.0])
    x = rng.normal(size=(40000, 2))
    for k in range(1, len(x)):
        x[k] = rho * x[k - 1] + np.sqrt(1 - rho**2) * x[k]
    new = innovations(std * x, np.arange(len(x)), std, np.array([rho, rho]))
    squares, number = new.sums
    np.testing.assert_allclose(squares, number, rtol=0.04)
    share = number[1:] / number[1:].sum(axis=0)
    np.testing.assert_allclose(share, [[(1 - rho) / 2] * 2, [(1 + rho) / 2] * 2])
