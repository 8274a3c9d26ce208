"""Number of a body's parameters that data determine: against Bayes' rule for all parameters together."""

import numpy as np
import pytest
from scipy.linalg import block_diag

import scenes
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.prior import known_covariances, parameters_identified
from sim.models.mechanism import mechanism


@pytest.fixture(scope="module")
def arm():
    return mechanism(scenes.load("double_pendulum"), "base")


def test_the_variances_that_bayes_rule_leaves(arm):
    base = find_base_parameters(arm)
    L = np.random.default_rng(0).normal(size=(base.rank, base.rank))
    covariance = 1e-3 * L @ L.T
    S = block_diag(*known_covariances(arm))
    B = base.regroup(np.eye(len(S))).T
    information = B.T @ np.linalg.inv(covariance) @ B
    after = np.linalg.inv(np.linalg.inv(S) + information)
    expected = (1 - np.diag(np.linalg.solve(S, after))).reshape(-1, 10).sum(axis=1)
    identified = parameters_identified(arm, base, covariance)
    np.testing.assert_allclose(identified, expected, atol=1e-4)
    # The same with the prior included in the estimate.
    both = np.linalg.inv(np.linalg.inv(covariance) + np.linalg.inv(B @ S @ B.T))
    np.testing.assert_allclose(parameters_identified(arm, base, both, included=True), identified, atol=1e-4)


def test_nothing_is_told_by_noise_and_no_more_than_the_rank_by_perfect_data(arm):
    base = find_base_parameters(arm)
    assert parameters_identified(arm, base, 1e12 * np.eye(base.rank)).max() < 1e-6
    perfect = parameters_identified(arm, base, 1e-12 * np.eye(base.rank))
    assert perfect.sum() == pytest.approx(base.rank, abs=0.01) and perfect.max() <= 10
