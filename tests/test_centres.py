"""Joints that lie elsewhere than in the model, and predictions for a new motion, against MuJoCo."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from random_models import ARM, inverse_dynamics, random_model_states
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench
from slow_pendulum import TIME, motion

import ident
import scenes
import sim
from ident.estimation.equations import COMPONENTS
from ident.identification import checked_setup
from ident.mechanism.motion import Motion
from ident.recordings.mapping import stated_mapping
from ident.recordings.recording import STATES
from ident.recordings.wrench import Sensor
from ident.setup import PRIORS
from sim.motion.excitation import DOUBLE_PENDULUM

NOISE = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
"""Noise of the scene's wrench, N and N m."""


def recorded(longer, seed=0):
    """Angles and wrench of the pendulum with another length of the first link."""
    rng, (base, first, second) = np.random.default_rng(seed), PENDULUM.tree.bodies
    home = second.home.copy()
    home[:3, 3] *= longer
    states = motion(rng, 1.0)
    tree = replace(PENDULUM.tree, bodies=(base, first, replace(second, home=home)))
    wrench = ident.base_wrench_regressor(tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    wrench += NOISE * rng.normal(size=wrench.shape)
    return angles_and_wrench(TIME, states[0] + 1e-3 * rng.normal(size=states[0].shape), wrench)


@cache
def identified(longer):
    return stated(longer)


def stated(longer, **setup):
    return ident.identify(PENDULUM, recorded(longer), drive=[], holdout=0.0, setup=setup)


def test_a_link_that_is_15_percent_longer_is_found_though_no_robot_is_so_inexact():
    estimate = identified(1.15)
    (finding,) = estimate.setup
    assert finding.name == "centre_z(joint2)" and abs(finding.value - 0.15 * 0.425) < 2 * finding.std < 0.03
    assert "from the joint 'joint1' than in the model, ± 4.4 mm if the rest of the set-up is right." in finding.text
    assert (abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
    taken = stated(1.15, centre=0.0)
    assert (abs(taken.psi - TRUTH) > 3 * taken.std_setup).any()
    home = estimate.fit.equations.mechanism.tree.bodies[2].home
    np.testing.assert_allclose(home[:3, 3], [0, 0, 0.425 + finding.value])


def test_an_estimate_and_a_model_with_joints_displaced_predict_other_motions(tmp_path):
    estimate = identified(1.15)
    states = motion(np.random.default_rng(1), 1.0)
    tree = PENDULUM.tree
    home = tree.bodies[2].home.copy()
    home[:3, 3] *= 1.15
    true = replace(tree, bodies=(*tree.bodies[:2], replace(tree.bodies[2], home=home)))
    expected = ident.base_wrench_regressor(true, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    # Those parameters included that no channel shows where joints lie as in the model.
    assert ((estimate.predict(Motion(*states)) - expected).std(axis=0) < NOISE).all()
    errors = []
    for displaced in (estimate.displaced, {}):
        sim.write_model(tmp_path / "new.xml", PENDULUM, estimate.consistent(), displaced=displaced)
        new = sim.mechanism(tmp_path / "new.xml", base="base")
        wrench = ident.base_wrench_regressor(new.tree, *states, gravity=new.gravity) @ new.known
        errors.append(np.linalg.norm(wrench - expected, axis=0)[[1, 2, 3]])
    assert (errors[0] < 0.3 * errors[1]).all()


def test_centres_are_in_the_intervals_though_none_is_found():
    others = dict.fromkeys(PRIORS, 0.0)
    exact, open_, wide = (stated(1.0, **others | {"centre": std}) for std in (0.0, 0.001, {"joint2": 0.01}))
    assert not open_.setup and not wide.setup
    np.testing.assert_allclose(open_.psi, exact.psi)
    grows = np.array([open_.std_setup / exact.std_setup, wide.std_setup / open_.std_setup])
    assert (grows > 1 - 1e-9).all() and (grows.max(axis=1) > [1.01, 1.5]).all(), grows


@pytest.mark.parametrize(
    ("centre", "message"),
    [
        (-1, "centre needs a standard deviation, zero or false, got -1."),
        ("a", "centre needs a standard deviation, zero or false, got a."),
        ({"joint3": 0.01}, "centre has no entry 'joint3'; valid are joint1, joint2."),
        ({"joint2": "a"}, "centre.joint2 needs a standard deviation, zero or false, got a."),
        ({"joint2": -0.01}, "centre.joint2 needs a standard deviation, zero or false, got -0.01."),
    ],
)
def test_what_is_stated_of_centres_is_checked(centre, message):
    for read in (
        lambda setup: stated_mapping({"setup": setup}, PENDULUM.tree),
        lambda setup: checked_setup(setup, PENDULUM.tree.compounds),
    ):
        with pytest.raises(ident.InputError) as error:
            read({"centre": centre})
        assert str(error.value) == f"setup.{message}"


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
    """A sensor that is turned and off the base's origin, with five components, and one or two joint torques."""
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
