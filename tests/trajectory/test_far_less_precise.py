"""Trajectory estimates that fall back on the prior of the bodies after the exploring fit."""

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

from ident.estimation.preparation import Part, prepared
from ident.parameters.prior import known_covariance
from ident.trajectory import estimate as estimate_module
from ident.trajectory.estimate import trajectory_estimate
from ident.trajectory.fit import iteration

VAGUE = {"mass": 0.2, "center": 0.05, "inertia": 0.3}
CLOSE = {name: 1e-3 * std for name, std in VAGUE.items()}


@pytest.fixture(scope="module")
def log():
    return prepared(PENDULUM, shortened(faulty(0), 200), cutoff=10.0)


def estimate(log, **how):
    return trajectory_estimate([Part(log, slice(0, len(log.samples)))], log.equations, search=False, **how)


def values_of(estimate, rank):
    """Base parameters and their standard deviations."""
    return estimate.fit.theta[:rank], np.sqrt(np.diag(estimate.fit.covariance)[:rank])


def test_a_prior_that_is_far_more_precise_gives_what_it_gives_from_the_start(log, monkeypatch):
    """The exploring fit is the only one without the prior."""
    plain, fits = iteration.fit, []

    def counted(*at, **how):
        fits.append((how.get("explore"), how.get("rounds"), how["prior"].precision.any()))
        return plain(*at, **how)

    monkeypatch.setattr(iteration, "fit", counted)
    late = estimate(log, fallback=CLOSE)
    assert late.known
    assert [known for explore, rounds, known in fits if explore is False and rounds] == [True]
    early = estimate(log, known=CLOSE)
    rank = log.equations.parameters.rank
    (one, two), (std, other) = zip(*(values_of(each, rank) for each in (early, late)), strict=True)
    assert np.abs((one - two) / std).max() < 0.1
    np.testing.assert_allclose(other, std, rtol=0.05)


def test_a_part_of_the_recording_decides_as_all_of_it_would(monkeypatch):
    """Every fourth piece gives deviations twice those of all, which alone are not far above those of the prior."""
    log = prepared(PENDULUM, faulty(0), cutoff=10.0)
    plain = estimate(log)
    _, std = values_of(plain, log.equations.parameters.rank)
    close = known_covariance(log.equations.mechanism, log.equations.parameters, CLOSE)
    ratio = float((std / np.sqrt(np.diag(close))).max())
    monkeypatch.setattr(estimate_module, "ENOUGH", len(log.samples) // 4)
    for wanted, used in ((20.0, False), (60.0, True)):
        known = {name: ratio / wanted * each for name, each in CLOSE.items()}
        assert estimate(log, fallback=known).known == used


def test_a_prior_that_is_hardly_more_precise_is_not_used(log):
    plain, other = estimate(log), estimate(log, fallback=VAGUE)
    assert not other.known
    np.testing.assert_array_equal(other.fit.theta, plain.fit.theta)
