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
from ident.estimation.equations import COMPONENTS, Equations, stated_drive_torques
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
    return sim.mechanism(spec, base="base"), sim.simulate(spec, DOUBLE_PENDULUM, samples=400)


def test_of_a_ground_what_is_left_out_is_as_good_as_not_measured(pendulum):
    arm, recording = pendulum
    force, torque = recording["ground_force"].copy(), recording["ground_torque"].copy()
    estimates = []
    for value, leave_out in ((np.nan, ()), (1e3 * (-1.0) ** np.arange(400), ("Fz", "Mx"))):
        force[:, 2] = torque[:, 0] = value
        measured = recording.measured | {"ground_force": force.copy(), "ground_torque": torque.copy()}
        own = replace(recording, measured=measured, true={})
        estimates.append(ident.identify(arm, own, leave_out=leave_out))
    expected, own = estimates
    assert own.channels == expected.channels == ("Fx", "Fy", "My", "Mz")
    np.testing.assert_array_equal(own.psi, expected.psi)
    assert [each.text for each in own.findings] == [each.text for each in expected.findings]


def test_a_channel_that_is_constant_by_the_model_too_is_left_out(pendulum):
    """Without noise, Fx is zero in the pendulum's plane."""
    exact = sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=300, noise_scale=0)
    ready = prepared(pendulum[0], exact, cutoff=10.0)
    assert ready.equations.channels == COMPONENTS[1:]
    assert "Fx never change, nor do they by the model, and are left out." in ready.notes


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
    turn, hinge, z = Rotation.from_euler("y", 90, degrees=True).as_matrix(), np.eye(6)[5], np.eye(6)[3]

    def at(*place):
        return pose(np.eye(3), np.array(place))

    tree = Tree(
        (
            Body("thigh", BASE, np.eye(4), hinge, "hip"),
            Body("shank", 0, pose(turn, np.array([0, 0, -0.4])), hinge, "knee"),
            Body("link", 1, at(0.3, 0, 0), hinge, "ankle", massless=True),
            Body("foot", 2, np.eye(4), z, "subtalar"),
            Body("toes", 3, np.eye(4), np.zeros(6)),
            Body("ball", 3, at(0.1, 0.1, 0), ball_twist(np.zeros(3)), "ball"),
        )
    )
    mechanism = Mechanism(tree, np.array([0, 0, -9.81]), np.zeros(50), centre_std=0.01)

    def centres(moving=False, priors=None, **measured):
        equations = Equations(mechanism, find_base_parameters(mechanism), **measured)
        each = setup_parameters(equations, [], priors or {}, moving=moving)
        return {x.name: (x.std, x.link) for x in each if x.kind == "centre"}

    expected = {f"centre_{axis}({joint})": "" for joint in ("knee", "ankle", "ball") for axis in "xyz"}
    expected |= {"centre_z(knee)": "-hip", "centre_x(ankle)": "knee"}
    wrench, torque = {"channels": COMPONENTS}, {"torques": (0,), "channels": ("torque(hip)",)}
    usual = {name: (0.01, link) for name, link in expected.items()}
    assert centres(**wrench) == centres(moving=True, **wrench) == usual
    stated = centres(priors={"centre": 0.002, "centre(knee)": 0.03, "centre(ball)": 0}, **wrench)
    known = {name: (0.03 if "knee" in name else 0.002, link) for name, link in expected.items() if "ball" not in name}
    assert stated == known
    assert {*expected} - {*centres(**torque)} == {"centre_z(knee)"}
    assert {*expected} == {*centres(moving=True, **torque)}


def by_mujoco(model, qpos, qvel, qacc):
    """Forces of `mj_inverse`, and where friction, a soft constraint -(q̈ + b q̇)/R, b = 105 1/s, is full (N, nv)."""
    data, forces, full = mujoco.MjData(model), np.empty_like(qvel), np.empty(qvel.shape, bool)
    for k in range(len(qpos)):
        data.qpos, data.qvel, data.qacc = qpos[k], qvel[k], qacc[k]
        mujoco.mj_inverse(model, data)
        forces[k], full[k] = data.qfrc_inverse, abs(data.qfrc_constraint) == model.dof_frictionloss
    return forces, full


