"""Prior knowledge of bodies and of the set-up, beside a recording."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest

import ident
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS
from docs.tools.noise.recordings import noisy_recording
from ident.parameters.prior import known_covariance
from ident.trajectory.corrected import _root_of_inverse
from ident.trajectory.fit.fitted import Prior


@pytest.mark.parametrize("seed", range(4))
def test_the_root_is_that_of_the_inverse_however_different_units_are(seed):
    rng = np.random.default_rng(seed)
    rows, scale = rng.normal(size=(30, 5)), 10.0 ** rng.uniform(-6, 6, 5)
    precision = rows.T @ rows
    root = _root_of_inverse(np.linalg.inv(precision) * np.outer(scale, scale))
    np.testing.assert_allclose(root.T @ root * np.outer(scale, scale), precision, rtol=1e-7, atol=1e-9)


def test_what_is_known_for_certain_weighs_as_much_as_rounding_tells():
    """A direction without variance does not change the other directions."""
    root = _root_of_inverse(np.diag([4.0, 0.0, 9.0]))
    precision = root.T @ root
    assert np.isfinite(root).all() and precision[1, 1] > 1e10
    np.testing.assert_allclose(precision[[0, 2]], [[1 / 4, 0, 0], [0, 0, 1 / 9]], atol=1e-12)


ARM = driven_arm.mechanism(**driven_arm.NONE)


def scaled(inertia, every=1.0):
    """The arm with factors on its inertias and on all of it."""
    return replace(ARM, prior=(every * ARM.known.reshape(-1, 10) * np.r_[np.ones(4), np.full(6, inertia)]).ravel())


def test_set_up_deviations_have_the_size_of_the_estimate_whatever_the_unit_of_the_model():
    log = driven_arm.log()
    right, wrong = (ident.identify(model, log, known=False) for model in (ARM, scaled(1e9)))
    factor = wrong.std_setup / right.std_setup
    assert factor.min() > 0.3 and factor.max() < 3


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
