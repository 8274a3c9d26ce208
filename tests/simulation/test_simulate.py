"""Simulated recordings against loops over MuJoCo's steps, and models that are simulated with recorded commands."""

from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest
from commands import sentence_of
from random_models import inverse_dynamics, random_model
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from experiments.reports.identify_report import following_lines, following_table
from experiments.studies.user_files import Following, following
from ident.errors import InputError
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.followers import with_servos
from ident.setup import PRIORS
from sim.models.notes import body_name
from sim.motion.excitation import DOUBLE_PENDULUM, Trapezoids
from sim.simulation.readings import COMMAND, ONE_DOF, STATE, sensors
from sim.simulation.simulate import LEAD_IN, RATE, moved_by, servos, simulate, simulate_many
from sim.simulation.stepped import rolled_out

TILT = {"tilt_deg": 5, "azimuth_deg": 120}
JOINTS = ["joint1", "joint2"]
TIME = np.arange(-20, 20) / 20


@pytest.fixture(scope="module")
def recording():
    return simulate(scenes.load("double_pendulum", **TILT), DOUBLE_PENDULUM, seed=1)


def test_all_channels_are_of_the_same_instant_at_which_servos_track_the_excitation(recording):
    arm = sim.mechanism(scenes.load("double_pendulum", **TILT), base="base")
    states = recording.noise_free.joint_states(JOINTS)
    q, _, _ = DOUBLE_PENDULUM.trajectory(recording.time, np.random.default_rng(1).spawn(2)[0])
    assert 0.0003 > recording.provenance["tracking_error_rad"] == pytest.approx(abs(states[0] - q).max())
    wrench = base_wrench_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known
    np.testing.assert_allclose(recording.noise_free.wrench("ground").values, wrench, atol=1e-11 * abs(wrench).max())
    np.testing.assert_allclose(recording.noise_free.poses("link2"), arm.tree.poses(states[0])[:, 2], atol=1e-13)


def test_noise_has_the_declared_levels_and_is_white(recording):
    declared = {s.name: s.noise for s in sensors(scenes.load("double_pendulum", **TILT).compile())}
    assert dict(recording.noise) == declared
    for name, std in declared.items():
        noise = recording[name] - recording.true[name]
        if name.endswith("_orientation"):
            true, measured = (Rotation.from_quat(x[name], scalar_first=True) for x in (recording.true, recording))
            noise = (true.inv() * measured).as_rotvec()
        flat = noise.reshape(len(noise), -1)
        correlation = np.mean(flat[1:] * flat[:-1]) / std**2
        assert np.isclose(noise.std(), std, rtol=0.1) and abs(correlation) < 4 / np.sqrt(flat[1:].size), name


def test_an_arm_follows_moves_at_another_rate():
    spec, moves = scenes.load("arm"), Trapezoids.drawn(np.random.default_rng(0), 4, 2)
    slow, fast = (simulate(spec, moves, samples=round(2 * rate), rate=rate, noise_scale=0) for rate in (100, 500))
    assert fast.rate == pytest.approx(500) and fast.provenance["rate_hz"] == 500
    assert fast.provenance["tracking_error_rad"] < 0.01
    for channel in ("elbow_position", "elbow_torque", "ground_force"):
        np.testing.assert_array_equal(fast[channel][::5], slow[channel])
    assert fast.units["elbow_torque"] == "N m"
    assert "must divide" in sentence_of(simulate, spec, moves, samples=10, rate=300)


