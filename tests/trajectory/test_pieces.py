"""The trajectory estimate uses samples at their own times: other rates, jitter, missing samples, gaps."""

from types import SimpleNamespace

import numpy as np
import pytest
from driven_arm import of_one_joint
from recorded_faults import PENDULUM, faulty, shortened
from swinging import JOINTS, NOISE, identified, motion, pendulum, sampled, streams, ticks, z_of

import ident
from ident.estimation.preparation import Part, prepared
from ident.recordings.stated import Servo
from ident.recordings.times import Sampled
from ident.recordings.wrench import Sensor, transform_wrench
from ident.trajectory.angles_alone import UNSETTLED, smoothed
from ident.trajectory.cut_pieces import _channels
from ident.trajectory.trajectory_estimate import trajectory_estimate


def assert_right(estimate):
    z = z_of(estimate.psi, estimate.covariance)
    assert np.abs(z).max() < 4 and np.sqrt(np.mean(z**2)) < 1.5


@pytest.mark.slow
def test_parameters_are_found_from_streams_with_times_of_their_own():
    own = streams(np.random.default_rng(0), wrench=250.0, jitter=2e-3, missing=0.05, gap=(4.0, 4.3))
    estimate = identified(own)
    assert_right(estimate)
    noise = estimate.trajectory.fit.noises[0]
    np.testing.assert_allclose(noise.states[0], [NOISE[f"{joint}_position"] for joint in JOINTS], rtol=0.1)
    np.testing.assert_allclose(noise.channels, [0.5] * 3 + [0.05] * 3, rtol=0.1)
    # Reports have them at common times.
    common = estimate.prepared
    assert len(common.samples) == len(common.recording.time) and np.isfinite(common.samples.measured).all()
    np.testing.assert_allclose(common.samples.motion.q, motion(common.recording.time).q, atol=4e-3)


@pytest.mark.slow
def test_of_five_recordings_the_intervals_cover_the_truth():
    z = []
    for seed in range(5):
        own = streams(np.random.default_rng(seed), wrench=250.0, missing=0.05)
        # The trajectory estimate has no cut-off: a given one needs no search.
        log = prepared(pendulum(), ident.Recording.from_streams(own), cutoff=10.0)
        fit = trajectory_estimate([Part(log, slice(0, len(log.samples)))], log.equations, search=False, knots=0.1).fit
        z.append(z_of(fit.theta, fit.covariance))
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.99


def test_a_log_gives_the_times_that_it_has():
    rng = np.random.default_rng(0)
    time = ticks(100.0, 2e-3, rng)
    columns = {"time": time} | {name: sampled(rng, name, time)[1] for name in NOISE}
    estimate = ident.identify(pendulum(), ident.read_log(columns, pendulum()), holdout=0.2)
    pieces, end = estimate.trajectory.fit.pieces, estimate.prepared.recording.time[estimate.part.stop]
    for times in ([piece.time for piece in pieces], [piece.when for piece in pieces]):
        np.testing.assert_allclose(np.concatenate(times), time[time < end], rtol=1e-12)
    assert_right(estimate)
    assert max(estimate.held_out.ratio[1:]) < 0.25


def test_contacts_and_torques_may_have_clocks_of_their_own():
    own, arm = streams(np.random.default_rng(0), missing=0.05), pendulum()

    def pull(time):
        return 8 * np.sin(np.outer(time, [1, 2, 3, 4, 5, 6]) + np.arange(6)) * [1, 1, 1, 0.2, 0.2, 0.2]

    time, when = own["ground_force"][0], ticks(400.0) + 7e-4
    when = when[(when < 4) | (when > 4.3)]
    felt = transform_wrench(arm.tree.poses(motion(time).q)[:, -1], pull(time))
    for kind, columns in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        own[f"ground_{kind}"][1][...] -= felt[:, columns]
        own[f"hand_{kind}"] = when, pull(when)[:, columns]
    estimate = identified(own, sensors={"hand": Sensor(arm.tree.names[-1])})
    assert_right(estimate)
    away = [(piece.when > 4.001) & (piece.when < 4.299) for piece in estimate.trajectory.fit.pieces]
    assert sum(map(np.sum, away)) == 29
    for piece, without in zip(estimate.trajectory.fit.pieces, away, strict=True):
        assert np.isnan(piece.measured[without]).all() and np.isfinite(piece.measured[~without]).mean() > 0.94


