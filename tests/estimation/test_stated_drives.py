"""Joint torques by the model as it came, its drives among them, against MuJoCo's inverse dynamics."""

import mujoco
import numpy as np
import pytest
from random_models import random_model, random_model_states

import sim
from ident.estimation.stated_drives import stated_drive_torques
from ident.mechanism.drives import Drive
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor

MODELS = 200


def states(rng, model, samples=2):
    """States with velocities of 0.5 to 2 rad/s or m/s either way."""
    qpos, qvel, qacc = random_model_states(rng, model, samples)
    return qpos, np.copysign(rng.uniform(0.5, 2, qvel.shape), qvel), qacc


def by_mujoco(model, qpos, qvel, qacc):
    """Generalised forces of `mj_inverse`, and the mask of those whose friction has its full size (N, nv).

    MuJoCo's friction is a soft constraint with force `-(q̈ + b q̇) / R`, limited to the friction, with b and R from
    `solref` and `solimp`: it is full where |q̈ + b q̇| is more than R times the friction. Here b is 105 1/s.
    """
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
    assert left < 0.01 * compared
    assert driven > 5 * MODELS


def test_a_ball_has_the_spring_that_mujoco_gives_it():
    text = """<mujoco><worldbody><body><joint type="ball" name="hip" stiffness="3" damping=".1"/><geom size=".1"/>
    </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    model.qpos_spring[:] = [0.8, 0.6, 0, 0]
    arm, at = sim.mechanism(model), states(np.random.default_rng(0), model, 20)
    assert set(arm.drives) == {"hip.x", "hip.y", "hip.z"}
    assert arm.drives["hip.x"].springref == pytest.approx(2 * np.arctan2(0.6, 0.8))
    np.testing.assert_allclose(predicted(arm, at), by_mujoco(model, *at)[0], atol=1e-12)


def test_friction_of_a_joint_at_rest_is_zero_and_has_its_sign_beyond():
    arm = sim.mechanism("scenes/arm.xml", base="base")
    q = np.zeros((3, 4))
    dq = np.array([[0, 1e-6, 0, 0], [0, 0.1, 0, 0], [0, -0.1, 0, 0]])
    friction = stated_drive_torques(arm, Motion(q, dq, q)) - 1.5 * dq
    np.testing.assert_allclose(friction[:, 1], [0, 2, -2], atol=1e-3)
    assert not friction[:, [0, 2, 3]].any()
    assert arm.drives["shoulder"] == Drive(
        viscous=1.5, coulomb=2.0, rotor=0.25, actuators=arm.drives["shoulder"].actuators
    )
