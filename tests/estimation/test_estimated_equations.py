"""Equations of an estimate: left-out channels, displaced joints, and the model's drives."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import walker
from mechanisms import by_joint, sines
from random_models import ARM, random_model, random_model_states
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.loads import stated_drive_torques
from ident.estimation.preparation import prepared
from ident.estimation.setup_parameters import setup_parameters
from ident.geometry.se3 import pose
from ident.mechanism.body import BASE, Body, ball_twist
from ident.mechanism.drives import Drive
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.recordings.wrench import transform_wrench
from sim.motion.excitation import DOUBLE_PENDULUM


def posed(sway):
    """A person with a measured pelvis pose, on a plate and a rail whose readings sway about their own x."""
    rng, (time, q, *_) = np.random.default_rng(0), walker.motion()
    total, places = walker.truth(walker.SMALL)
    poses, share = places["pelvis"].copy(), 0.2 + 0.1 * np.sin(3 * time)
    felt = walker.in_frame(poses, total)
    felt[:, 3] += sway * 30 * np.sin(5 * time)
    total = transform_wrench(poses, felt)
    measured = {"shoulder_position": q[:, 6] + 0.002 * rng.normal(size=len(q))}
    for name, taken in (("plate", 1 - share), ("rail", share)):
        values = taken[:, None] * total + rng.normal(size=total.shape) * [1, 1, 1, 0.3, 0.3, 0.3]
        measured |= {f"{name}_force": values[:, :3], f"{name}_torque": values[:, 3:]}
    sensors = {name: ident.Sensor(body, frame="world") for name, body in (("plate", "pelvis"), ("rail", "arm"))}
    poses[:, :3, 3] += 0.001 * rng.normal(size=(len(q), 3))
    return ident.Recording(time, measured, sensors=sensors, base=poses)


@pytest.mark.slow
def test_without_a_ground_a_component_is_left_out_in_the_axes_of_the_base():
    person = sim.mechanism(mujoco.MjSpec.from_string(walker.SMALL), base="pelvis")
    upright, swaying = (ident.identify(person, posed(sway), leave_out=["Mx"]) for sway in (0, 1))
    assert swaying.channels == ("Fx", "Fy", "Fz", "My", "Mz")
    np.testing.assert_allclose(swaying.psi, upright.psi, atol=1e-4 * upright.std.min())
    np.testing.assert_allclose(swaying.held_out.ratio, upright.held_out.ratio, rtol=0.01)
    assert upright.held_out.ratio.max() < 0.25
    z = (swaying.psi - swaying.base.regroup(person.known)) / swaying.std
    assert np.sqrt(np.mean(z**2)) < 1.5


@pytest.fixture(scope="module")
def pendulum():
    spec = scenes.load("double_pendulum")
    return sim.mechanism(spec, base="base"), sim.simulate(spec, DOUBLE_PENDULUM)


@pytest.mark.parametrize("estimator", ["trajectory", "ordinary"])
def test_of_a_ground_what_is_left_out_is_as_good_as_not_measured(pendulum, estimator):
    arm, recording = pendulum
    out = {"ground_force": [False, False, True], "ground_torque": [True, False, False]}
    lacking = {name: np.where(gone, np.nan, recording.measured[name]) for name, gone in out.items()}
    missing = replace(recording, measured={**recording.measured, **lacking}, true={})
    dead = {name: np.where(gone, 1e3, recording.measured[name]) for name, gone in out.items()}
    dead["ground_force"][::2, 2] *= -1
    wrong = replace(recording, measured={**recording.measured, **dead}, true={})
    expected = ident.identify(arm, missing, estimator=estimator)
    own = ident.identify(arm, wrong, estimator=estimator, leave_out=("Fz", "Mx"))
    assert own.channels == expected.channels == ("Fx", "Fy", "My", "Mz")
    np.testing.assert_array_equal(own.psi, expected.psi)
    assert [each.text for each in own.findings] == [each.text for each in expected.findings]


def test_torques_are_left_out_by_their_joints(pendulum):
    arm, recording = pendulum
    torques = {f"{joint}_torque": np.sin(recording.time) for joint in arm.joints}
    both = replace(recording, measured={**recording.measured, **torques}, true={})
    ready = prepared(arm, both, leave_out=[arm.joints[0], "Mz"])
    assert ready.equations.channels == ("Fx", "Fy", "Fz", "Mx", "My", arm.joints[1])
    assert ready.samples.measured.shape[1] == 6 and np.isnan(ready.wrench[:, 5]).all()
    rest = ("Fx", "Fy", "Fz", "Mx", "My", "Mz", *arm.joints)
    with pytest.raises(ident.LogError, match="has nothing to fit: all that it measures is left out, Fx, "):
        prepared(arm, both, leave_out=rest)
    with pytest.raises(ident.InputError, match=f"leave_out needs a list out of {', '.join(rest)}; got Fq"):
        prepared(arm, both, leave_out=["Fq"])


def test_joints_are_displaced_as_a_whole_where_something_shows_it():
    """Torques do not show a shift along the axis of all joints before; nothing shows one of the first joint of all."""
    R = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    hinge, z = [0, 0, 0, 0, 0, 1], np.array([0, 0, 0, 1, 0, 0])
    tree = Tree(
        (
            Body("thigh", BASE, np.eye(4), hinge, "hip"),
            Body("shank", 0, pose(R, np.array([0, 0, -0.4])), hinge, "knee"),
            Body("link", 1, pose(np.eye(3), np.array([0.3, 0, 0])), hinge, "ankle", massless=True),
            Body("foot", 2, np.eye(4), z, "subtalar"),
            Body("toes", 3, np.eye(4), np.zeros(6)),
            Body("ball", 3, pose(np.eye(3), np.array([0.1, 0.1, 0])), ball_twist(np.zeros(3)), "ball"),
        )
    )
    mechanism = Mechanism(tree, np.array([0, 0, -9.81]), np.zeros(50), centre_std=0.01)
    equations = Equations(mechanism, find_base_parameters(mechanism), channels=COMPONENTS)

    def own(moving=False, **priors):
        each = setup_parameters(equations, [], priors, moving=moving)
        return {x.name: (x.std, x.link) for x in each if x.kind == "centre"}

    expected = {f"centre_{axis}({joint})": "" for joint in ("knee", "ankle", "ball") for axis in "xyz"}
    expected |= {"centre_z(knee)": "-hip", "centre_x(ankle)": "knee"}
    assert own() == own(moving=True) == {name: (0.01, link) for name, link in expected.items()}
    stated = own(**{"centre": 0.002, "centre(knee)": 0.03, "centre(ball)": 0})
    known = {name: (0.03 if "knee" in name else 0.002, link) for name, link in expected.items() if "ball" not in name}
    assert stated == known
    equations = Equations(mechanism, find_base_parameters(mechanism), torques=(0,), channels=("torque(hip)",))
    assert {*expected} - {*own()} == {"centre_z(knee)"}
    assert {*expected} == {*own(moving=True)}


MODELS = 100


def states(rng, model, samples=2):
    """States with velocities of 0.5 to 2 rad/s or m/s either way."""
    qpos, qvel, qacc = random_model_states(rng, model, samples)
    return qpos, np.copysign(rng.uniform(0.5, 2, qvel.shape), qvel), qacc


def by_mujoco(model, qpos, qvel, qacc):
    """Forces of `mj_inverse`, and where friction, a soft constraint -(q̈ + b q̇)/R, b = 105 1/s, is full (N, nv)."""
    data, forces, full = mujoco.MjData(model), np.empty_like(qvel), np.empty(qvel.shape, bool)
    for k in range(len(qpos)):
        data.qpos, data.qvel, data.qacc = qpos[k], qvel[k], qacc[k]
        mujoco.mj_inverse(model, data)
        forces[k], full[k] = data.qfrc_inverse, abs(data.qfrc_constraint) == model.dof_frictionloss
    return forces, full


def predicted(arm, states):
    links = joint_torque_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known
    return links + stated_drive_torques(arm, Motion(*states))


def test_torques_of_random_models_are_mujocos():
    compared, left, driven = 0, 0, 0
    for seed in range(MODELS):
        rng = np.random.default_rng(seed)
        size, floating = int(rng.integers(2, 12)), seed % 3 == 0
        model = random_model(rng, size, floating, drives=np.random.default_rng([seed, 1]))
        at = states(rng, model)
        arm, (forces, full) = sim.mechanism(model), by_mujoco(model, *at)
        scale = abs(forces).max(initial=0)
        assert (abs(predicted(arm, at) - forces)[full] <= 1e-9 * scale).all(), seed
        compared, left = compared + full.sum(), left + (~full).sum()
        driven += len(arm.drives)
    assert left < 0.01 * compared and driven > 5 * MODELS


def test_friction_of_a_joint_at_rest_is_zero_and_has_its_sign_beyond():
    arm = sim.mechanism("scenes/arm.xml", base="base")
    q = np.zeros((3, 4))
    dq = np.array([[0, 1e-6, 0, 0], [0, 0.1, 0, 0], [0, -0.1, 0, 0]])
    friction = stated_drive_torques(arm, Motion(q, dq, q)) - 1.5 * dq
    np.testing.assert_allclose(friction[:, 1], [0, 2, -2], atol=1e-3)
    assert not friction[:, [0, 2, 3]].any()
    assert replace(arm.drives["shoulder"], actuators=()) == Drive(viscous=1.5, coulomb=2.0, rotor=0.25)


SPRUNG = ARM.replace('name="shoulder"', 'name="shoulder" stiffness="80" springref="40"').replace(
    'name="elbow"', 'name="elbow" frictionloss=".3"'
)


def recorded(text, rates=True):
    """Angles and torques of an arm by MuJoCo, with little noise."""
    model, rng, time = mujoco.MjModel.from_xml_string(text), np.random.default_rng(0), np.arange(0, 12, 0.02)
    size, rate, phase = rng.uniform(0.2, 0.4, (2, 3)), np.array([1.1, 2.3, 3.7]), rng.uniform(0, 6, (2, 3))
    q, dq, ddq = sines(time, size, rate, phase)
    torques = by_mujoco(model, q, dq, ddq)[0] + 0.01 * rng.normal(size=q.shape)
    states = {"position": q + (0 if rates else 1e-4) * rng.normal(size=q.shape), "torque": torques}
    states |= {"velocity": dq, "acceleration": ddq} if rates else {}
    return sim.mechanism(model, base="base"), ident.Recording(time, by_joint(("shoulder", "elbow"), **states))


@pytest.mark.parametrize("estimator", ["ordinary", "weighted", "trajectory"])
def test_the_model_as_it_came_predicts_with_its_drives_and_the_estimate_is_the_same(estimator):
    arm, recording = recorded(SPRUNG, rates=estimator != "trajectory")
    drive = ("viscous", "coulomb", "rotor")
    arms = arm, replace(arm, drives={})
    driven, bare = (ident.identify(each, recording, estimator=estimator, drive=drive) for each in arms)
    # To rounding: what no channel shows of the bodies depends on the drives that the model states.
    np.testing.assert_allclose(driven.fit.values, bare.fit.values, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(driven.held_out.residual, bare.held_out.residual, rtol=1e-9, atol=1e-12)
    # Near its reversals MuJoCo's friction follows the acceleration.
    assert (driven.rivals["model"] < [0.01, 0.15]).all()
    assert (driven.rivals["model"] < 0.2 * bare.rivals["model"]).all()
