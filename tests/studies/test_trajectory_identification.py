"""Results of `identify` for recordings with noisy joints and small set-up errors."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from coded import coded
from commands import sentence_of
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench, estimated, faulty, shortened

import ident
import scenes
import sim
from ident.estimation.preparation import prepared
from ident.geometry.inertia import pseudo_inertia
from ident.identification import identified
from ident.judgement.residuals import BEYOND_CHANCE
from ident.setup import PRIORS
from sim.motion.excitation import DOUBLE_PENDULUM


@pytest.mark.slow
def test_clean_recordings_are_usable_and_nothing_is_found():
    beyond = []
    for seed in range(4):
        estimate = estimated(seed)
        assert not estimate.setup and estimate.verdict().usable
        assert estimate.std[estimate.names.index("Ixx2")] <= 0.03
        assert (estimate.std_setup >= estimate.std).all()
        beyond += (abs(estimate.psi - TRUTH) > 1.96 * estimate.std).tolist()
    assert np.mean(beyond) <= 0.15


FAULTS = [
    ({"delay": 0.12}, "delay(ground)", 0.12, "ms late"),
    ({"gravity": 2}, "gravity_x", np.radians(2), "Gravity is tilted by"),
]
SLOW_FAULTS = [
    ({"fast": 0.005}, "clock(ground)", -0.005, "% fast"),
    ({"origin": (0, 0, 0.05)}, "origin_z(ground)", 0.05, "mm further along +z"),
    ({"zero": (3, 0)}, "zero(joint1)", np.radians(3), "The joint 'joint1' reads"),
    ({"gains": (1, 1, 1.1, 1, 1, 1)}, "gain(Fz)", 0.1, "The channel Fz reads"),
]


@pytest.mark.parametrize(
    ("fault", "name", "value", "words"),
    [*FAULTS, *(pytest.param(*fault, marks=pytest.mark.slow) for fault in SLOW_FAULTS)],
)
def test_a_fault_of_the_set_up_is_found_and_taken_out(fault, name, value, words):
    estimate = estimated(3, **fault)
    (error,) = estimate.setup
    assert error.name == name and words in error.text
    assert abs(error.value - value) < 3 * error.std
    off = abs(estimate.psi - TRUTH)
    assert (off < 4 * estimate.std).all() and (off < 2 * estimate.std_setup).all()
    assert estimate.verdict().usable


def test_the_deviation_of_a_fault_includes_the_rest_of_the_set_up():
    """Gravity and sensor are both tilted: noise alone is 3.2 standard deviations away from the truth."""
    (error,) = estimated(1, gravity=2, turn=(0.5, 0, 0)).setup
    words = "Gravity is tilted by 1.6 ± 1.8° about +x of the base frame, ± 0.14° if the rest of the set-up is right."
    assert error.text.startswith(words)
    off = abs(error.value - np.radians(2))
    assert 3 * np.radians(0.14) < off < 2 * error.std


def test_a_forgotten_base_is_named():
    estimate = ident.identify(sim.mechanism(scenes.load("double_pendulum")), shortened(faulty(), 600))
    (finding,) = coded(estimate, "other_base")
    assert finding.doubt and not estimate.verdict().usable and finding.text.endswith("Try --base base.")


def test_the_columns_file_says_what_is_known_of_the_set_up(tmp_path):
    log, columns = tmp_path / "log.csv", tmp_path / "columns.toml"
    faulty().save(log)
    columns.write_text("[setup]\ndelay = 0\nclock = false\naxis_deg = 2\n", encoding="utf-8")
    assert ident.read_log(log, PENDULUM, columns).setup == {"delay": 0, "clock": False, "axis": np.radians(2)}
    for wrong, message in (
        ("[setup]\nlate = 1", "[setup] has no entry 'late'; valid are delay, lag, clock, origin, gain, centre"),
        ("[setup]\naxis_deg = 400", "axis_deg needs a standard deviation, zero or false, got 400; the largest is 180"),
        ("[known]\nmass = true", "known.mass needs a standard deviation"),
    ):
        columns.write_text(wrong, encoding="utf-8")
        assert message in sentence_of(ident.read_log, log, PENDULUM, columns)


@pytest.mark.slow
def test_the_trial_that_disagrees_is_named_and_all_are_fitted_as_one():
    """Six trials, one of them with everything a quarter heavier."""
    trials = [shortened(faulty(seed), 160) for seed in range(6)]
    heavier = trials[3].measured | {"ground_force": 1.25 * trials[3]["ground_force"]}
    trials[3] = replace(trials[3], measured=heavier)
    estimate = ident.identify(PENDULUM, trials, setup=dict.fromkeys(PRIORS, 0.0))
    apart = np.array(estimate.disagreements)
    assert len(apart) == 6 and apart.argmax() == 3 and apart[3] > BEYOND_CHANCE
    # The wrong log is found by comparison with the others.
    assert np.delete(apart, 3).max() < 0.5 * apart[3]
    (finding,) = coded(estimate, "logs_disagree")
    assert finding.doubt and 4 in finding.values["logs"]


def test_logs_have_the_same_channels_and_own_what_logs_can_have():
    recording = shortened(faulty(), 300)
    force = recording["ground_force"] * [1, 0, 1] + [0, 7, 0]
    planar = replace(recording, measured={**recording.measured, "ground_force": force})
    for logs, options, message in (
        ([recording, planar], {}, "A log to fit besides the first needs the channels Fx, Fy, Fz"),
        (
            [recording, recording],
            {"own": ["clock"]},
            "own needs a list out of .*, torque_delay, tracker_delay; got clock",
        ),
        (recording, {"own": ["tracker_delay"]}, "own has tracker_delay, but no recording has tracked bodies; leave"),
        (recording, {"own": ["torque_delay"]}, "own has torque_delay, but no recording has joint torques; leave"),
        (recording, {"own": ["offset", "lag"]}, "own has lag, but no recording has commands; leave it out"),
        (recording, {"own": ["offset"], "offsets": False}, "own has offset, but no offsets are fitted"),
        (recording, {"estimator": "ordinary", "own": ["delay"]}, "Only the trajectory estimate"),
        (
            recording,
            {"estimator": "ordinary", "physical": True},
            "Only the trajectory estimate can be held to physical",
        ),
        ([], {}, "at least one recording"),
    ):
        with pytest.raises(ident.InputError, match=message):
            ident.identify(PENDULUM, logs, **options)


WRONG = replace(PENDULUM, prior=PENDULUM.known * np.repeat([1, 1.15, 1 / 1.15], 10))  # Links 15 % off.


def one_joint_moves():
    """A recording in which the first joint rests, so that some parameters are inseparable."""
    rng = np.random.default_rng(0)
    time = np.arange(600) / 100
    q, dq, ddq = (x * [0, 1] for x in DOUBLE_PENDULUM.trajectory(time))
    wrench = ident.base_wrench_regressor(PENDULUM.tree, q, dq, ddq, gravity=PENDULUM.gravity) @ PENDULUM.known
    wrench += rng.normal(size=wrench.shape) * np.repeat([0.5, 0.05], 3)
    return angles_and_wrench(time, q + 0.003 * rng.normal(size=q.shape), wrench)


@pytest.mark.slow
def test_a_motion_that_separates_too_little_is_answered_with_what_the_model_knows():
    recording = one_joint_moves()
    estimate = ident.identify(WRONG, recording)
    assert estimate.trajectory.known and coded(estimate, "prior_needed")
    assert (np.abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
    explained = estimate.rivals["model"] > 0.1
    assert (estimate.held_out.ratio[1:] < 0.1).all() and explained.any()
    masses = estimate.consistent().phi[::10] / PENDULUM.known[::10]
    assert (masses > 0.5).all() and (masses < 2).all()
    assert np.abs(estimate.moved_from_prior).max() > 0.3
    # Parameters of almost resting joints are open by more than their size, or rounding decides: then there is an error.
    try:
        without = ident.identify(WRONG, recording, known=False)
    except ident.ExcitationError as error:
        assert "does not determine all parameters" in str(error)
    else:
        assert (without.std > np.abs(TRUTH))[TRUTH != 0].any() and not without.trajectory.known


def test_bodies_are_physical_where_that_is_asked_for():
    """The model's links are 15 % off: estimates move as far as the recording asks for, but stay physical."""
    free, held = (ident.identify(WRONG, shortened(faulty(), 600), physical=physical) for physical in (False, True))
    full = held.consistent()
    assert full.attainable and full.distance < 0.5 * free.consistent().distance
    assert (np.linalg.eigvalsh(pseudo_inertia(full.phi.reshape(-1, 10))) > 0).all()
    assert (np.abs(held.psi - TRUTH) < 3 * held.std).all()
    assert (held.held_out.ratio < 1.05 * free.held_out.ratio).all()


def test_pieces_may_be_worked_on_elsewhere():
    ready = prepared(PENDULUM, shortened(faulty(), 250))
    here = identified(ready)
    with ProcessPoolExecutor(1) as executor:
        there = identified(ready, executor=executor)
    np.testing.assert_array_equal(here.psi, there.psi)
