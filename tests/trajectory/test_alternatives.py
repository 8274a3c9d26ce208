"""The model's values are kept where they predict left-out pieces better and the data do not contradict them."""

from dataclasses import replace

import driven_arm
import numpy as np
import persons
import pytest
from coded import coded

import ident
from ident.estimators import trajectory
from ident.setup import PRIORS
from ident.trajectory.left_out import prediction_errors

ARM, EXACT = driven_arm.mechanism(), dict.fromkeys(PRIORS, 0.0)


def of(masses, seconds, seed=0):
    """Estimate of the arm whose model has masses times factors, and that model's bodies and drives."""
    model = replace(ARM, prior=ARM.known * np.repeat(masses, 10))
    estimate = ident.identify(model, driven_arm.log(seconds, 50.0, seed), setup=EXACT, known=True)
    return estimate, replace(estimate.fit.equations, mechanism=model).from_model


def test_a_true_model_is_kept_with_the_intervals_of_the_estimate(monkeypatch):
    kept, model = of([1.0, 1.0, 1.0], 3.0)
    monkeypatch.setattr(trajectory, "or_model", lambda estimate: estimate)
    own, _ = of([1.0, 1.0, 1.0], 3.0)
    assert kept.trajectory.kept and coded(kept, "model_kept") and not coded(kept, "prior_needed")
    np.testing.assert_array_equal(kept.fit.values[: len(model)], model)
    assert (kept.held_out.ratio < own.held_out.ratio).all()
    np.testing.assert_allclose(kept.std, own.std, rtol=1e-6)
    # Halves and the set-up are judged by the same linear equations.
    assert kept.disagreement == pytest.approx(own.disagreement, rel=1e-4)
    np.testing.assert_allclose(kept.std_setup, own.std_setup, rtol=1e-4)


@pytest.mark.parametrize("seed", [2, 5])
def test_a_model_that_the_data_contradict_is_not(seed):
    """It predicts the halves of three seconds better, each from the other, and the rest twice to five times worse."""
    masses = np.exp(0.05 * np.random.default_rng(seed).normal(size=3))
    estimate, model = of(masses, 3.0, seed)
    assert estimate.trajectory.known and not estimate.trajectory.kept
    assert not np.array_equal(estimate.fit.values[: len(model)], model)


def test_left_out_pieces_of_somebody_on_plates_alone_have_the_size_of_what_the_plates_carry():
    """Nothing else carries, so that the sum of all wrenches is zero."""
    estimate = persons.briefly().estimate.trajectory
    errors = prediction_errors(estimate.measurement, estimate.fit, np.full(6, np.inf))
    assert (errors < 0.5).any()
