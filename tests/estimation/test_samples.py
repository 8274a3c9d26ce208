"""Samples in pieces, numbers that no sensor reads, and scales of channels."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise

import driven_arm
import numpy as np
import pytest
from commands import sentence_of
from fits import fitted, sampled
from mechanisms import GRAVITY, double_pendulum, random_states
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench, faulty, shortened, wrench_of
from slow_pendulum import recorded

import ident
from ident.estimation.noise import LEAST, LEAST_OF_POSES, least_noise
from ident.estimation.preparation import Part, filtered, prepared
from ident.estimation.samples import arrays_of, even, in_order
from ident.estimators.least_squares import filtered_least_squares
from ident.mechanism.motion import BaseMotion
from ident.recordings.stated import Servo
from ident.trajectory.start import unexplained

TREE = double_pendulum()
STATES = random_states(np.random.default_rng(0), TREE, 90)
WHOLE = sampled(*STATES, np.random.default_rng(1).normal(size=(90, 6)))
MOTION = BaseMotion(np.tile(np.eye(4), (90, 1, 1)), *np.random.default_rng(2).normal(size=(2, 90, 6)))


def with_arrays(**changed):
    return sampled(**{**arrays_of(WHOLE), **changed})


@pytest.mark.parametrize("size", [1, 7, 30, 90, 200])
def test_even_pieces_are_the_same_samples(size):
    whole = with_arrays(base=MOTION, covariance=np.random.default_rng(0).normal(size=(90, 6, 6)))
    parts = list(even((whole[a:b] for a, b in pairwise([0, 1, 2, 33, 34, 90])), size))
    assert [len(part) for part in parts] == [*[size] * (90 // size), *[90 % size] * (90 % size > 0)]
    first = 0
    for part in parts:
        expected = whole[first : first + len(part)]
        np.testing.assert_array_equal(part.covariance, expected.covariance)
        np.testing.assert_equal(arrays_of(part), arrays_of(expected))
        np.testing.assert_equal(vars(part.motion.base), vars(expected.motion.base))
        first += len(part)
    constant = with_arrays(covariance=np.eye(6))
    both = next(even([constant[:40], constant[40:]], 90))
    np.testing.assert_array_equal(both.covariance, np.tile(np.eye(6), (90, 1, 1)))
    assert both.motion.base is None


BROKEN = WHOLE.measured.copy()
BROKEN[17, 2] = np.nan


@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        ([WHOLE, with_arrays(q=np.zeros((90, 3)))], "Piece 1: 'q' needs a row for each of 90 samples and 2"),
        ([with_arrays(measured=WHOLE.measured * 1j)], "Piece 0: 'measured' must be an array of real numbers"),
        ([with_arrays(q=STATES[0].tolist())], "'q' must be an array of real numbers, got <class 'list'>"),
        ([WHOLE, WHOLE, with_arrays(measured=BROKEN)], "Piece 2: 'measured' needs finite numbers; sample 17"),
        ([WHOLE, with_arrays(base=MOTION)], "either all pieces have 'base' or none has"),
        ([WHOLE, with_arrays(covariance=np.eye(6))], "either all pieces have 'covariance' or none has"),
        ([WHOLE, np.zeros(3)], "Piece 1 must be Samples or a recording, got ndarray"),
        ([], "at least one piece of samples, got none"),
        ([WHOLE[:0]], "'q' needs a row for each of 0 samples"),
        (with_arrays(ddq=STATES[2][:80]), "The samples: 'ddq' needs a row for each of 90 samples and 2 columns"),
    ],
)
def test_bad_pieces_are_named(pieces, message):
    source = iter(pieces) if isinstance(pieces, list) else pieces
    assert message in sentence_of(fitted, TREE, source, gravity=GRAVITY)


def test_it_is_map_whoever_finishes_first():
    released = {k: threading.Event() for k in range(8)}
    released[7].set()

    def function(k):
        # Each item waits for the next one.
        assert released[k].wait(timeout=60)
        released.get(k - 1, threading.Event()).set()
        return k**2

    with ThreadPoolExecutor(8) as executor:
        assert list(in_order(executor, function, range(8), ahead=8)) == [k**2 for k in range(8)]
        assert list(in_order(executor, function, [])) == []


RECORDINGS = {
    "wrench": (PENDULUM, shortened(faulty(0), 120), ("_force", "ground_torque")),
    "torques": (driven_arm.mechanism(), driven_arm.log(4.0, 50.0), ("_torque",)),
}


@pytest.mark.parametrize("of", RECORDINGS)
def test_numbers_that_no_sensor_reads_are_one_sentence(of):
    arm, recording, own = RECORDINGS[of]
    huge = r"^channel '\w+' needs numbers below 1e\+08, sample \d+ has "
    for ends, factor, message in (
        *((own, factor, "The recording is constant in every channel") for factor in (1e-310, 1e-120)),
        *((own, factor, huge) for factor in (1e9, 1e300)),
        (("_position",), 1e200, r"_position' needs numbers below 1e\+08"),
    ):
        measured = {name: x * factor if name.endswith(ends) else x for name, x in recording.measured.items()}
        changed = replace(recording, measured=measured, true={}, noise={}, streams={})
        with pytest.raises(ident.InputError, match=message):
            ident.identify(arm, changed)


def test_streams_are_in_range_too():
    arm, recording, _ = RECORDINGS["torques"]
    streams = {name: (recording.time, x) for name, x in recording.measured.items()}
    late = (recording.time, np.where(np.arange(len(recording.time)) == 7, 1e160, recording["bend_torque"]))
    with pytest.raises(ident.InputError, match=r"'bend_torque' needs numbers below 1e\+08, sample 7 has 1e\+160"):
        ident.identify(arm, ident.Recording.from_streams(streams | {"bend_torque": late}))
    tiny = (recording.time, 1e-200 * recording["bend_torque"])
    assert "bend" not in prepared(arm, ident.Recording.from_streams(streams | {"bend_torque": tiny})).equations.channels


def test_a_channel_that_is_flat_in_one_half_does_not_choose_the_cut_off():
    """With Fx flat in the first half 5.9 Hz were chosen for 3.0 Hz, with twice the residuals."""
    recording, none, logs = faulty(1), (np.zeros(len(TRUTH)), np.zeros((len(TRUTH), len(TRUTH)))), []
    for channels in ([], [0]):
        wrench = wrench_of(recording)
        wrench[:400, channels] = 0
        q = recording.of_joints(PENDULUM.tree.joints, "position")
        logs.append(prepared(PENDULUM, angles_and_wrench(recording.time, q, wrench)))
    equations = logs[0].equations.with_offsets(logs[0].equations.sensed)
    fits = [
        filtered_least_squares([Part(log, slice(0, 560))], [Part(log, slice(560, 913))], equations, none)
        for log in logs
    ]
    assert fits[1].cutoffs == fits[0].cutoffs
    np.testing.assert_allclose(fits[1].values[0][1:13], fits[0].values[0][1:13], rtol=0.2, atol=0.05)


def test_a_channel_that_angles_explain_exactly_leaves_weight_to_the_others():
    """Weighted by its rounding errors alone it would hide how the other one separates the columns."""
    a, b, rounding = np.random.default_rng(0).normal(size=(3, 200)) * [[1], [1], [1e-14]]
    columns = np.stack([np.stack([a, b], axis=1), np.stack([a, a], axis=1)], axis=1)
    residual = np.stack([a - b, rounding], axis=1)
    assert unexplained(residual, columns, ("shoulder", "elbow")) < np.log(1e-13)


def test_floors_are_those_of_spread_resolution_and_kind():
    T, noise = np.arange(1000) / 100, np.random.default_rng(0).normal(size=1000)
    flat, coarse, fine = np.full(1000, 3.0), 0.3 * np.round(np.sin(T) / 0.3), 30 * np.sin(T) + noise
    # A share of 1e-5 is the noise of a force, whose sensor it shares, but a signal of a finger's torque.
    small = 1e-5 * fine
    every = np.stack([flat, fine, coarse, 0.01 * small, fine, small, small, fine, fine], axis=1)
    every[::7, 2] = np.nan
    floor = least_noise([every[:600], every[600:]], ("Fx", "Fy", "Fz", "hip", "knee", "finger", "Mx", "My"))
    of_fine = LEAST * fine.std()
    expected = [of_fine, of_fine, 0.3 / np.sqrt(12), of_fine, of_fine, LEAST * small.std(), of_fine, of_fine]
    np.testing.assert_allclose(floor, [*expected, LEAST_OF_POSES * fine.std()], rtol=1e-6)


def test_a_joint_at_rest_is_held_where_it_is():
    """The angle of a joint at rest is one number, without noise."""
    estimate = ident.identify(PENDULUM, recorded(speed=1.5, rests=0.7, noise=1))
    assert estimate.prepared.notes == ("'joint2' rests at 0.7.",)
    fit = estimate.trajectory.fit
    assert fit.status == "converged" and not estimate.trajectory.search.incredible
    for c in fit.coefficients:
        np.testing.assert_allclose(c[:, 1], 0.7, atol=1e-3)
    assert (abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
    assert (estimate.held_out.ratio[1:] < 1.05 * estimate.rivals["model"][1:] + 0.01).all()


@pytest.mark.parametrize("servos", [False, True])
def test_samples_low_passed_as_a_log_are_its_own(servos):
    """With a wrench of which one component is not measured, beside torques or commands."""
    arm, log = driven_arm.mechanism(), driven_arm.log(3.0)
    if servos:
        time, channels = driven_arm.commanded(3.0)
        log = ident.Recording(time, channels, servos=dict.fromkeys(driven_arm.JOINTS, Servo(60.0, 4.0)))
    wrench = np.random.default_rng(0).normal(size=(len(log.time), 6)) * np.array([1, np.nan, 1, 1, 1, 1])
    log = replace(log, measured=log.measured | {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})
    own = prepared(arm, log, cutoff=8.0)
    samples, raw = filtered(own, 8.0)
    np.testing.assert_allclose(samples.measured, own.samples.measured, atol=1e-12)
    np.testing.assert_array_equal(samples.motion.dq, own.samples.motion.dq)
    np.testing.assert_array_equal(raw[:, :5], np.delete(wrench, 1, axis=1))
    np.testing.assert_array_equal(filtered(own, None)[0].measured, raw)
    assert np.abs(filtered(own, 4.0)[0].motion.dq - samples.motion.dq).max() > 1e-3
