"""Direction of gravity: a base that is mounted in another way than the model says, and what only looks like it."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
from commands import sentence_of
from mechanisms import by_joint
from scipy.spatial.transform import Rotation

import ident
from ident import BaseMotion, Motion, Recording, base_wrench_regressor, joint_torque_regressor
from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import prepared
from ident.judgement.model_fit import gravity_check

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
        check = gravity_check(model, motion, measured)
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
    check = gravity_check(with_other_bodies(rng), motion, dict(zip(COMPONENTS, wrench.T, strict=True)))
    assert check.suspicious == (rpy != (0, 0, 0))
    assert np.allclose(ARM.mounted(check.rpy_deg).gravity, true.gravity, atol=1) and check.joint is None


def test_what_only_looks_like_it_is_none():
    _, motion, torques, wrench = recorded()
    model, base = with_other_bodies(np.random.default_rng(2)), list(COMPONENTS)
    opposite, tared = ({name: of(x) for name, x in wrench.items()} for of in (np.negative, lambda x: x - x[0]))
    turned = {name: wrench[base[(k + 1) % 3 + 3 * (k // 3)]] for k, name in enumerate(base)}
    one_opposite, in_mm = torques | {"lift": -torques["lift"]}, {name: 1e3 * x for name, x in torques.items()}
    for measured in (opposite, tared, turned, one_opposite, in_mm):
        assert not gravity_check(model, motion, measured).suspicious
    assert gravity_check(replace(model, gravity=np.zeros(3)), motion, torques) is None
    assert gravity_check(model, motion, {}) is None


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
