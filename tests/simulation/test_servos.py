import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics, random_model

import scenes
from ident.mechanism.motion import Motion
from sim.models.notes import body_name
from sim.simulation.readings import ONE_DOF
from sim.simulation.servos import moved_by

TIME = np.arange(-20, 20) / 20


@pytest.fixture(params=[None, *scenes.CONTACTS, "pad handle"])
def model(request):
    return scenes.load("double_pendulum", tilt_deg=5, contact=request.param).compile()


def states(model, driven, desired):
    full = np.tile(model.qpos0, (len(TIME), 1)), *np.zeros((2, len(TIME), model.nv))
    full[0][:, driven.qpos], full[1][:, driven.dof], full[2][:, driven.dof] = desired.states
    return full


@pytest.fixture(params=range(8))
def driven_states(request):
    """Some hinges and slides of a random model in any order, and a motion of these in MuJoCo's coordinates."""
    rng = np.random.default_rng(request.param)
    model = random_model(rng, int(rng.integers(3, 12)), floating=request.param % 3 == 0)
    joints = rng.permutation(np.flatnonzero(np.isin(model.jnt_type, ONE_DOF)))
    joints = joints[: rng.integers(0, len(joints) + 1)]
    states = np.tile(model.qpos0, (len(TIME), 1)), *np.zeros((2, len(TIME), model.nv))
    driven = moved_by(model, joints)
    states[0][:, driven.qpos] += rng.uniform(-3, 3, size=(len(TIME), len(joints)))
    states[1][:, driven.dof], states[2][:, driven.dof] = rng.uniform(-2, 2, size=(2, len(TIME), len(joints)))
    return driven, states


def test_torques_are_mujocos_inverse_dynamics(driven_states):
    driven, states = driven_states
    expected, _ = inverse_dynamics(driven.model, *states)
    torques = driven.torques(Motion(states[0][:, driven.qpos], *(x[:, driven.dof] for x in states[1:])))
    np.testing.assert_allclose(torques, expected[:, driven.dof], rtol=0, atol=1e-11 * (1 + abs(expected).max()))


def test_poses_are_mujocos_kinematics(driven_states):
    driven, (positions, _, _) = driven_states
    model, data = driven.model, mujoco.MjData(driven.model)
    poses = [driven.poses(body_name(model, b), positions[:, driven.qpos]) for b in range(1, model.nbody)]
    for k in range(len(TIME)):
        data.qpos = positions[k]
        mujoco.mj_kinematics(model, data)
        for b, (position, quaternion) in enumerate(poses, start=1):
            np.testing.assert_allclose(position[k], data.xpos[b], rtol=0, atol=1e-12 * (1 + abs(data.xpos).max()))
            assert abs(quaternion[k] @ data.xquat[b]) == pytest.approx(1, abs=1e-12)
