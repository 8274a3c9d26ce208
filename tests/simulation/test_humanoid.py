"""A falling humanoid: without a ground sensor, the sum of all contact wrenches equals Y φ (Eq. 3)."""

import numpy as np
import pytest
from mechanisms import random_states

import scenes
from ident.mechanism.motion import BaseMotion
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors
from ident.recordings.wrench import Wrench, total_wrench
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, state_columns, tree_from_model
from sim.simulation.contacts import fall

MODEL = scenes.load("humanoid").compile()
TREE, PHI = tree_from_model(MODEL, "pelvis"), parameters_from_model(MODEL, "pelvis")
GRAVITY = gravity_in_base(MODEL, "pelvis")
SENSORS = Sensors(moving_base=True)
FREE = 7, 6, 6
"""Entries of the free joint in qpos, qvel and qacc."""


@pytest.fixture(scope="module")
def motion():
    return fall(MODEL, "pelvis", seconds=2.5)


@pytest.fixture(scope="module")
def contacts(motion):
    return [Wrench(wrench, body) for body, wrench in motion.contacts.items()]


def joint_states(motion):
    coordinates, dofs = state_columns(MODEL, "pelvis")
    return motion.qpos[:, coordinates], motion.qvel[:, dofs], motion.qacc[:, dofs]


def pelvis(motion):
    free = (x[:, :size] for x, size in zip((motion.qpos, motion.qvel, motion.qacc), FREE, strict=True))
    return BaseMotion.from_free_joint(*free)


@pytest.fixture(scope="module")
def Y(motion):
    return base_wrench_regressor(TREE, *joint_states(motion), gravity=GRAVITY, base=pelvis(motion))


def test_left_and_right_are_mirror_images():
    mirror = np.array([1, -1, 1])
    for b in range(1, MODEL.nbody):
        left = MODEL.body(b)
        right = MODEL.body(left.name.replace("left", "right"))
        np.testing.assert_allclose(right.mass, left.mass, rtol=1e-12)
        if left.id != right.id:
            np.testing.assert_allclose(right.pos, mirror * left.pos, atol=1e-12)
            np.testing.assert_allclose(right.ipos, mirror * left.ipos, atol=1e-12)


def test_contact_wrenches_sum_up_to_the_base_wrench(motion, contacts, Y):
    total = total_wrench(TREE, joint_states(motion)[0], None, contacts).values
    np.testing.assert_allclose(total, Y @ PHI, rtol=0, atol=1e-8)
    assert abs(total[:, :3]).max() > 1000 and abs(total[:, 3:]).max() > 100


def test_structural_rank_is_the_numeric_rank():
    rng = np.random.default_rng(0)
    base = BaseMotion.from_free_joint(*(rng.uniform(-2, 2, size=(100, size)) for size in FREE))
    Y = base_wrench_regressor(TREE, *random_states(rng, TREE, 100), gravity=GRAVITY, base=base)
    assert find_base_parameters(Y).rank == find_base_parameters(TREE, sensors=SENSORS).rank == 159


@pytest.mark.parametrize(
    ("seconds", "rate", "message"),
    [
        (0, 100, "at least one sample, got 0 s at 100 Hz"),
        (np.inf, 100, "at least one sample, got inf s at 100 Hz"),
        (1, 300, r"timestep of 0.001 s must divide 0.0033\d* s"),
        (1, 2000, r"timestep of 0.001 s must divide 0.0005 s"),
    ],
)
def test_falls_that_cannot_be_sampled_are_refused(seconds, rate, message):
    with pytest.raises(ValueError, match=message):
        fall(MODEL, "pelvis", seconds=seconds, rate=rate)
