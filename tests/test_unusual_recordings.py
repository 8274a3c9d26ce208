"""Recordings with hardly any usable sample or without noise, and the samples that judge an estimate."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
import swinging
from mechanisms import by_joint
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench, faulty, shortened

import ident
from experiments.reports.identify_page import held_out_figure
from experiments.reports.identify_report import data_lines, parameters_table
from experiments.studies.person_recordings import Laboratory, humanoid, mistaken, recorded
from ident import ExcitationError
from ident.estimation.preparation import LeftOut, prepared
from ident.estimators.trajectory import _known_enough
from ident.problem import problem_of
from ident.trajectory.angles_alone import LARGEST_END, UNSETTLED

RECORDING = faulty(0)


def test_angles_without_any_noise_are_refused_in_one_sentence():
    """Angles that a spline reproduces exactly, and a noisy wrench."""
    t, none = RECORDING.time[:400], np.zeros(400)
    states = [np.stack(x, axis=1) for x in ((3 * t, 0.1 * t**2 - 2 * t), (none + 3, 0.2 * t - 2), (none, none + 0.2))]
    wrench = ident.base_wrench_regressor(PENDULUM.tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    wrench += 0.01 * np.random.default_rng(0).normal(size=wrench.shape)
    with pytest.raises(ExcitationError, match=r"does not determine all parameters\. .* \(--prior on\)\.$"):
        ident.identify(PENDULUM, angles_and_wrench(t, states[0], wrench), known=False)


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


def test_a_recording_that_is_too_short_is_called_that():
    few = r"^15 samples, .* are too few for 13 .* of each log at least 12, .*; there are 9 and 6\.$"
    for samples, message in ((15, few), (5, "needs at least 10 samples, got 5")):
        with pytest.raises(ident.InputError, match=message):
            ident.identify(PENDULUM, shortened(RECORDING, samples))


PERSON = mistaken(humanoid(), np.random.default_rng(1))
SQUATS = recorded("squats", 131 / 50, 3, Laboratory(rate=50.0, rail=False))


def test_bodies_that_are_known_are_equations_of_the_trajectory_estimate_alone():
    """Each channel of a sample is an equation: 79 of 131 samples are enough for 159 base parameters, 25 are not."""
    log = replace(prepared(PERSON, SQUATS), cutoff=None)
    (whole,) = problem_of([log], 0.4, [], alone=False).fitted
    assert len(whole.indices) == 79
    part = [replace(log, left_out=(LeftOut(0.5, np.inf, 0.0),))]
    assert len(problem_of(part, 0.0, [], alone=True, wanted=True).fitted[0].indices) == 25
    for more in ({"alone": True, "wanted": False}, {"alone": False}):
        with pytest.raises(ident.InputError, match=r"too few for 159 .* The fit needs 28, .*; there are 25 and 25\.$"):
            problem_of(part, 0.0, [], **more)


def test_what_a_resting_joint_leaves_undetermined_is_no_row_and_not_in_the_condition():
    """Of the first joint alone, its drive and the inertia about it are unknown; the rest is as if it was welded."""
    rng = np.random.default_rng(0)
    t, q, dq, ddq = driven_arm.motion(rng, 8.0, 50.0)
    q[:, 0], dq[:, 0], ddq[:, 0] = 0.3, 0, 0
    torque = driven_arm.torques(q, dq, ddq, **driven_arm.NONE) + 0.02 * rng.normal(size=q.shape)
    q[:, 1:] += 1e-4 * rng.normal(size=(len(t), 2))
    channels = by_joint(driven_arm.JOINTS, position=q, torque=torque)
    log = ident.Recording(t, channels)
    estimate = ident.identify(driven_arm.mechanism(**driven_arm.NONE), log, setup=driven_arm.EXACT)
    assert estimate.undetermined and estimate.condition_number > 1e10 > 1e4 > estimate.determined_condition
    assert "Ia(turn), Fv(turn), Fc(turn) do not show in a joint that rests." in estimate.prepared.notes
    rows = [row[0] for row in parameters_table(estimate).rows]
    assert rows == [name for name in estimate.fit.names if name not in estimate.undetermined]
    sentence = f"turn rests, so that the motion does not determine {', '.join(estimate.undetermined)}"
    assert sentence in str(estimate.summary()) and sentence in " ".join(data_lines(estimate))


@pytest.mark.slow
def test_recordings_that_are_judged_follow_one_another_but_for_their_ends_however_short():
    logs, lengths = [shortened(faulty(seed), 400) for seed in range(2)], (300, 120)
    judges = [shortened(faulty(seed), samples) for seed, samples in zip((5, 6), lengths, strict=True)]
    estimate = ident.identify(PENDULUM, logs, held_out=judges)
    held = estimate.held_out
    assert (np.diff(held.time) > 0).all() and len(held.starts) == 2 and held.starts[0] == 0
    np.testing.assert_allclose(np.diff(held.time), np.median(np.diff(held.time)), rtol=1e-6)
    for judge, own in zip(judges, np.split(held.time, held.starts[1:]), strict=True):
        edge = min(UNSETTLED, LARGEST_END * np.ptp(judge.time))
        inside = (judge.time > judge.time[0] + edge) & (judge.time < judge.time[-1] - edge)
        np.testing.assert_allclose(own - own[0], judge.time[inside] - judge.time[inside][0], atol=1e-9)
    (line, _) = held_out_figure(estimate).axes[0].lines
    assert np.flatnonzero(np.isnan(line.get_xdata())).tolist() == [held.starts[1]]
    rms = np.sqrt((held.residual_with(TRUTH) ** 2).mean(axis=0))
    assert (rms[[0, 1, 2, 4, 5]] < 1.2 * np.array([0.5, 0.5, 0.5, 0.05, 0.05])).all()


@pytest.mark.slow
def test_nothing_in_a_gap_is_judged_or_fitted_by_least_squares():
    start, end = gap = 4.0, 7.4
    person, streams = swinging.pendulum(), swinging.streams(np.random.default_rng(2), gap=gap)
    recording = ident.Recording.from_streams(streams)
    log, filtered = prepared(person, recording), prepared(person, recording, cutoff=6.0)
    held = ident.identify(person, recording).held_out
    settles = filtered.edge / recording.rate - 0.02
    for time, margin in (
        (recording.time[log.taken(slice(None))], -0.01),
        (recording.time[filtered.taken(slice(None))], settles),
        (held.time, UNSETTLED - 0.01),
    ):
        assert not ((time > start - margin) & (time < end + margin)).any() and len(time) > 100
    rms = np.sqrt((held.residual_with(ident.find_base_parameters(person).regroup(person.known)) ** 2).mean(axis=0))
    assert (rms[[0, 1, 2, 4, 5]] < 1.2 * np.array([0.5, 0.5, 0.5, 0.05, 0.05])).all()
