"""Conditions of the study of noise beyond white noise on smooth motions: they are as described, and run."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import scenes
from docs.tools.noise import counts
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS, drives, truth
from docs.tools.noise.estimators import Case
from docs.tools.noise.recordings import GROUND, LOAD, MOTIONS, exact_recording, noisy_recording, true_bodies
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rubs_trapezoids_100", "commands_sinusoids", "bodies_drawn_x10", "payload"])
def test_conditions_run_from_end_to_end(name, monkeypatch):
    monkeypatch.setattr(counts, "CONDITIONS", {name: shortened(name)})
    tasks = counts.tasks(2 if NEW[name].subject == "pendulum" else 1, [name])
    collected = [counts.fits(0, task) for task in tasks]
    for outcome in collected:
        answer = outcome["trajectory"]
        assert "refused" not in answer
        numbers = [answer[key] for key in ("error", "std", "true", "std_setup")]
        assert {len(each) for each in numbers} == {len(answer["names"])} and np.isfinite(numbers).all()
        assert (np.array(answer["std_setup"]) >= np.array(answer["std"]) * (1 - 1e-9)).all()
        assert any(each.startswith("Fc(") for each in answer["names"]) == (NEW[name].rubs or NEW[name].stribeck)
    if len(tasks) > 1:
        table = counts.table_coverage(counts.by_estimator(tasks, collected))
        row = dict(zip(table.columns, table.rows[0], strict=True))
        assert row["recordings"] == 2 and row["setup_reported"] in (0, 0.5, 1)


@pytest.mark.parametrize("name", [name for name, each in NEW.items() if not each.rubs and each.subject != "payload"])
def test_exact_states_give_the_truth(name):
    condition = NEW[name]
    recording, motion = exact_recording(condition, 0, 1)
    arm, phi = SUBJECTS[condition.subject].mechanism, true_bodies(condition, 0, 1)
    assert (phi != arm.known).any() == condition.drawn
    equations = prepared(arm, noisy_recording(condition, 0, 1), drive=condition.options["drive"]).equations
    # Unprepared: at jumps of the acceleration, prepared wrenches lack samples that look like outliers.
    channels = [name for name in GROUND if "wrench" in condition.sensors]
    channels += [f"{arm.tree.freedoms[k]}_torque" for k in equations.torques]
    fit = least_squares(equations, Samples(motion, np.column_stack([recording.true[name] for name in channels])))
    expected = truth(equations, phi, Case(condition, recording, phi).drives)
    np.testing.assert_allclose(fit.values, expected, rtol=1e-6, atol=2e-3)


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


def answer(names, error, std, wide, setup=()):
    """An answer in the form of workers."""
    true = np.full(len(names), 2.0).tolist()
    return {"names": names, "error": error, "std": std, "true": true, "std_setup": wide, "setup": list(setup)}
