"""Wrenches against the model, residuals against the motion, and channels that a verdict does not count."""

from types import SimpleNamespace

import driven_arm
import numpy as np
import pytest
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, sines
from scipy import signal

from ident import Motion, base_wrench_regressor
from ident.estimation.equations import COMPONENTS
from ident.judgement import checks, model_fit, residuals
from ident.judgement.residuals import idle_channels, still_channels
from ident.recordings.wrench import transform_wrench

RNG = np.random.default_rng(0)
TREE = double_pendulum()
STATES = tuple(random_states(RNG, TREE, 300))
PHI = random_phi(RNG, 3)
WRENCH = base_wrench_regressor(TREE, *STATES, gravity=GRAVITY) @ PHI


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turned_or_flipped_wrench_is_recognised(rng, sign):
    turns = model_fit.right_angled_rotations()
    assert len(turns) == len({R.tobytes() for R in turns}) == 24
    for k in range(0, 24, 3):
        noisy = WRENCH + rng.normal(size=WRENCH.shape)
        turned = (noisy.reshape(-1, 2, 3) @ turns[k]).reshape(-1, 6)
        check = checks.check_frame(sign * turned, WRENCH, np.eye(3))
        assert check.sign == sign and check.suspicious == (k > 0 or sign < 0) and not check.mirrored
        np.testing.assert_array_equal(check.rotation, turns[k])


def test_a_missing_contact_is_found(rng):
    body, point = 2, np.array([0.1, -0.2, 0.3])
    force = rng.normal(size=(300, 3))
    poses = TREE.poses(STATES[0])[:, body] @ np.block([[np.eye(3), point[:, None]], [np.zeros(3), 1]])
    residual = transform_wrench(poses, np.hstack([force, np.zeros((300, 3))]))
    check = checks.check_contact(TREE, STATES[0], residual)
    assert check.body == TREE.names[body]
    np.testing.assert_allclose(check.point, point, atol=1e-9)
    assert check.explained > 1 - 1e-12


@pytest.mark.parametrize(("share", "rate"), [(0.8, 100), (1.0, 1000)])
def test_slow_noise_beside_white_noise_does_not_go_with_a_motion(share, rate):
    """As errors of a smoothed motion beside a sensor's noise: many functions explain much of a few seconds of it."""
    low_pass = signal.butter(3, 6, fs=rate, output="sos")
    for seed in range(3):
        rng, time = np.random.default_rng(seed), np.arange(0, 4, 1 / rate)
        w, size = 2 * np.pi * rng.uniform(0.2, 1.2, (2, 3)), rng.uniform(0.1, 0.5, (2, 3))
        motion = Motion(*sines(time, size, w, rng.uniform(0, 6, (2, 3))))
        slow = signal.sosfiltfilt(low_pass, rng.normal(size=(3 * len(time), 3)), axis=0)[len(time) : 2 * len(time)]
        noise = rng.normal(size=(len(time), 3))
        residual = np.sqrt(share) * slow / slow.std(axis=0) + np.sqrt(1 - share) * noise
        assert residuals.explained_by_motion(residual, motion).max() < 0.1


@pytest.mark.parametrize(("rho", "most", "number"), [(0.0, 0.9, 1), (0.8, 0.9, 9), (0.99, 0.9, 19), (-0.8, 0.9, 1)])
def test_samples_that_are_alike_count_as_one(rho, most, number):
    noise = np.random.default_rng(0).normal(size=(20_000, 1))
    alike = signal.lfilter([1], [1, -rho], noise, axis=0)
    assert residuals.correlated_samples(alike, most) == pytest.approx(number, rel=0.05)


def test_one_component_of_the_opposite_sign_is_mirrored():
    arm, rng = driven_arm.mechanism(**driven_arm.NONE), np.random.default_rng(1)
    _, *states = driven_arm.motion(rng)
    predicted = base_wrench_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known
    # Another arm than the model's, a sensor that is not tared, and noise.
    measured = 1.2 * predicted + np.array([2, -3, 0, 1, 1, -1]) + rng.normal(scale=0.5, size=predicted.shape)
    for name, signs in zip(COMPONENTS, np.ones((6, 6)) - 2 * np.eye(6), strict=True):
        check = checks.check_frame(measured * signs, predicted, np.eye(3))
        assert check.mirrored == (name,) and not check.suspicious


def idle(size, rough, ratio, *, still=False):
    """Reasons of the arm's torques, whose first joint moves by a size, with rough or smooth residuals."""
    rng, t = np.random.default_rng(0), np.arange(1000) / 100
    q = np.sin(np.outer(t, [1.0, 1.3, 1.7])) * [size / 2, 1, 1]
    residual = np.where(rough, rng.normal(size=q.shape), np.sqrt(2) * np.sin(np.outer(t, [2.0, 3.0, 4.0])))
    equations = SimpleNamespace(channels=driven_arm.JOINTS, torques=(0, 1, 2))
    held = SimpleNamespace(
        fit=SimpleNamespace(equations=equations),
        samples=SimpleNamespace(motion=Motion(q, 0 * q, 0 * q), measured=q),
        residual=residual,
        starts=(0, 500),
        rms=np.sqrt((residual**2).mean(axis=0)),
        ratio=np.array(ratio),
    )
    recording = SimpleNamespace(still=still)
    return idle_channels(held, SimpleNamespace(mechanism=driven_arm.mechanism(), frame=np.eye(4), recording=recording))


def test_a_torque_of_a_joint_at_rest_and_one_of_noise_do_not_count():
    assert idle(1e-3, [False, False, True], [0.95, 0.95, 0.95]) == {"turn": "rest", "bend": "noise"}
    assert idle(1.0, [False, True, True], [0.95, 0.95, 0.4]) == {"lift": "noise"}
    assert not idle(1.0, [False, True, True], [0.95, 0.95, 0.4], still=True)


def test_a_component_that_the_model_does_not_change_is_of_a_wrench():
    changes = {"Fx": 1e-9, "Fy": 5.0, "Fz": 8.0, "Mx": 0.2, "My": 1e-5, "Mz": 0.0}
    assert set(still_channels(changes)) == {"Fx", "My", "Mz"} and still_channels({"Fz": 0.0}) == {"Fz": "still"}
