"""Torques and poses of a desired motion, with MuJoCo's own as the oracle on random models."""

import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics, random_model

from sim.simulation.inverse_dynamics import chain
from sim.simulation.sensors import ONE_DOF

SAMPLES = 7
SEEDS = range(60)


@pytest.fixture(params=SEEDS)
def case(request):
    """A model, some of its hinges and slides in any order, and a motion of these in MuJoCo's coordinates."""
    rng = np.random.default_rng(request.param)
    model = random_model(rng, int(rng.integers(3, 12)), floating=request.param % 3 == 0)
    candidates = np.flatnonzero(np.isin(model.jnt_type, ONE_DOF))
    joints = rng.permutation(candidates)[: rng.integers(1, len(candidates) + 1)] if len(candidates) else candidates
    qpos, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    states = np.tile(model.qpos0, (SAMPLES, 1)), *np.zeros((2, SAMPLES, model.nv))
    states[0][:, qpos] += rng.uniform(-3, 3, size=(SAMPLES, len(joints)))
    states[1][:, dof], states[2][:, dof] = rng.uniform(-2, 2, size=(2, SAMPLES, len(joints)))
    return model, chain(model, joints), states, qpos, dof


def test_torques_are_mujocos_inverse_dynamics(case):
    model, found, states, qpos, dof = case
    expected, _ = inverse_dynamics(model, *states)
    torques = found.torques(states[0][:, qpos] - model.qpos0[qpos], states[1][:, dof], states[2][:, dof])
    np.testing.assert_allclose(torques, expected[:, dof], rtol=0, atol=1e-11 * (1 + abs(expected).max()))


def test_poses_are_mujocos_kinematics(case):
    model, found, (positions, _, _), qpos, _ = case
    data = mujoco.MjData(model)
    for body in range(model.nbody):
        position, quaternion = found.poses(body, positions[:, qpos] - model.qpos0[qpos])
        assert position.shape == (SAMPLES, 3)
        for k in range(SAMPLES):
            data.qpos = positions[k]
            mujoco.mj_kinematics(model, data)
            np.testing.assert_allclose(position[k], data.xpos[body], rtol=0, atol=1e-12 * (1 + abs(data.xpos).max()))
            same = np.sign(quaternion[k] @ data.xquat[body]) * data.xquat[body]
            np.testing.assert_allclose(quaternion[k], same, rtol=0, atol=1e-12)
