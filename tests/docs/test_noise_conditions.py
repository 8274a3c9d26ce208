"""Conditions of the study of noise beyond white noise on smooth motions: they are as described, and run."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import scenes
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS, drives, truth
from docs.tools.noise.recordings import GROUND, LOAD, MOTIONS, exact_recording
from ident.estimation.preparation import prepared
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from ident.regression.ordinary import least_squares
from sim.simulation.simulate import simulate

ARM = SUBJECTS["arm"]
NEW = {name: each for name, each in CONDITIONS.items() if each.options}
RUBS = [name for name, each in NEW.items() if each.rubs]


def shortened(name):
    """A condition with the fewest samples that keep its meaning, for quick tests."""
    condition = NEW[name]
    most = {"rubs_sinusoids_200": 500, "rubs_trapezoids_100": 250, "rubs_trapezoids_500": 500}
    most |= {"trapezoids_500": 600, "trapezoids_1000": 600, "trapezoids_1000_strong": 600, "random_walk": 250}
    return replace(condition, samples=min(most.get(name, 400), condition.length))


def with_rates(seed, motion):
    """MuJoCo's recording of the arm, with sensors of velocities and accelerations."""
    spec = scenes.load("arm")
    for joint in ARM.mechanism.tree.joints:
        of = {"objtype": mujoco.mjtObj.mjOBJ_JOINT, "objname": joint}
        spec.add_sensor(name=f"{joint}_velocity", type=mujoco.mjtSensor.mjSENS_JOINTVEL, **of)
        own = spec.add_sensor(name=f"{joint}_acceleration", type=mujoco.mjtSensor.mjSENS_USER, dim=1, **of)
        own.datatype, own.needstage = mujoco.mjtDataType.mjDATATYPE_REAL, mujoco.mjtStage.mjSTAGE_ACC
    desired = MOTIONS[motion](np.random.default_rng(seed), 4, 6)
    return simulate(spec, desired, samples=1200, rate=200, noise_scale=0)


@pytest.mark.parametrize("motion", MOTIONS)
def test_exact_states_of_an_arm_that_rubs_give_rotors_friction_and_base_parameters(motion):
    """At velocities at which MuJoCo's friction, smoothed near rest, is complete."""
    recording = with_rates(0, motion)
    states = Motion(*recording.joint_states(ARM.mechanism.tree.joints))
    channels = {k: x for k, x in recording.measured.items() if not k.startswith("ground")}
    ready = prepared(
        ARM.mechanism, replace(recording, measured=channels, true={}), drive=CONDITIONS[RUBS[0]].options["drive"]
    )
    sliding = (np.abs(states.dq) > 0.1).all(axis=1)
    assert 100 < sliding.sum() < len(sliding)
    fit = least_squares(ready.equations, Samples(states, ready.samples.measured)[sliding])
    stated = drives(ARM.mechanism, scenes.load("arm").compile())
    expected = truth(ready.equations, ARM.mechanism.known, stated)
    np.testing.assert_allclose(fit.values, expected, atol=1e-9)
    values = dict(zip(ready.equations.names, expected, strict=True))
    assert values["Fc(shoulder)"] == 2 and values["Fv(turn)"] == 2 and values["Ia(wrist)"] == pytest.approx(0.03)
    # The rotor of a joint with a fixed axis is inseparable from the link's inertia about it.
    assert "Ia(turn)" not in values
    links = dict(zip(ready.equations.names, ready.equations.parameters.regroup(ARM.mechanism.known), strict=False))
    assert values["Izz2"] == pytest.approx(links["Izz2"] + 0.3)


@pytest.mark.parametrize("name", ["trapezoids_100", "torques_and_wrench", "payload"])
def test_motions_that_are_drawn_need_what_mujoco_says(name):
    recording, motion = exact_recording(CONDITIONS[name], 0, 0)
    spec = scenes.load("arm")
    spec.body("tool").add_site(name="tool")
    for channel, kind in zip(LOAD, (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE), strict=True):
        spec.add_sensor(name=channel, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="tool")
    model = spec.compile()
    data, part = mujoco.MjData(model), {s: model.sensor(s) for s in (*GROUND, *LOAD) if s in recording.true}
    for k in range(5, len(motion), 97):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion.q[k], motion.dq[k], motion.ddq[k]
        mujoco.mj_inverse(model, data)
        for channel, sensor in part.items():
            read = data.sensordata[sensor.adr[0] : sensor.adr[0] + 3]
            np.testing.assert_allclose(recording.true[channel][k], read, atol=1e-8)
        if "turn_torque" in recording.true:
            links = data.qfrc_inverse - model.dof_armature * data.qacc + data.qfrc_passive + data.qfrc_constraint
            torques = recording.torques(ARM.mechanism.tree.joints)[k]
            np.testing.assert_allclose(torques, links, atol=1e-8)