def test_torques_of_random_models_are_mujocos():
    """With velocities of 0.5 to 2 rad/s or m/s either way."""
    compared, left, driven = 0, 0, 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        model = random_model(rng, int(rng.integers(2, 10)), seed % 3 == 0, drives=np.random.default_rng([seed, 1]))
        qpos, qvel, qacc = random_model_states(rng, model, 2)
        qvel = np.copysign(rng.uniform(0.5, 2, qvel.shape), qvel)
        arm, (forces, full) = sim.mechanism(model), by_mujoco(model, qpos, qvel, qacc)
        own = joint_torque_regressor(arm.tree, qpos, qvel, qacc, gravity=arm.gravity) @ arm.known
        own += stated_drive_torques(arm, Motion(qpos, qvel, qacc))
        assert (abs(own - forces)[full] <= 1e-9 * abs(forces).max(initial=0)).all(), seed
        compared, left, driven = compared + full.sum(), left + (~full).sum(), driven + len(arm.drives)
    assert left < 0.01 * compared and driven > 5 * 30


def test_friction_of_a_joint_at_rest_is_zero_and_has_its_sign_beyond():
    arm = sim.mechanism("scenes/arm.xml", base="base")
    q, dq = np.zeros((3, 4)), np.array([[0, 1e-6, 0, 0], [0, 0.1, 0, 0], [0, -0.1, 0, 0]])
    friction = stated_drive_torques(arm, Motion(q, dq, q)) - 1.5 * dq
    np.testing.assert_allclose(friction[:, 1], [0, 2, -2], atol=1e-3)
    assert not friction[:, [0, 2, 3]].any()
    assert replace(arm.drives["shoulder"], actuators=()) == Drive(viscous=1.5, coulomb=2.0, rotor=0.25)


SPRUNG = ARM.replace('name="shoulder"', 'name="shoulder" stiffness="80" springref="40"').replace(
    'name="elbow"', 'name="elbow" frictionloss=".3"'
)


@pytest.mark.parametrize("estimator", ["ordinary", "trajectory"])
def test_the_model_as_it_came_predicts_with_its_drives_and_the_estimate_is_the_same(estimator):
    """Of angles and torques of an arm by MuJoCo, with little noise."""
    model, rng, time = mujoco.MjModel.from_xml_string(SPRUNG), np.random.default_rng(0), np.arange(0, 12, 0.02)
    size, rate, phase = rng.uniform(0.2, 0.4, (2, 3)), np.array([1.1, 2.3, 3.7]), rng.uniform(0, 6, (2, 3))
    q, dq, ddq = sines(time, size, rate, phase)
    states = {"torque": by_mujoco(model, q, dq, ddq)[0] + 0.01 * rng.normal(size=q.shape), "position": q}
    if estimator == "trajectory":
        states["position"] = q + 1e-4 * rng.normal(size=q.shape)
    else:
        states |= {"velocity": dq, "acceleration": ddq}
    arm, recording = sim.mechanism(model, base="base"), ident.Recording(time, by_joint(("shoulder", "elbow"), **states))
    driven, bare = (
        ident.identify(each, recording, estimator=estimator, drive=("viscous", "coulomb", "rotor"))
        for each in (arm, replace(arm, drives={}))
    )
    # To rounding: what no channel shows of the bodies depends on the drives that the model states.
    np.testing.assert_allclose(driven.fit.values, bare.fit.values, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(driven.held_out.residual, bare.held_out.residual, rtol=1e-9, atol=1e-12)
    # Near its reversals MuJoCo's friction follows the acceleration.
    assert (driven.rivals["model"] < [0.01, 0.15]).all()
    assert (driven.rivals["model"] < 0.2 * bare.rivals["model"]).all()
