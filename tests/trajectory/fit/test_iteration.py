"""Convergence of the trajectory estimate's iteration, and of the estimate's last fit."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened
from scipy.optimize import lsq_linear

from ident.estimation.preparation import Part, prepared
from ident.trajectory import stages
from ident.trajectory.bounded_fits import with_positive
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import Prior, Start, TrajectoryFit
from ident.trajectory.fit.iteration import SETTLED
from ident.trajectory.fit.piece import Noise
from ident.trajectory.fit.sandwich import with_scatter
from ident.trajectory.trajectory_estimate import trajectory_estimate


def estimated(report=None):
    log = prepared(PENDULUM, shortened(faulty(0), 300), cutoff=10.0)
    return trajectory_estimate([Part(log, slice(0, 300))], log.equations, search=False, report=report)


@cache
def estimate():
    return estimated()


def refitted(settled, away=3.0, executor=None):
    """The estimate's fit from a point some standard deviations away."""
    known = estimate()
    fit = known.fit
    start = iteration.Start(fit.theta + away * np.sqrt(np.diag(fit.covariance)), fit.noises, fit.coefficients)
    return iteration.fit(
        known.measurement,
        fit.pieces,
        start,
        prior=fit.prior,
        free=fit.free,
        names=fit.names,
        selections=fit.selections,
        coloured=False,
        settled=settled,
        executor=executor,
    )


def test_threads_change_no_bit():
    """They share the measurement, whose programs are not packed for other processes."""
    alone = refitted(SETTLED)
    with ThreadPoolExecutor(3) as executor, pytest.MonkeyPatch.context() as patch:
        patch.setattr(iteration.pickle, "dumps", None)
        shared = refitted(SETTLED, executor=executor)
    assert shared.trace == alone.trace
    np.testing.assert_array_equal(shared.theta, alone.theta)
    np.testing.assert_array_equal(shared.precision, alone.precision)


def test_an_estimate_has_converged_and_counts_its_rounds():
    rounds = []
    fit = estimated(report=lambda *_: rounds.append(1)).fit
    assert fit.status == "converged" and fit.trace[-1] < SETTLED.theta
    assert 1 < len(fit.trace) <= len(rounds)
    anew = with_scatter(estimate().measurement, fit)
    np.testing.assert_allclose(fit.covariance, anew.covariance, rtol=1e-9, atol=0)


def test_an_estimate_that_is_interrupted_at_last_keeps_its_covariance(monkeypatch):
    plain = iteration.fit

    def stop(*_):
        raise KeyboardInterrupt

    def interrupted(*at, **how):
        last = how["free"].any() and how["settled"] is SETTLED
        fit = plain(*at, **how | ({"report": stop} if last else {}))
        # A fit that decides may converge, and needs no last one then.
        return replace(fit, status="near") if fit.status == "converged" else fit

    monkeypatch.setattr(iteration, "fit", interrupted)
    other = estimated()
    assert other.fit.status == "interrupted" and other.fit.scatters is not None
    rank = other.measurement.equations.parameters.rank
    deviations = [np.sqrt(np.diag(each.fit.covariance))[:rank] for each in (other, estimate())]
    assert deviations[0] == pytest.approx(deviations[1], rel=0.1)


@pytest.mark.parametrize(
    ("step", "loss", "legs"), [(0.5, 0.1, [8]), (0.5, -0.1, [8, 12]), (5.0, 0.3, [8, 12]), (5.0, 1.0, [8])]
)
def test_correlated_noise_is_given_up_once_it_settles_or_predicts_far_worse(monkeypatch, step, loss, legs):
    rounds, usual = [], estimate()

    def refitted(_, known, **how):
        rounds.append(how["rounds"])
        return known.with_fit(replace(known.fit, status="stopped", trace=(step,)))

    def better(usual, _, other, margin=0.03):
        tried = other()
        return tried if loss < -margin else usual

    monkeypatch.setattr(stages.Stages, "refitted", refitted)
    monkeypatch.setattr(stages, "better", better)
    chosen = stages.Stages._coloured(object.__new__(stages.Stages), usual)
    assert rounds == legs and chosen.coloured == (loss < 0)


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


@pytest.mark.parametrize("seed", range(12))
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
