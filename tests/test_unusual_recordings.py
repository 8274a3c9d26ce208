"""Recordings of which hardly anything can be used, or that are too good to be true: an answer, or one sentence."""

import numpy as np
import pytest
from recorded_faults import JOINTS, PENDULUM, angles_and_wrench, faulty, wrench_of

import ident
from ident.errors import ExcitationError
from ident.identification import _known_enough

RECORDING = faulty(0)
ANGLES, WRENCH = RECORDING.of_joints(JOINTS, "position"), wrench_of(RECORDING)


def test_clipped_samples_that_leave_the_filter_nothing_are_named():
    clipped = np.clip(WRENCH, None, np.quantile(WRENCH, 0.9, axis=0))
    with pytest.raises(ident.InputError, match=r"too few for 13 parameters\. Of those, \d+ are left: .* clipped"):
        ident.identify(PENDULUM, angles_and_wrench(RECORDING.time, ANGLES, clipped), estimator="weighted")


def on_a_curve(samples=400):
    """Angles that a spline reproduces exactly, and a noisy wrench."""
    t, none = RECORDING.time[:samples], np.zeros(samples)
    states = [np.stack(x, axis=1) for x in ((3 * t, 0.1 * t**2 - 2 * t), (none + 3, 0.2 * t - 2), (none, none + 0.2))]
    wrench = ident.base_wrench_regressor(PENDULUM.tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    noise = 0.01 * np.random.default_rng(0).normal(size=wrench.shape)
    return angles_and_wrench(t, states[0], wrench + noise)


def test_angles_without_any_noise_are_refused_in_one_sentence():
    with pytest.raises(ExcitationError, match=r"equations are singular but for rounding: .* \(--prior on\)\.$"):
        ident.identify(PENDULUM, on_a_curve(), known=False)


def test_equations_that_are_singular_are_solved_with_what_is_known():
    def estimate(known):
        if known is None:
            raise np.linalg.LinAlgError("The matrix is not positive definite.")
        return known

    assert _known_enough(estimate, None, {"mass": 0.2}) == {"mass": 0.2}
