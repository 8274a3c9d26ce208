"""Convergence of the trajectory estimate's iteration, and of the estimate's last fit."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

from ident.estimation.preparation import Part, prepared
from ident.trajectory import stages
from ident.trajectory.estimate import trajectory_estimate
from ident.trajectory.fit import iteration
from ident.trajectory.fit.iteration import NEAR, SETTLED, Tolerance
from ident.trajectory.fit.sandwich import with_scatter


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
    alone = refitted(NEAR)
    with ThreadPoolExecutor(3) as executor, pytest.MonkeyPatch.context() as patch:
        patch.setattr(iteration.pickle, "dumps", None)
        shared = refitted(NEAR, executor=executor)
    assert shared.trace == alone.trace
    np.testing.assert_array_equal(shared.theta, alone.theta)
    np.testing.assert_array_equal(shared.precision, alone.precision)


def test_the_tighter_the_tolerance_the_more_rounds():
    fits = [refitted(settled) for settled in (NEAR, SETTLED, Tolerance(1e-4, 1e-3))]
    assert [fit.status for fit in fits] == ["near", "converged", "converged"]
    rounds = [len(fit.trace) for fit in fits]
    assert rounds[0] < rounds[1] < rounds[2]
    for fit, settled in zip(fits, (NEAR, SETTLED, Tolerance(1e-4, 1e-3)), strict=True):
        assert fit.trace[-1] < settled.theta
    std = np.sqrt(np.diag(fits[2].covariance))
    for fit, settled in zip(fits[:2], (NEAR, SETTLED), strict=True):
        assert (np.abs(fit.theta - fits[2].theta) <= settled.theta * std).all()


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


@pytest.mark.parametrize(("step", "gains", "legs"), [(0.5, False, [8]), (0.5, True, [8, 12]), (5.0, False, [8, 12])])
def test_correlated_noise_is_given_up_once_it_settles_without_predicting_better(monkeypatch, step, gains, legs):
    rounds = []

    def refitted(_, known, **how):
        rounds.append(how["rounds"])
        return known.with_fit(replace(known.fit, status="stopped", trace=(step,)))

    def better(usual, _, other, margin=0.03):
        tried = other()
        return tried if gains else usual

    monkeypatch.setattr(stages.Stages, "refitted", refitted)
    monkeypatch.setattr(stages, "better", better)
    chosen = stages.Stages._coloured(object.__new__(stages.Stages), estimate())
    assert rounds == legs and chosen.coloured == gains
