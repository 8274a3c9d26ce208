"""Pieces left out of a fit, against equations solved without them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

from ident.errors import ExcitationError
from ident.estimation.preparation import prepared
from ident.identification import identified
from ident.recordings.sampled import Sampled
from ident.trajectory import left_out
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.angles_alone import smoothed
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.piece import Noise, Piece
from ident.trajectory.left_out import clearly_better, clearly_less, gains, motion_alone, without
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.setup_search import Search


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


def test_a_parameter_that_one_piece_alone_sees_is_fitted_to_it():
    fit, rows, y = quadratic(0)
    rows[1:, :, 0] = 0
    shares = [(X.T @ X, X.T @ (z - X @ fit.theta)) for X, z in zip(rows, y, strict=True)]
    assert np.isfinite(gains(TrajectoryFit(**{**vars(fit), "shares": shares}), [4])).all()


def test_parameters_that_other_pieces_do_not_determine_predict_no_better(monkeypatch):
    def singular(*_):
        raise ExcitationError("The recording does not determine all parameters.")

    fit, *_ = quadratic(0)
    monkeypatch.setattr(left_out, "inverse_of_precision", singular)
    assert not clearly_better(gains(fit, [4])[0])


def test_what_predicts_no_better_than_chance_is_not_believed():
    assert clearly_better(np.array([1.0, 2.0])) and clearly_better(np.array([9.0, -1.0]))
    assert not clearly_better(np.array([2.0, -1.0])) and not clearly_better(np.zeros(3))


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


def test_a_limit_of_what_is_far_below_its_bound_is_finite():
    fit, _, _ = quadratic(0)
    theta, bounded = fit.theta.copy(), np.arange(5) == 4
    shares = [(schur, right - 1e6 * bounded) for schur, right in fit.shares]
    far = TrajectoryFit(**{**vars(fit), "theta": theta, "shares": shares, "bounded": bounded})
    ((limit, std),) = TrajectoryEstimate(None, Search(far), (4,), 0.1, False).bounds.values()
    assert 0 < limit < std


def test_white_weights_are_kept_unless_others_predict_clearly_better():
    """Channels that neither explains do not count."""
    white = np.array([0.2, 0.3, 1.0])
    assert not clearly_less(white, np.array([0.2, 0.295, 1.0]))
    assert clearly_less(white, np.array([0.15, 0.3, 1.0]))
    assert not clearly_less(np.ones(2), np.ones(2))


def test_a_motion_alone_is_smoothed_once_whatever_the_zeros(monkeypatch):
    """Also for copies of the piece with other slack."""
    rng, time = np.random.default_rng(0), np.sort(np.random.default_rng(1).uniform(0, 3, 200))
    angles = np.stack([np.sin(3 * time), np.cos(2 * time)], axis=1) + 0.01 * rng.normal(size=(200, 2))
    empty = np.zeros((200, 0))
    piece = Piece(Spline.over(0, 3, 0.1), time, (angles, None, None), time, empty, np.zeros((200, 2, 0)))
    calls = []
    monkeypatch.setattr(left_out, "smoothed", lambda *given: calls.append(1) or smoothed(*given))
    measurement, theta = SimpleNamespace(zeros={1: 2}), np.array([0.0, 0.0, 0.3])
    motion_alone(piece, measurement, 0 * theta, 0.04)
    shifted = motion_alone(replace(piece, slack=empty), measurement, theta, 0.04)
    expected = smoothed(Sampled(time, angles - [0, 0.3]), 0.04)
    np.testing.assert_allclose(shifted.evaluate(time)[:3], expected.evaluate(time)[:3], atol=1e-9)
    assert len(calls) == 1
