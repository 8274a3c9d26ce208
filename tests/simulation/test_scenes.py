"""The scenes: their bodies, tilts, friction and noise; a humanoid that falls."""

import numpy as np
import pytest
from mechanisms import LENGTH_1, random_states, tilted_axis

import scenes
from ident.geometry.inertia import parameters_from_com, pseudo_inertia
from ident.mechanism.motion import BaseMotion
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors
from ident.recordings.wrench import Wrench, total_wrench
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, state_columns, tree_from_model
from sim.simulation.contacts import fall

MODEL = scenes.load("double_pendulum").compile()


def test_bodies_are_physical_and_geoms_weigh_nothing():
    phi = parameters_from_model(MODEL, "base")
    expected = [
        parameters_from_com(4.0, [0, 0, 0], np.diag([0.0044, 0.0044, 0.0072])),
        parameters_from_com(3.7, [0, 0, 0.2], np.diag([0.0103, 0.0103, 0.0067])),
        parameters_from_com(13.2939, [0.1, 0, 0.2], np.diag([0.41, 0.41, 0.05])),
    ]
    np.testing.assert_allclose(phi, np.concatenate(expected), atol=1e-12)
    assert (np.linalg.eigvalsh(pseudo_inertia(phi.reshape(3, 10))) > 0).all()
    assert MODEL.body_pos[3, 2] == LENGTH_1


@pytest.mark.parametrize(("tilt", "azimuth"), [(5, 120), (5, -30), (40, 0)])
def test_tilt_turns_both_axes(tilt, azimuth):
    tilted = scenes.load("double_pendulum", tilt_deg=tilt, azimuth_deg=azimuth).compile()
    np.testing.assert_allclose(tilted.jnt_axis, [tilted_axis(tilt, azimuth)] * 2, atol=1e-12)
    for name in ("body_pos", "body_mass", "sensor_noise", "jnt_range", "actuator_gainprm"):
        np.testing.assert_array_equal(getattr(tilted, name), getattr(MODEL, name))


@pytest.mark.parametrize(("tilt", "azimuth"), [(-1, 0), (90, 0), (np.nan, 0), (5, np.inf)])
def test_senseless_tilts_are_refused(tilt, azimuth):
    with pytest.raises(ValueError, match="from 0° to below 90°"):
        scenes.load("double_pendulum", tilt_deg=tilt, azimuth_deg=azimuth)


ARM = scenes.load("arm").compile()


def test_torques_are_measured_to_a_hundredth_of_the_friction():
    for joint in ("turn", "shoulder", "elbow", "wrist"):
        noise = float(ARM.sensor(f"{joint}_torque").noise[0])
        assert noise == pytest.approx(0.01 * float(ARM.joint(joint).frictionloss[0]))
        assert ARM.sensor(f"{joint}_position").noise[0] == pytest.approx(1e-4)


HUMANOID = scenes.load("humanoid").compile()
TREE, PHI = tree_from_model(HUMANOID, "pelvis"), parameters_from_model(HUMANOID, "pelvis")
GRAVITY = gravity_in_base(HUMANOID, "pelvis")
SENSORS = Sensors(moving_base=True)
FREE = 7, 6, 6
"""Entries of the free joint in qpos, qvel and qacc."""


@pytest.fixture(scope="module")
def motion():
    return fall(HUMANOID, "pelvis", seconds=2.5)


@pytest.fixture(scope="module")
def contacts(motion):
    return [Wrench(wrench, body) for body, wrench in motion.contacts.items()]


def joint_states(motion):
    coordinates, dofs = state_columns(HUMANOID, "pelvis")
    return motion.qpos[:, coordinates], motion.qvel[:, dofs], motion.qacc[:, dofs]


def pelvis(motion):
    free = (x[:, :size] for x, size in zip((motion.qpos, motion.qvel, motion.qacc), FREE, strict=True))
    return BaseMotion.from_free_joint(*free)


@pytest.fixture(scope="module")
def Y(motion):
    return base_wrench_regressor(TREE, *joint_states(motion), gravity=GRAVITY, base=pelvis(motion))


def test_left_and_right_are_mirror_images():
    mirror = np.array([1, -1, 1])
    for b in range(1, HUMANOID.nbody):
        left = HUMANOID.body(b)
        right = HUMANOID.body(left.name.replace("left", "right"))
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
        fall(HUMANOID, "pelvis", seconds=seconds, rate=rate)
