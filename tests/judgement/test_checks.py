"""Wrenches and gravity against the model, residuals against the motion, and channels that a verdict does not count."""

from dataclasses import replace
from types import SimpleNamespace

import driven_arm
import numpy as np
import pytest
from commands import sentence_of
from mechanisms import GRAVITY, by_joint, double_pendulum, random_phi, random_states, sines
from scipy import signal
from scipy.spatial.transform import Rotation

import ident
from ident import BaseMotion, Motion, Recording, base_wrench_regressor, joint_torque_regressor
from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import prepared
from ident.judgement import checks, model_fit, residuals
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
    given = {"mechanism": driven_arm.mechanism(), "frame": np.eye(4), "recording": SimpleNamespace(still=still)}
    return residuals.idle_channels(held, SimpleNamespace(**given))


def test_a_torque_of_a_joint_at_rest_and_one_of_noise_do_not_count():
    assert idle(1e-3, [False, False, True], [0.95, 0.95, 0.95]) == {"turn": "rest", "bend": "noise"}
    assert idle(1.0, [False, True, True], [0.95, 0.95, 0.4]) == {"lift": "noise"}
    assert not idle(1.0, [False, True, True], [0.95, 0.95, 0.4], still=True)


def test_a_component_that_the_model_does_not_change_is_of_a_wrench():
    changes = {"Fx": 1e-9, "Fy": 5.0, "Fz": 8.0, "Mx": 0.2, "My": 1e-5, "Mz": 0.0}
    assert residuals.still_channels(changes) == dict.fromkeys(("Fx", "My", "Mz"), "still")


ARM = driven_arm.mechanism(**driven_arm.NONE)
MOUNTS = [(0, 0, 0), (180, 0, 0), (-90, 0, 0), (0, 45, 0), (-35, 30, 0)]


def with_other_bodies(rng):
    """The arm of a model with masses wrong by a fifth and centres wrong by 10 mm."""
    bodies = ARM.known.reshape(-1, 10) * (1 + 0.2 * rng.choice([-1, 1], (3, 1)))
    bodies[:, 1:4] += bodies[:, :1] * rng.normal(scale=0.01, size=(3, 3))
    return replace(ARM, prior=bodies.ravel())


def recorded(rpy=(0, 0, 0), speed=1.0, seed=1):
    """A motion of the arm on a base mounted so, and its torques with friction and base wrench, with noise, by name."""
    rng, true = np.random.default_rng(seed), ARM.mounted(rpy)
    t, q, dq, ddq = driven_arm.motion(rng)
    motion = Motion(q, speed * dq, speed**2 * ddq)
    torques = joint_torque_regressor(ARM.tree, *motion.states, gravity=true.gravity) @ ARM.known
    torques = torques + 0.5 * np.tanh(motion.dq / 0.01) + rng.normal(scale=0.05, size=q.shape)
    wrench = base_wrench_regressor(ARM.tree, *motion.states, gravity=true.gravity) @ ARM.known
    wrench = wrench + rng.normal(scale=0.1, size=wrench.shape)
    named = zip((ARM.tree.freedoms, COMPONENTS), (torques, wrench), strict=True)
    return t, motion, *(dict(zip(names, x.T, strict=True)) for names, x in named)


@pytest.mark.parametrize("rpy", MOUNTS)
def test_the_direction_is_that_of_the_base_from_torques_and_from_a_wrench(rpy):
    _, motion, torques, wrench = recorded(rpy)
    model, true = with_other_bodies(np.random.default_rng(2)), ARM.mounted(rpy).gravity
    for measured in (torques, wrench, torques | wrench):
        check = model_fit.gravity_check(model, motion, measured)
        assert check.suspicious == (rpy != (0, 0, 0))
        assert check.misfit < 0.4 and (rpy == (0, 0, 0) or check.stated > 0.4)
        angle = np.arccos(np.clip(model.mounted(check.rpy_deg).gravity @ true / 9.81**2, -1, 1))
        assert np.degrees(angle) < 6