def test_a_coordinate_that_is_away_for_too_long_is_one_sentence():
    own = streams(np.random.default_rng(0))
    own["joint2_position"][1][2:480] = np.nan
    with pytest.raises(ident.InputError, match=r"The joint 'joint2' needs at least 3 samples from 0 to 4.71 s, it has"):
        identified(own)


@pytest.mark.parametrize(("samples", "counts"), [([943, 250], (3, 1)), ([300], (2,))])
def test_recordings_are_cut_into_six_pieces_of_two_seconds_or_more(samples, counts):
    """Over all recordings; a single recording has two pieces at least, so that one is predicted from the other."""
    logs = [prepared(PENDULUM, shortened(faulty(k), number)) for k, number in enumerate(samples)]
    parts = [Part(log, slice(0, number)) for log, number in zip(logs, samples, strict=True)]
    assert trajectory_estimate(parts, logs[0].equations, search=False, knots=0.3).counts == counts


def wave(time, frequency=0.7):
    return np.sin(2 * np.pi * frequency * time)[:, None]


@pytest.mark.parametrize("rate", [100, 1000])
@pytest.mark.parametrize("share", [0.3, 1.5])
def test_a_frequency_passes_as_the_formula_says(rate, share):
    T, time = 0.05, np.arange(0, 10, 1 / rate)
    frequency, middle = share / (2 * np.pi * T), time[abs(time - 5) < 3]
    q, _, ddq, _ = smoothed(Sampled(time, wave(time, frequency)), T).evaluate(middle)
    expected = wave(middle, frequency) / (1 + share**6)
    np.testing.assert_allclose(q, expected, rtol=0, atol=0.002)
    np.testing.assert_allclose(ddq, -((2 * np.pi * frequency) ** 2) * expected, rtol=0, atol=0.01 / T**2)


def test_either_side_of_a_gap_is_smoothed_by_itself():
    time, parts = np.arange(0, 10, 0.01), [slice(0, 300), slice(640, 1000)]
    x, kept = wave(time) + 0.01 * np.random.default_rng(0).normal(size=(1000, 1)), np.r_[0:300, 640:1000]
    whole = smoothed(Sampled(time[kept], x[kept]), 0.05)
    for part in parts:
        alone = smoothed(Sampled(time[part], x[part]), 0.05)
        np.testing.assert_array_equal(whole.evaluate(time[part]), alone.evaluate(time[part]))
    between = time + 0.005
    near = np.min([abs(between - end) for end in (0, 2.99, 6.4, 9.99)], axis=0) < UNSETTLED
    inside = (between < 2.99) | ((between > 6.4) & (between < 9.99))
    np.testing.assert_array_equal(whole.settled(between), inside & ~near)
    assert abs(whole.evaluate(time[300:640])[0]).max() < 1.2


def test_held_commands_beside_a_wrench_are_the_torque_of_the_inertia():
    """Of a joint whose commands have a constant acceleration, held for a sample each, in the steady state."""
    inertia, servo, wanted, step = 0.28, Servo(700.0, 28.0), 2.0, 0.005
    time = step * np.arange(400)
    u = wanted * time**2 / 2
    q = of_one_joint(inertia, servo, u, step)
    log = ident.Recording(time, {"hip_position": q, "hip_command": u}, servos={"hip": servo})
    tree = SimpleNamespace(bodies=[SimpleNamespace(joint="hip", freedoms=1)])
    beside = SimpleNamespace(torques=(0,), servos=(np.array([servo.kp]), np.array([servo.kv])))
    measurement = SimpleNamespace(equations=beside, components=(0,), contacts=(), frame=None, tracked=(), width=2)
    usable = SimpleNamespace(
        recording=log, mechanism=SimpleNamespace(tree=tree), usable=lambda t: np.ones(len(t), bool)
    )
    torque = _channels(usable, measurement)[0].values[:, 1] - servo.kp * q - servo.kv * np.gradient(q, time)
    np.testing.assert_allclose(torque[200:-2], inertia * wanted, rtol=2e-3)
