"""The marginal likelihood's contribution to the estimate of θ, against determinants."""

import numpy as np
import pytest
from test_piece import problem

from ident.trajectory.algebra import whitening
from ident.trajectory.fit.marginal_likelihood import pull
from ident.trajectory.fit.response import response

RUNS, DRAWS, STEP = 12, 100, 1e-5


@pytest.mark.parametrize("seed", range(2))
def test_pull_is_half_the_gradient_of_the_determinant_as_the_trajectory_follows(seed, monkeypatch):
    """For all parameters except the clock's, on which the determinant hardly depends."""
    monkeypatch.setattr(whitening, "HUBER", 1e6)  # Weights of outliers change with θ, which the gradient leaves out.
    p = problem(seed)
    here, columns = response(p.measurement, p.piece, p.coefficients, p.theta, p.noise), np.arange(len(p.theta))
    at = here, p.measurement, p.noise, p.piece, p.coefficients, p.theta, columns, DRAWS
    pulls = np.array([pull(*at, np.random.default_rng(k + RUNS * seed)) for k in range(RUNS)])
    follows = here.follows

    def log_determinant(e):
        c = p.coefficients - (follows @ e).reshape(p.coefficients.shape)
        return response(p.measurement, p.piece, c, p.theta + e, p.noise).eliminated.log_determinant

    slopes = np.array([(log_determinant(e) - log_determinant(-e)) / (2 * STEP) for e in STEP * np.eye(len(p.theta))])
    others = np.delete(np.arange(len(p.theta)), list(p.measurement.shifts))
    off, error = (pulls.mean(axis=0) - slopes / 2)[others], (pulls.std(axis=0) / np.sqrt(RUNS))[others]
    assert np.all(np.abs(off) <= 5 * error + 1e-4 * np.abs(slopes).max())
    assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(np.mean(slopes[others] ** 2))
