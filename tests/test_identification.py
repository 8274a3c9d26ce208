"""Predictions of an estimate for a new motion, against MuJoCo."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from random_models import ARM, inverse_dynamics, random_model_states

import ident
import scenes
import sim
from ident.estimation.equations import COMPONENTS
from ident.recordings.recording import STATES
from ident.recordings.wrench import Sensor
from sim.motion.excitation import DOUBLE_PENDULUM


def simulated(excitation, **changes):
    return sim.simulate(scenes.load("double_pendulum"), replace(excitation, **changes), samples=300, noise_scale=0)


@pytest.mark.parametrize("offsets", [False, True])
def test_the_wrench_of_another_motion_is_mujocos(offsets):
    arm = sim.mechanism(scenes.load("double_pendulum"), base="base")
    estimate = ident.identify(arm, simulated(DOUBLE_PENDULUM), offsets=offsets, holdout=0, estimator="weighted")
    other = simulated(DOUBLE_PENDULUM, phase=DOUBLE_PENDULUM.phase + 1, frequency=1.3 * DOUBLE_PENDULUM.frequency)
    predicted = estimate.predict(ident.Motion(*other.joint_states(arm.tree.joints)))
    # Without noise Fx is zero in the pendulum's plane, and is no channel.
    assert estimate.channels == COMPONENTS[1:] and predicted.shape == (300, 5)
    np.testing.assert_allclose(predicted, other.wrench("ground").values[:, 1:], rtol=0, atol=1e-6)
    with pytest.raises(ident.InputError, match="Joint velocities need 2 columns"):
        estimate.predict(ident.Motion(np.zeros((3, 2)), np.zeros((3, 1)), np.zeros((3, 2))))


@pytest.mark.parametrize("felt", [("shoulder", "elbow"), ("elbow",)])
def test_channels_are_the_sensors_own(felt):
    """A sensor that is turned and off the base's origin, with five components, and joint torques.

    A joint without measured torque has drive columns of zeros before those of the other one.
    """
    turned = ARM.replace('name="ground"', 'name="ground" pos=".1 0 -.05" euler="0 20 0"')
    model = mujoco.MjModel.from_xml_string(turned)
    arm = sim.mechanism(model, base="base")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.site("ground").xmat.reshape(3, 3), data.site("ground").xpos
    there = [0, 2, 3, 4, 5]

    def recorded(seed):
        states = random_model_states(np.random.default_rng(seed), model, 200)
        torques, wrench = inverse_dynamics(model, *states)
        measured = np.where(np.isin(range(6), there), wrench, np.nan)
        channels = {"ground_force": measured[:, :3], "ground_torque": measured[:, 3:]}
        for k, joint in enumerate(arm.tree.joints):
            channels |= {f"{joint}_{kind}": x[:, k] for kind, x in zip(STATES, states, strict=True)}
            channels |= {f"{joint}_torque": torques[:, k]} if joint in felt else {}
        recording = ident.Recording(np.arange(200) / 100, channels, sensors={"ground": Sensor(None, pose)})
        return recording, ident.Motion(*states), np.hstack([wrench[:, there], torques[:, -len(felt) :]])

    recording, _, _ = recorded(0)
    estimate = ident.identify(arm, recording, drive=("rotor", "viscous"), holdout=0, estimator="weighted")
    assert estimate.channels == ("Fx", "Fz", "Mx", "My", "Mz", *felt)
    _, motion, expected = recorded(1)
    predicted = estimate.predict(motion)
    assert predicted.shape == expected.shape
    np.testing.assert_allclose(predicted, expected, rtol=0, atol=1e-6 * abs(expected).max())