def looped(spec, samples, seed):
    """Accelerations and sensors of the forward dynamics at each recorded state, by calls of mj_step."""
    model = spec.compile()
    h, driven = model.opt.timestep, servos(model, 2)
    lead, steps = round(LEAD_IN / h), round(1 / (RATE * h))
    time = np.arange(-lead, (samples - 1) * steps + 1) * h
    desired = Motion(*DOUBLE_PENDULUM.trajectory(time, np.random.default_rng(seed).spawn(2)[0]))
    commands = driven.commands(time, desired)
    moving, reading, state = mujoco.MjData(model), mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, STATE))
    moving.qpos[driven.qpos], moving.qvel[driven.dof] = desired.q[0], desired.dq[0]
    qacc, readings = [], []
    for k, command in enumerate(commands):
        if k >= lead and (k - lead) % steps == 0:
            mujoco.mj_getState(model, moving, state, STATE)
            mujoco.mj_resetData(model, reading)
            mujoco.mj_setState(model, reading, state, STATE)
            mujoco.mj_setState(model, reading, command, COMMAND)
            mujoco.mj_forward(model, reading)
            qacc.append(reading.qacc.copy())
            readings.append(reading.sensordata.copy())
        mujoco.mj_setState(model, moving, command, COMMAND)
        mujoco.mj_step(model, moving)
    return np.array(qacc), np.array(readings)


@pytest.mark.parametrize(
    ("scene", "integrator", "samples"),
    [
        (TILT | {"contact": "pad"}, "IMPLICITFAST", 500),
        ({"contact": "pad handle"}, "IMPLICITFAST", 300),
        *(({"contact": "handle"}, integrator, 50) for integrator in ("EULER", "RK4", "IMPLICIT")),
    ],
)
def test_a_recording_is_what_a_loop_over_steps_records_of_the_forward_dynamics(scene, integrator, samples):
    spec = scenes.load("double_pendulum", **scene)
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    for joint in spec.joints:
        joint.damping = np.full_like(joint.damping, 3.0)
    true = simulate(spec, DOUBLE_PENDULUM, samples=samples, seed=3).true
    qacc, readings = looped(spec, samples, 3)
    for sensor in sensors(spec.compile()):
        if sensor.dof is None:
            np.testing.assert_array_equal(true[sensor.name], np.squeeze(readings[:, sensor.part]))
        else:
            np.testing.assert_allclose(true[sensor.name], qacc[:, sensor.dof], rtol=0, atol=1e-11)


def test_threads_and_company_make_no_difference():
    spec, seeds = scenes.load("double_pendulum", contact="pad handle"), [7, 0, 7]
    alone = [simulate(spec, DOUBLE_PENDULUM, samples=20, seed=seed) for seed in seeds]
    for threads in (1, 3):
        together = simulate_many(spec, DOUBLE_PENDULUM, seeds=seeds, samples=20, threads=threads)
        for one, other in zip(together, alone, strict=True):
            assert one.provenance == other.provenance
            for name in one.true:
                np.testing.assert_array_equal(one.true[name], other.true[name])
                np.testing.assert_array_equal(one[name], other[name])


def test_servos_that_lose_the_excitation_are_refused():
    spec = scenes.load("double_pendulum")
    spec.actuator("servo1").forcerange = [-20, 20]
    with pytest.raises(ValueError, match=r"servo of joint 'joint1' .* after 0\.\d\d s by 0\.\d\d rad: it must"):
        simulate_many(spec, DOUBLE_PENDULUM, seeds=range(3), threads=2)


