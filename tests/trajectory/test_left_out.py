"""Pieces left out of a fit, against equations solved without them."""

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

from ident.estimation.preparation import prepared
from ident.identification import identified
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.piece import Noise
from ident.trajectory.left_out import clearly_better, clearly_less, gains, without


def quadratic(seed, pieces=4, p=5):
    """A fit of linear equations, with pieces that involve all parameters but the last, which is held."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(pieces, 12, p))
    y = rows @ rng.normal(size=p) + 0.1 * rng.normal(size=(pieces, 12))
    free, prior = np.arange(p) < p - 1, np.diag([0, 0, 0, 0.5, 4.0])
    A = rows[..., free].reshape(-1, free.sum())
    theta = np.zeros(p)
    theta[free] = np.linalg.solve(A.T @ A + prior[np.ix_(free, free)], A.T @ y.ravel())
    shares = [(X.T @ X, X.T @ (z - X @ theta)) for X, z in zip(rows, y, strict=True)]
    none = np.zeros(0)
    noise = Noise(np.zeros((3, 0)), none, none, np.zeros((3, 0)), none, np.zeros((3, 0)), none)
    names = [f"x{k}" for k in range(p)]
    fit = TrajectoryFit(names, [], Prior(np.zeros(p), prior), theta, shares, free, [noise], [], [], (), "converged")
    return fit, rows, y


def solved(rows, y, prior, free):
    A = rows[..., free].reshape(-1, free.sum())
    out = np.zeros(len(free))
    out[free] = np.linalg.solve(A.T @ A + prior[np.ix_(free, free)], A.T @ y.ravel())
    return out


@pytest.mark.parametrize("seed", range(3))
def test_parameters_without_a_piece(seed):
    fit, rows, y = quadratic(seed)
    for k in range(len(rows)):
        others = np.arange(len(rows)) != k
        expected = solved(rows[others], y[others], fit.prior.precision, fit.free)
        np.testing.assert_allclose(without(fit, slice(k, k + 1))[0], expected, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_gains_are_what_left_out_pieces_cost_less(seed):
    fit, rows, y = quadratic(seed)
    more = np.ones(5, bool)
    for k, gain in enumerate(gains(fit, [4])[0]):
        others = np.arange(len(rows)) != k
        cost = [
            np.sum((y[k] - rows[k] @ solved(rows[others], y[others], fit.prior.precision, free)) ** 2)
            for free in (fit.free, more)
        ]
        assert gain == pytest.approx(cost[0] - cost[1])
    assert clearly_better(gains(fit, [4])[0])


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [2, 9, 12, 15])
def test_an_interrupt_ends_every_stage(rounds):
    """In the choice of knots, of weights and of the set-up alike."""
    calls = []

    def interrupt(*_):
        calls.append(1)
        if len(calls) == rounds:
            raise KeyboardInterrupt

    log = prepared(PENDULUM, shortened(faulty(3, delay=0.03), 500))
    estimate = identified(log, report=interrupt)
    assert estimate.trajectory.fit.status == "interrupted" and len(calls) == rounds
    assert np.isfinite(estimate.std).all()


def test_white_weights_are_kept_unless_others_predict_clearly_better():
    """Channels that neither explains do not count."""
    white = np.array([0.2, 0.3, 1.0])
    assert not clearly_less(white, np.array([0.2, 0.295, 1.0]))
    assert clearly_less(white, np.array([0.15, 0.3, 1.0]))
    assert not clearly_less(np.ones(2), np.ones(2))
