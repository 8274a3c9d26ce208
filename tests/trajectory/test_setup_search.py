"""Search for set-up errors over parameters that are estimated independently."""

from dataclasses import dataclass, replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from ident.errors import ExcitationError
from ident.trajectory import setup_search
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.setup_search import Search, SearchSpace, searched


@dataclass(frozen=True)
class Independent:
    """A fit of independent parameters with a standard deviation from the data, and a prior of ± one."""

    best: np.ndarray
    std: np.ndarray
    theta: np.ndarray
    free: np.ndarray
    status: str = "converged"
    scatters: None = None

    @property
    def covariance(self):
        return np.diag(self.std**2)

    @property
    def prior(self):
        return SimpleNamespace(known=np.eye(len(self.theta)))

    def scores(self, directions):
        return directions @ (self.best - self.theta), np.sqrt(directions**2 @ self.std**2)


@pytest.fixture(autouse=True)
def left_out_pieces_agree(monkeypatch):
    monkeypatch.setattr(setup_search, "gains", lambda fitted, candidates: np.ones((len(candidates), 1)))


def space(setup, gross=0.0, groups=MappingProxyType({})):
    """Set-up parameters without drives beside them."""
    zeros = np.zeros(len(setup))
    return SearchSpace(setup, zeros > 0, zeros, zeros + gross, groups)


def search_of(best, std, wider=1, groups=None):
    """The deviating parameters and the search for estimates of each, whose refits have a wider standard deviation."""
    best = np.asarray(best, float)
    first = Independent(best, np.broadcast_to(std, best.shape), np.zeros(len(best)), np.zeros(len(best), bool))

    def refit(begin):
        return replace(begin, theta=np.where(begin.free, best, begin.theta), std=wider * first.std)

    search = searched(Search(first), refit, space(np.ones(len(best), bool), groups=groups or {}))
    return [each.index for each in search.deviations], search


def test_what_is_wrong_is_fitted_the_most_significant_first():
    deviating, search = search_of([0, 2.0, 0.01, -3.0, 0.8], 0.1)
    assert deviating == [3, 1, 4] and not search.incredible
    np.testing.assert_array_equal(search.fit.theta, [0, 2.0, 0, -3.0, 0.8])


@pytest.mark.parametrize("sign", [1, -1])
def test_what_is_far_less_than_anybody_promises_is_no_fault_and_what_nobody_gets_wrong_is_something_else(sign):
    for size, count in ((0.035, 0), (0.045, 1)):
        assert search_of([sign * size, 0], 1e-4)[0] == [0] * count
    for size, credible in ((5.5, True), (6.5, False)):
        deviating, search = search_of([0.5, sign * size], 0.01)
        assert search.incredible == (not credible) and deviating == ([1, 0] if credible else [])
        np.testing.assert_array_equal(search.fit.theta, [0.5, sign * size] if credible else [0, 0])


@pytest.mark.parametrize(("size", "count"), [(0.31, 0), (0.36, 1)])
def test_significance_is_that_of_the_noise_that_is_really_there(size, count):
    """Noise may be larger than the one used to test a parameter: significance counts at the larger one."""
    assert search_of([size], 0.05, wider=2)[0] == [0] * count
    assert search_of([size], 0.05)[0] == [0]


@pytest.mark.parametrize("sign", [1, -1])
def test_an_error_beyond_what_is_stated_has_a_wider_prior(sign):
    """Unless it is within what is stated."""
    information, none = np.diag([1.0, 4.0]) / 0.01**2, np.zeros(2, bool)

    def search_of_two(best):
        gradient = information @ np.array([best, 0.0])

        def refit(begin):
            theta, free = begin.theta.copy(), begin.free
            precision = (information + begin.prior.precision)[np.ix_(free, free)]
            theta[free] = np.linalg.solve(precision, gradient[free])
            return replace(begin, theta=theta, shares=[(information / 2, (gradient - information @ theta) / 2)] * 2)

        prior = Prior(np.zeros(2), np.eye(2) / 0.001**2)
        first = refit(TrajectoryFit(["a", "b"], [], prior, np.zeros(2), none, [], [], []))
        return searched(Search(first), refit, space(~none, np.array([0.1, 0.0])))

    far = search_of_two(sign * 0.101)
    assert [each.gross for each in far.deviations] == [True] and abs(far.fit.theta[0] - sign * 0.1) < 0.03
    assert not far.incredible and 0.009 < np.sqrt(far.fit.covariance[0, 0]) < 0.0101
    assert not search_of_two(sign * 0.004).deviations


@pytest.mark.parametrize(("shares", "found"), [((1, -1, 1), [0, 1, 2]), ((1, 1, 1), [])])
def test_what_explains_nothing_alone_is_tried_with_its_group(shares, found):
    assert not search_of([0.24, -0.24, 0.24], 0.1)[0]
    assert search_of([0.24, -0.24, 0.24], 0.1, groups={"all": np.array(shares, float)})[0] == found


def test_a_group_of_more_than_are_ever_found_is_no_alternative():
    for size, named in ((10, ("all",)), (11, ())):
        search = search_of([3.0, *[0.0] * (size - 1)], 0.1, groups={"all": np.r_[1, [0.01] * (size - 1)]})[1]
        assert [each.together for each in search.deviations] == [named]


def test_an_interrupted_fit_ends_the_search_untested():
    first = Independent(np.array([2.0]), np.array([0.1]), np.zeros(1), np.zeros(1, bool))

    def refit(begin):
        return replace(begin, std=100 * begin.std, status="interrupted")

    assert searched(Search(first), refit, space(np.ones(1, bool))).fit.status == "interrupted"


def test_a_long_delay_is_not_taken_if_the_fit_diverges():
    first, begun = Independent(np.ones(2), np.ones(2), np.zeros(2), np.array([True, False])), []

    def refit(begin):
        begun.append((begin.theta.tolist(), begin.free.tolist()))
        raise ExcitationError("The fit diverges.")

    search = searched(Search(first), refit, space(np.zeros(2, bool)), {1: lambda fit: 0.1})
    assert search.fit is first and not search.deviations
    assert begun == [([0.0, 0.1], [True, True])]
