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
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.iteration import SETTLED
from ident.trajectory.fit.piece import Noise
from ident.trajectory.fit.sandwich import with_scatter
from ident.trajectory.trajectory_estimate import trajectory_estimate

ROUNDS = []


@cache
def log():
    return prepared(PENDULUM, shortened(faulty(0), 300), cutoff=10.0)


def estimated(report=None):
    return trajectory_estimate([Part(log(), slice(0, 300))], log().equations, search=False, report=report)


@cache
def estimate():
    return estimated(lambda *_: ROUNDS.append(1))


def test_threads_change_no_bit(monkeypatch):
    """They share the measurement, whose programs are not packed for other processes."""
    fit, measurement = estimate().fit, estimate().measurement
    away = replace(fit, theta=fit.theta + 3 * np.sqrt(np.diag(fit.covariance)))
    alone = iteration.fit(measurement, away, coloured=False)
    monkeypatch.setattr(iteration.pickle, "dumps", None)
    with ThreadPoolExecutor(3) as executor:
        shared = iteration.fit(measurement, away, coloured=False, executor=executor)
    assert shared.trace == alone.trace
    np.testing.assert_array_equal(shared.theta, alone.theta)
    np.testing.assert_array_equal(shared.precision, alone.precision)


def test_an_estimate_has_converged_and_counts_its_rounds():
    fit = estimate().fit
    assert fit.status == "converged" and fit.trace[-1] < SETTLED.theta
    assert 1 < len(fit.trace) <= len(ROUNDS)
    anew = with_scatter(estimate().measurement, fit)
    np.testing.assert_allclose(fit.covariance, anew.covariance, rtol=1e-9, atol=0)


def test_an_estimate_that_is_interrupted_at_last_keeps_its_covariance(monkeypatch):
    usual, plain = estimate(), iteration.fit

    def stop(*_):
        raise KeyboardInterrupt

    def interrupted(measurement, begin, **how):
        last = begin.free.any() and how["settled"] is SETTLED
        fit = plain(measurement, begin, **how | ({"report": stop} if last else {}))
        # A fit that decides may converge, and needs no last one then.
        return replace(fit, status="near") if fit.status == "converged" else fit

    monkeypatch.setattr(iteration, "fit", interrupted)
    other = estimated()
    assert other.fit.status == "interrupted" and other.fit.scatters is not None
    rank = other.measurement.equations.parameters.rank
    deviations = [np.sqrt(np.diag(each.fit.covariance))[:rank] for each in (other, usual)]
    assert deviations[0] == pytest.approx(deviations[1], rel=0.1)


def test_drives_are_those_of_non_negative_least_squares():
    """Columns are correlated, so that drives that are negative together need not be negative one by one."""
    P, none, freed = 6, np.zeros(0), 0
    drives, noise = np.arange(P) >= 2, Noise(none, none, none, none, none, none, none)
    begin = TrajectoryFit(
        [*"abcdef"], [], Prior(np.zeros(P), np.zeros((P, P))), np.zeros(P), np.ones(P) > 0, [noise], [], []
    )
    for seed in range(20):
        rng = np.random.default_rng(seed)
        A = rng.normal(size=(30, P)) @ rng.normal(size=(P, P))
        y = A @ rng.normal(size=P) + 3 * rng.normal(size=30)

        def solve(at, A=A, y=y):
            theta, free = at.theta.copy(), at.free
            theta[free] = np.linalg.lstsq(A[:, free], y - A[:, ~free] @ theta[~free], rcond=None)[0]
            return replace(at, theta=theta, shares=[(A.T @ A, A.T @ (y - A @ theta))], status="converged")

        fit = stages.with_positive(solve, begin, drives)
        best = lsq_linear(A, y, bounds=(np.where(drives, 0.0, -np.inf), np.inf), tol=1e-12)
        assert (fit.theta[drives] >= 0).all()
        np.testing.assert_array_equal(fit.bounded, drives & (fit.theta == 0))
        # A drive at the bound would be negative if it were free.
        assert (fit.scores(np.eye(P)[fit.bounded])[0] <= 1e-9).all()
        assert np.linalg.norm(A @ fit.theta - y) == pytest.approx(np.linalg.norm(A @ best.x - y), rel=1e-9)
        first = np.linalg.lstsq(A, y, rcond=None)[0]
        freed += (drives & (first < 0) & (fit.theta > 0)).any()
    # In some of these problems, not all drives that are negative at first end at their bound.
    assert freed > 1
