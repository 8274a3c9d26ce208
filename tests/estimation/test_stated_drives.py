"""Joint torques by the model as it came, its drives among them, against MuJoCo's inverse dynamics."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from random_models import ARM, random_model, random_model_states

import ident
import sim
from ident.estimation.loads import stated_drive_torques
from ident.mechanism.drives import Drive
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor

MODELS = 100


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


SPRUNG = ARM.replace('name="shoulder"', 'name="shoulder" stiffness="80" springref="40"').replace(
    'name="elbow"', 'name="elbow" frictionloss=".3"'
)


def recorded(text, rates=True):
    """Angles and torques of an arm by MuJoCo, with little noise."""
    model, rng, time = mujoco.MjModel.from_xml_string(text), np.random.default_rng(0), np.arange(0, 12, 0.02)
    size, rate, phase = rng.uniform(0.2, 0.4, (2, 3)), np.array([1.1, 2.3, 3.7]), rng.uniform(0, 6, (2, 3))
    angle = time[:, None, None] * rate + phase
    q, dq, ddq = ((size * x).sum(axis=2) for x in (np.sin(angle), rate * np.cos(angle), -(rate**2) * np.sin(angle)))
    torques = by_mujoco(model, q, dq, ddq)[0] + 0.01 * rng.normal(size=q.shape)
    states = {"position": q + (0 if rates else 1e-4) * rng.normal(size=q.shape)}
    states |= {"velocity": dq, "acceleration": ddq} if rates else {}
    channels = {
        f"{joint}_{kind}": x[:, k]
        for k, joint in enumerate(("shoulder", "elbow"))
        for kind, x in {**states, "torque": torques}.items()
    }
    return sim.mechanism(model, base="base"), ident.Recording(time, channels)


@pytest.mark.parametrize("estimator", ["ordinary", "weighted", "trajectory"])
def test_the_model_as_it_came_predicts_with_its_drives_and_the_estimate_is_the_same(estimator):
    arm, recording = recorded(SPRUNG, rates=estimator != "trajectory")
    drive = ("viscous", "coulomb", "rotor")
    driven, bare = (
        ident.identify(each, recording, estimator=estimator, drive=drive) for each in (arm, replace(arm, drives={}))
    )
    np.testing.assert_array_equal(driven.fit.values, bare.fit.values)
    np.testing.assert_array_equal(driven.held_out.residual, bare.held_out.residual)
    # Near its reversals MuJoCo's friction follows the acceleration.
    assert (driven.rivals["model"] < [0.01, 0.15]).all()
    assert (driven.rivals["model"] < 0.2 * bare.rivals["model"]).all()
