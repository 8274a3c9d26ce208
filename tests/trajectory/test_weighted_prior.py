"""The prior's weight beside recordings with slow residuals."""

from dataclasses import replace

import numpy as np
import pytest

import ident
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS
from docs.tools.noise.recordings import noisy_recording
from ident.parameters.prior import known_covariance
from ident.trajectory.fit.fitted import Prior


def estimated(name):
    """An estimate of an arm from three seconds with the usual prior; the prior standard deviations and truth (r,)."""
    arm = SUBJECTS["arm"].mechanism
    estimate = ident.identify(arm, noisy_recording(replace(CONDITIONS[name], samples=300), 0, 0), known=True)
    parameters = estimate.fit.equations.parameters
    return estimate, np.sqrt(np.diag(known_covariance(arm, parameters))), parameters.regroup(arm.known)


def test_slow_residuals_tell_less_than_a_fit_takes_them_for():
    estimate, known, true = estimated("random_walk")
    assert estimate.trajectory.fit.prior.weight > 2
    assert (estimate.std <= known * (1 + 1e-6)).all()
    assert (np.abs(estimate.psi - true) < 1.96 * estimate.std).mean() > 0.9


def test_a_prior_has_what_is_known_and_how_it_counts():
    prior = Prior(np.zeros(2), np.diag([4.0, 9.0]))
    np.testing.assert_array_equal(prior.known, prior.precision)
    thrice = prior.weighted(3.0)
    np.testing.assert_allclose(thrice.precision, 3 * prior.precision)
    np.testing.assert_allclose(thrice.known, prior.precision)
    assert thrice.weighted(1.0).precision == pytest.approx(prior.precision)
