"""A person's motions: positions of feet and hand, and derivatives that agree with MuJoCo's inverse dynamics."""

from functools import cache

import mujoco
import numpy as np
import pytest

import ident
import scenes
import sim
from sim.motion import person
from sim.motion.person import ACTIVITIES, RAIL, Style

PERSON = sim.mechanism(scenes.load("humanoid"), base="pelvis")
NAMES = PERSON.tree.names
TIME = np.arange(0, 4, 0.02)


@cache
def moved(activity, rail=True):
    motion = person.motion(PERSON.tree, activity, TIME, Style(seed=1, rail=rail))
    return motion, motion.base.T[:, None] @ PERSON.tree.poses(motion.q)


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_a_foot_stays_and_the_hand_holds_the_rail(activity):
    _, poses = moved(activity)
    left, right = (poses[:, NAMES.index(f"{side}_foot")] for side in ("left", "right"))
    still = [np.abs(np.diff(foot, axis=0)).max(axis=(1, 2)) < 1e-9 for foot in (left, right)]
    assert (still[0] | still[1])[np.diff(np.floor(0.5 * TIME)) == 0].all()
    assert np.mean(still[0]) > 0.4
    palm = poses[:, NAMES.index("right_hand")] @ [0, 0, -0.06, 1]
    np.testing.assert_allclose(palm[:, :3], np.broadcast_to(RAIL, (len(TIME), 3)), atol=1e-9)


def needed(motion):
    Y = ident.base_wrench_regressor(PERSON.tree, *motion.states, gravity=PERSON.gravity, base=motion.base)
    return Y @ PERSON.known


@pytest.mark.parametrize("activity", ACTIVITIES)
@pytest.mark.parametrize("rail", [True, False])
def test_inverse_dynamics_of_mujoco_agrees(activity, rail):
    """Velocities and accelerations are differences of the same coordinates over another step."""
    model = scenes.load("humanoid").compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.jnt_stiffness[:], model.dof_damping[:] = 0, 0
    data, h = mujoco.MjData(model), 1e-4
    motion, _ = moved(activity, rail)
    wrench = needed(motion)
    for i in (3, 57, 131):
        q = person.coordinates(PERSON.tree, activity, TIME[i] + h * np.arange(-1, 2), Style(seed=1, rail=rail))
        rates = np.zeros((2, model.nv))
        for rate, before, after in zip(rates, q[:-1], q[1:], strict=True):
            mujoco.mj_differentiatePos(model, rate, h, before, after)
        data.qpos[:], data.qvel[:], data.qacc[:] = q[1], rates.mean(axis=0), np.diff(rates, axis=0)[0] / h
        mujoco.mj_inverse(model, data)
        force = motion.base.T[i, :3, :3] @ wrench[i, :3]
        np.testing.assert_allclose(data.qfrc_inverse[:3], force, atol=0.01)
        np.testing.assert_allclose(data.qfrc_inverse[3:6], wrench[i, 3:], atol=0.01)