@pytest.mark.parametrize("seed", range(6))
def test_torques_and_poses_of_driven_joints_are_mujocos(seed):
    """Of some hinges and slides of a random model in any order, in a motion of these."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, int(rng.integers(3, 12)), floating=seed % 3 == 0)
    joints = rng.permutation(np.flatnonzero(np.isin(model.jnt_type, ONE_DOF)))
    joints = joints[: rng.integers(0, len(joints) + 1)]
    states = np.tile(model.qpos0, (len(TIME), 1)), *np.zeros((2, len(TIME), model.nv))
    driven = moved_by(model, joints)
    states[0][:, driven.qpos] += rng.uniform(-3, 3, size=(len(TIME), len(joints)))
    states[1][:, driven.dof], states[2][:, driven.dof] = rng.uniform(-2, 2, size=(2, len(TIME), len(joints)))
    expected, _ = inverse_dynamics(model, *states)
    torques = driven.torques(Motion(states[0][:, driven.qpos], *(x[:, driven.dof] for x in states[1:])))
    np.testing.assert_allclose(torques, expected[:, driven.dof], rtol=0, atol=1e-11 * (1 + abs(expected).max()))
    poses = [driven.poses(body_name(model, b), states[0][:, driven.qpos]) for b in range(1, model.nbody)]
    data = mujoco.MjData(model)
    for k, q in enumerate(states[0]):
        data.qpos = q
        mujoco.mj_kinematics(model, data)
        places, turns = (np.array([pose[part][k] for pose in poses]) for part in (0, 1))
        np.testing.assert_allclose(places, data.xpos[1:], rtol=0, atol=1e-12 * (1 + abs(data.xpos).max()))
        np.testing.assert_allclose(abs((turns * data.xquat[1:]).sum(axis=1)), 1, atol=1e-12)


@cache
def mechanism(**drives):
    return sim.mechanism(mujoco.MjSpec.from_string(driven_arm.text(more=driven_arm.ACTUATORS, **drives)))


@cache
def commanded(lag=0, noise=1.0):
    time, channels = driven_arm.commanded(8.0, lag=lag, noise=noise)
    return with_servos(ident.Recording(time, channels), {}, mechanism(), [])


def error(q, log):
    return np.sqrt(((q - log.of_joints(driven_arm.JOINTS, "position")) ** 2).mean(axis=0))


def test_the_true_model_follows_what_its_servos_did_by_the_lag_of_its_commands():
    log, late = commanded(noise=0.0), commanded(lag=2)
    assert (error(rolled_out(mechanism(), log), log) < 2e-3).all()
    weak = mechanism(armature=(0.6, 0.5, 0.2), damping=(3.0, 3.0, 1.0))
    assert (error(rolled_out(weak, log), log) > 1e-2).all()
    now, later = (error(rolled_out(mechanism(), late, lag=lag), late) for lag in (0.0, 0.02))
    assert (later < 0.5 * now).all()


def test_every_joint_of_the_model_needs_a_command():
    log = commanded()
    without = ident.Recording(log.time, log.measured, servos={"turn": log.servos["turn"]})
    assert "needs a command of every joint; lift, bend have none" in sentence_of(rolled_out, mechanism(), without)
    crate = '<worldbody><body name="crate"><freejoint name="loose"/><geom size="1"/></body>'
    text = driven_arm.text().replace("<worldbody>", crate)
    arm = sim.mechanism(mujoco.MjSpec.from_string(text), "column")
    with pytest.raises(InputError, match=r"of every joint of the model; .*loose"):
        rolled_out(arm, log)


def test_the_updated_model_follows_as_well_as_the_true_one():
    """Of the estimate from the first part of a recording, on the rest of it; the model as it came is the true one."""
    exact = dict.fromkeys(PRIORS, 0.0)
    followed = following(ident.identify(mechanism(), commanded(), setup=exact))
    assert (followed.after < 1.2 * followed.before).all() and followed.seconds == pytest.approx(3.2, abs=0.1)
    assert followed.units == ("rad",) * 3


@pytest.mark.parametrize(
    ("before", "after", "better", "words", "row"),
    [
        ([0.02, 0.03], [0.01, 0.033], 1, "follows 1 of 2 joints better than the model as it came", [0.02, 0.01, 0.5]),
        ([0.02, 0.03], [0.01, 0.033], 1, "0.80 of the other's", [0.02, 0.01, 0.5]),
        ([np.nan, np.nan], [0.01, 0.02], 2, "and the model as it came diverges.", [None, 0.01, None]),
        ([0.1, 0.1], [np.nan, np.nan], 0, "diverges", [0.1, None, None]),
    ],
)
def test_the_report_says_how_well_models_follow(before, after, better, words, row):
    made = Following(("a", "b"), ("rad", "m"), np.array(before), np.array(after), 9.4)
    assert made.better == better and words in following_lines(made)[0]
    assert following_table(made).rows[0][1:4] == pytest.approx(row)