@pytest.mark.parametrize("rpy", [(0, 0, 0), (-90, 0, 0)])
def test_the_direction_is_found_in_the_axes_of_a_moving_base(rpy):
    (t, motion, *_), rng, true = recorded(), np.random.default_rng(3), ARM.mounted(rpy)
    q = np.hstack([0.1 * np.sin(np.outer(t, [1.0, 1.3, 1.7])), np.tile([1.0, 0, 0, 0], (len(t), 1))])
    turns = Rotation.from_euler("xyz", 0.6 * np.sin(np.outer(t, [0.9, 1.4, 0.7])))
    q[:, 3:] = turns.as_quat(scalar_first=True)
    base = BaseMotion.from_free_joint(q, np.zeros((len(t), 6)), np.zeros((len(t), 6)))
    motion = replace(motion, base=base)
    wrench = base_wrench_regressor(ARM.tree, *motion.states, gravity=true.gravity, base=base) @ ARM.known
    check = model_fit.gravity_check(with_other_bodies(rng), motion, dict(zip(COMPONENTS, wrench.T, strict=True)))
    assert check.suspicious == (rpy != (0, 0, 0))
    assert np.allclose(ARM.mounted(check.rpy_deg).gravity, true.gravity, atol=1) and check.joint is None


def test_what_only_looks_like_it_is_none():
    _, motion, torques, wrench = recorded()
    model, base = with_other_bodies(np.random.default_rng(2)), list(COMPONENTS)
    opposite, tared = ({name: of(x) for name, x in wrench.items()} for of in (np.negative, lambda x: x - x[0]))
    turned = {name: wrench[base[(k + 1) % 3 + 3 * (k // 3)]] for k, name in enumerate(base)}
    one_opposite, in_mm = torques | {"lift": -torques["lift"]}, {name: 1e3 * x for name, x in torques.items()}
    for measured in (opposite, tared, turned, one_opposite, in_mm):
        assert not model_fit.gravity_check(model, motion, measured).suspicious
    assert model_fit.gravity_check(replace(model, gravity=np.zeros(3)), motion, torques) is None
    assert model_fit.gravity_check(model, motion, {}) is None


def log_of(rpy, seed=1):
    t, motion, torques, _ = recorded(rpy, seed=seed)
    return {"time": t, **by_joint(ARM.tree.joints, position=motion.q, torque=np.stack([*torques.values()], axis=1))}


def test_the_first_finding_says_what_to_write_and_with_it_the_estimate_is_usable():
    log, columns = log_of((180, 0, 0)), {"base": {"rpy_deg": [180, 0, 0]}}
    model = with_other_bodies(np.random.default_rng(2))
    findings = ident.identify(model, log, estimator="weighted", cutoff="auto").findings
    assert findings[0].code == "gravity_direction" and "rpy_deg = [180, 0, 0]" in findings[0].text
    assert not {"torque_sign", "torque_scale", "body_not_carried"} & {finding.code for finding in findings}
    right = ident.identify(model, log, columns=columns, estimator="weighted", cutoff="auto")
    assert right.verdict().usable and np.allclose(right.prepared.mechanism.gravity, [0, 0, 9.81])
    assert any("[180, 0, 0]" in note for note in right.prepared.notes)


def test_the_orientation_is_stated_once(tmp_path):
    log = log_of((180, 0, 0))
    recording = ident.read_log(log, ARM, {"base": {"rpy_deg": [180, 0, 0]}})
    recording.save(tmp_path / "log.npz")
    assert Recording.load(tmp_path / "log.npz").base_rpy_deg == (180.0, 0.0, 0.0)
    poses = np.tile(np.eye(4), (len(recording.time), 1, 1))
    other = ident.read_log(log_of((180, 0, 0), seed=2), ARM)
    for call, *given, message in (
        (prepared, ARM.mounted((0, 90, 0)), recording, "twice"),
        (prepared, ARM, replace(recording, base=poses), "twice"),
        (ident.identify, ARM, [recording, other], "same direction of gravity"),
        (ident.read_log, log, ARM, {"base": {"rpy_deg": [180, 0, "up"]}}, "roll, pitch and yaw in degrees"),
    ):
        assert message in sentence_of(call, *given)
