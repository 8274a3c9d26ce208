"""Recordings with hardly any usable sample or without noise, and the samples that judge an estimate."""

from dataclasses import replace
from functools import partial

import driven_arm
import numpy as np
import pytest
import swinging
from mechanisms import by_joint
from persons import once
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, faulty, shortened, wrench_of

import ident
from experiments.reports.identify_page import held_out_figure
from experiments.reports.identify_report import data_lines, parameters_table
from experiments.studies.person_recordings import Laboratory, humanoid, mistaken, recorded
from ident.errors import ExcitationError
from ident.estimation.preparation import LeftOut, prepared
from ident.estimators.trajectory import _known_enough
from ident.identification import identified
from ident.problem import problem_of
from ident.setup import PRIORS
from ident.trajectory.angles_alone import LARGEST_END, UNSETTLED

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
    channels = by_joint(driven_arm.JOINTS, position=q, torque=torque)
    log = ident.Recording(t, channels)
    estimate = ident.identify(driven_arm.mechanism(**driven_arm.NONE), log, setup=dict.fromkeys(PRIORS, 0))
    assert estimate.undetermined and estimate.condition_number > 1e10 > 1e4 > estimate.determined_condition
    assert "Ia(turn), Fv(turn), Fc(turn) do not show in a joint that rests." in estimate.prepared.notes
    rows = [row[0] for row in parameters_table(estimate).rows]
    assert rows == [name for name in estimate.fit.names if name not in estimate.undetermined]
    sentence = f"turn rests, so that the motion does not determine {', '.join(estimate.undetermined)}"
    assert sentence in str(estimate.summary()) and sentence in " ".join(data_lines(estimate))


GAP = 4.0, 7.4


@pytest.mark.slow
@pytest.mark.parametrize("samples", [900, 400, 120])
def test_ends_of_a_recording_are_not_judged_however_short(samples):
    recording = shortened(faulty(), samples)
    held = ident.identify(PENDULUM, shortened(faulty(1), 500), held_out=recording).held_out
    edge = min(UNSETTLED, LARGEST_END * np.ptp(recording.time))
    inside = (recording.time > recording.time[0] + edge) & (recording.time < recording.time[-1] - edge)
    np.testing.assert_array_equal(held.time, recording.time[inside])


@pytest.mark.slow
def test_nothing_in_a_gap_is_judged_or_fitted_by_least_squares():
    recording = ident.Recording.from_streams(swinging.streams(np.random.default_rng(2), gap=GAP))
    log = prepared(swinging.pendulum(), recording)
    taken = recording.time[log.taken(slice(None))]
    assert not ((taken > GAP[0] + 0.01) & (taken < GAP[1] - 0.01)).any() and len(taken) > 500
    filtered = prepared(swinging.pendulum(), recording, cutoff=6.0)
    apart = recording.time[filtered.taken(slice(None))]
    settles = filtered.edge / recording.rate - 0.02
    assert not ((apart > GAP[0] - settles) & (apart < GAP[1] + settles)).any()
    held = ident.identify(swinging.pendulum(), recording).held_out
    assert not ((held.time > GAP[0] - UNSETTLED + 0.01) & (held.time < GAP[1] + UNSETTLED - 0.01)).any()
    psi = ident.find_base_parameters(swinging.pendulum()).regroup(swinging.pendulum().known)
    noise = np.repeat([0.5, 0.05], 3)
    assert (np.sqrt((held.residual_with(psi) ** 2).mean(axis=0))[[0, 1, 2, 4, 5]] < 1.2 * noise[[0, 1, 2, 4, 5]]).all()


@pytest.mark.slow
def test_recordings_that_are_judged_follow_one_another():
    logs = [shortened(faulty(seed), 400) for seed in range(2)]
    judges = [shortened(faulty(seed), 300) for seed in (5, 6)]
    estimate = ident.identify(PENDULUM, logs, held_out=judges)
    held = estimate.held_out
    assert (np.diff(held.time) > 0).all() and len(held.starts) == 2 and held.starts[0] == 0
    np.testing.assert_allclose(np.diff(held.time), np.median(np.diff(held.time)), rtol=1e-6)
    first = ident.identify(PENDULUM, logs, held_out=judges[:1]).held_out
    assert held.starts[1] == len(first.time)
    np.testing.assert_array_equal(held.time[: held.starts[1]], first.time)
    (line, _) = held_out_figure(estimate).axes[0].lines
    assert np.flatnonzero(np.isnan(line.get_xdata())).tolist() == [held.starts[1]]
    rms = np.sqrt((held.residual_with(TRUTH) ** 2).mean(axis=0))
    assert (rms[[0, 1, 2, 4, 5]] < 1.2 * np.array([0.5, 0.5, 0.5, 0.05, 0.05])).all()
