"""Recordings with hardly any usable sample, or without noise: an answer, or one sentence."""

from dataclasses import replace
from functools import partial

import driven_arm
import numpy as np
import pytest
from persons import once
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, faulty, shortened, wrench_of

import ident
from experiments.data.simulated_person import Laboratory
from experiments.reports.identify_report import data_lines, parameters_table
from experiments.studies.person_recordings import humanoid, mistaken, recorded
from ident.errors import ExcitationError
from ident.estimation.preparation import LeftOut, prepared
from ident.estimators.trajectory import _known_enough
from ident.identification import identified
from ident.problem import problem_of
from ident.setup import PRIORS

RECORDING = faulty(0)
ANGLES, WRENCH = RECORDING.of_joints(JOINTS, "position"), wrench_of(RECORDING)


def on_a_curve(samples=400):
    """Angles that a spline reproduces exactly, and a noisy wrench."""
    t, none = RECORDING.time[:samples], np.zeros(samples)
    states = [np.stack(x, axis=1) for x in ((3 * t, 0.1 * t**2 - 2 * t), (none + 3, 0.2 * t - 2), (none, none + 0.2))]
    wrench = ident.base_wrench_regressor(PENDULUM.tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    noise = 0.01 * np.random.default_rng(0).normal(size=wrench.shape)
    return angles_and_wrench(t, states[0], wrench + noise)


def test_angles_without_any_noise_are_refused_in_one_sentence():
    with pytest.raises(ExcitationError, match=r"does not determine all parameters\. .* \(--prior on\)\.$"):
        ident.identify(PENDULUM, on_a_curve(), known=False)


def test_equations_that_are_singular_are_solved_with_what_is_known():
    def estimate(known=None, fallback=None):
        if known is None:
            raise np.linalg.LinAlgError("The matrix is not positive definite.")
        return known

    assert _known_enough(estimate, None, {"mass": 0.2}) == {"mass": 0.2}


@pytest.mark.slow
def test_a_trajectory_estimate_of_a_short_recording_needs_no_cut_off():
    estimate = ident.identify(PENDULUM, shortened(RECORDING, 49))
    assert abs(estimate.psi[0] - TRUTH[0]) < 3 * estimate.std_setup[0]


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (15, r"^15 samples, .* are too few for 13 .* of each log at least 12, .*; there are 9 and 6\.$"),
        (5, "needs more than 9 samples, got 5"),
    ],
)
def test_a_recording_that_is_too_short_is_called_that(samples, message):
    with pytest.raises(ident.InputError, match=message):
        ident.identify(PENDULUM, shortened(RECORDING, samples))


PERSON = mistaken(humanoid(), np.random.default_rng(1))
SQUATS = recorded("squats", 131 / 50, 3, Laboratory(rate=50.0, rail=False))


@pytest.mark.slow
def test_each_channel_of_a_sample_is_an_equation():
    """131 samples of six channels, of which 79 samples are fitted, for 159 base parameters."""
    estimate = identified(prepared(PERSON, SQUATS), known=True, setup=dict.fromkeys(PRIORS, 0), report=once)
    assert len(estimate) == 159 and len(estimate.logs[0].indices) == 79


def test_bodies_that_are_known_are_equations_of_the_trajectory_estimate_alone():
    log = replace(prepared(PERSON, SQUATS), cutoff=None)
    part = replace(log, left_out=(LeftOut(0.5, np.inf, 0.0),))
    fitted = partial(problem_of, [part], 0.0, [])
    assert len(fitted(alone=True, wanted=True).fitted[0].indices) == 25
    for more in ({"alone": True, "wanted": False}, {"alone": False}):
        with pytest.raises(ident.InputError, match=r"too few for 159 .* The fit needs 28, .*; there are 25 and 25\.$"):
            fitted(**more)


def test_what_a_resting_joint_leaves_undetermined_is_no_row_and_not_in_the_condition():
    """Of the first joint alone, its drive and the inertia about it are unknown; the rest is as if it was welded."""
    rng = np.random.default_rng(0)
    t, q, dq, ddq = driven_arm.motion(rng)
    q[:, 0], dq[:, 0], ddq[:, 0] = 0.3, 0, 0
    torque = driven_arm.torques(q, dq, ddq, **driven_arm.NONE) + 0.02 * rng.normal(size=q.shape)
    q[:, 1:] += 1e-4 * rng.normal(size=(len(t), 2))
    channels = {f"{joint}_position": x for joint, x in zip(driven_arm.JOINTS, q.T, strict=True)}
    channels |= {f"{joint}_torque": x for joint, x in zip(driven_arm.JOINTS, torque.T, strict=True)}
    log = ident.Recording(t, channels)
    estimate = ident.identify(driven_arm.mechanism(**driven_arm.NONE), log, setup=dict.fromkeys(PRIORS, 0))
    assert estimate.undetermined and estimate.condition_number > 1e10 > 1e4 > estimate.determined_condition
    assert "Ia(turn), Fv(turn), Fc(turn) do not show in a joint that rests." in estimate.prepared.notes
    rows = [row[0] for row in parameters_table(estimate).rows]
    assert rows == [name for name in estimate.fit.names if name not in estimate.undetermined]
    sentence = f"turn rests, so that the motion does not determine {', '.join(estimate.undetermined)}"
    assert sentence in str(estimate.summary()) and sentence in " ".join(data_lines(estimate))
