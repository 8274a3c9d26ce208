"""Joints that lie elsewhere than in the model, and predictions for a new motion, against MuJoCo."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from mechanisms import by_joint
from random_models import ARM, inverse_dynamics, random_model_states
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench
from slow_pendulum import TIME, motion

import ident
import sim
from ident import Motion, Sensor
from ident.identification import checked_setup
from ident.recordings.mapping import stated_mapping
from ident.recordings.recording import STATES
from ident.setup import PRIORS

NOISE = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
"""Noise of the scene's wrench, N and N m."""


def wrench_of(longer, states):
    """Wrench of the pendulum with another length of the first link (N, 6)."""
    base, first, second = PENDULUM.tree.bodies
    home = second.home.copy()
    home[:3, 3] *= longer
    tree = replace(PENDULUM.tree, bodies=(base, first, replace(second, home=home)))
    return ident.base_wrench_regressor(tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known


def stated(longer, **setup):
    rng = np.random.default_rng(0)
    states = motion(rng, 1.0)
    wrench = wrench_of(longer, states) + NOISE * rng.normal(size=(len(TIME), 6))
    recording = angles_and_wrench(TIME, states[0] + 1e-3 * rng.normal(size=states[0].shape), wrench)
    return ident.identify(PENDULUM, recording, drive=[], holdout=0.0, setup=setup)


@cache
def longer():
    return stated(1.15)


def test_a_link_that_is_15_percent_longer_is_found_though_no_robot_is_so_inexact():
    (finding,), taken = longer().setup, stated(1.15, centre=0.0)
    assert finding.name == "centre_z(joint2)" and abs(finding.value - 0.15 * 0.425) < 2 * finding.std < 0.03
    assert "from the joint 'joint1' than in the model, ± 4.4 mm if the rest of the set-up is right." in finding.text
    assert (abs(longer().psi - TRUTH) < 3 * longer().std_setup).all()
    assert (abs(taken.psi - TRUTH) > 3 * taken.std_setup).any()
    home = longer().fit.equations.mechanism.tree.bodies[2].home
    np.testing.assert_allclose(home[:3, 3], [0, 0, 0.425 + finding.value])


def test_an_estimate_and_a_model_with_joints_displaced_predict_other_motions(tmp_path):
    states, errors = motion(np.random.default_rng(1), 1.0), []
    expected = wrench_of(1.15, states)
    # Those parameters included that no channel shows where joints lie as in the model.
    assert ((longer().predict(Motion(*states)) - expected).std(axis=0) < NOISE).all()
    for displaced in (longer().displaced, {}):
        sim.write_model(tmp_path / "new.xml", PENDULUM, longer().consistent(), displaced=displaced)
        new = sim.mechanism(tmp_path / "new.xml", base="base")
        wrench = ident.base_wrench_regressor(new.tree, *states, gravity=new.gravity) @ new.known
        errors.append(np.linalg.norm(wrench - expected, axis=0)[[1, 2, 3]])
    assert (errors[0] < 0.3 * errors[1]).all()


def test_centres_are_in_the_intervals_though_none_is_found():
    others = dict.fromkeys(PRIORS, 0.0)
    exact, open_ = (stated(1.0, **others | {"centre": std}) for std in (0.0, {"joint2": 0.01}))
    assert not open_.setup
    np.testing.assert_allclose(open_.psi, exact.psi)
    grows = open_.std_setup / exact.std_setup
    assert grows.min() > 1 - 1e-9 and grows.max() > 1.5


def test_what_is_stated_of_centres_is_checked():
    largest = r"^setup\.centre\(joint2\) needs a standard deviation, zero or false, got 11; the largest is 10\.$"
    with pytest.raises(ident.InputError, match=largest):
        stated_mapping({"setup": {"centre": {"joint2": 11}}}, PENDULUM.tree)
    for centre, message in (
        ({"joint2": 11}, largest),
        ({"elbow": 0.01}, r"no entry 'centre\(elbow\)'; valid .*joint2"),
    ):
        with pytest.raises(ident.InputError, match=message):
            checked_setup({"centre": centre}, PENDULUM.tree.compounds)


@pytest.mark.parametrize(("felt", "offsets"), [(("shoulder", "elbow"), False), (("elbow",), True)])
def test_predictions_are_mujocos_in_the_sensors_own_channels(felt, offsets):
    """Of a sensor that is turned and off the base's origin, with five components, and some joint torques."""
    turned = ARM.replace('name="ground"', 'name="ground" pos=".1 0 -.05" euler="0 20 0"')
    model = mujoco.MjModel.from_xml_string(turned)
    arm, data, pose, there = sim.mechanism(model, base="base"), mujoco.MjData(model), np.eye(4), [0, 2, 3, 4, 5]
    mujoco.mj_kinematics(model, data)
    pose[:3, :3], pose[:3, 3] = data.site("ground").xmat.reshape(3, 3), data.site("ground").xpos

    def recorded(seed):
        states = random_model_states(np.random.default_rng(seed), model, 200)
        torques, wrench = inverse_dynamics(model, *states)
        measured = np.where(np.isin(range(6), there), wrench, np.nan)
        channels = by_joint(arm.tree.joints, **dict(zip(STATES, states, strict=True)))
        channels |= {"ground_force": measured[:, :3], "ground_torque": measured[:, 3:]}
        channels |= by_joint(felt, torque=torques[:, 2 - len(felt) :])
        recording = ident.Recording(np.arange(200) / 100, channels, sensors={"ground": Sensor(None, pose)})
        return recording, Motion(*states), np.hstack([wrench[:, there], torques[:, 2 - len(felt) :]])

    recording, (_, other, expected) = recorded(0)[0], recorded(1)
    options = {"estimator": "weighted", "offsets": offsets, "drive": ("rotor", "viscous")}
    estimate = ident.identify(arm, recording, holdout=0, **options)
    assert estimate.channels == ("Fx", "Fz", "Mx", "My", "Mz", *felt)
    predicted = estimate.predict(other)
    assert predicted.shape == expected.shape
    np.testing.assert_allclose(predicted, expected, rtol=0, atol=1e-6 * abs(expected).max())
