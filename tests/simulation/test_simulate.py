"""Simulated recordings against loops over MuJoCo's steps, and models that are simulated with recorded commands."""

from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics, random_model
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from experiments.reports.identify_report import following_lines, following_table
from experiments.studies.user_files import Following, following
from ident.errors import InputError, ModelError
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.faults import with_servos
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, tree_from_model
from sim.models.notes import body_name
from sim.motion.excitation import DOUBLE_PENDULUM, Trapezoids
from sim.simulation.commanded import rolled_out
from sim.simulation.readings import COMMAND, ONE_DOF, STATE, sensors
from sim.simulation.simulate import LEAD_IN, RATE, SAMPLES, TOGETHER, moved_by, servos, simulate, simulate_many


@pytest.fixture(scope="module")
def spec():
    return scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120)


@pytest.fixture(scope="module")
def recording(spec):
    return simulate(spec, DOUBLE_PENDULUM, seed=1)


def test_servos_track_the_excitation(recording):
    assert recording.provenance["tracking_error_rad"] < 0.0003
    excitation_rng, _ = np.random.default_rng(1).spawn(2)
    q, _, _ = DOUBLE_PENDULUM.trajectory(recording.time, excitation_rng)
    measured = recording.noise_free.joint_states(["joint1", "joint2"])[0]
    assert abs(measured - q).max() == pytest.approx(recording.provenance["tracking_error_rad"])


def test_all_channels_are_of_the_same_instant(spec, recording):
    model = spec.compile()
    truth = recording.noise_free
    states = truth.joint_states(["joint1", "joint2"])
    tree, phi = tree_from_model(model, "base"), parameters_from_model(model, "base")
    wrench = base_wrench_regressor(tree, *states, gravity=gravity_in_base(model, "base")) @ phi
    np.testing.assert_allclose(truth.wrench("ground").values, wrench, atol=1e-11 * abs(wrench).max())
    np.testing.assert_allclose(truth.poses("link2"), tree.poses(states[0])[:, 2], atol=1e-13)


def test_noise_has_the_declared_levels_and_is_white(spec, recording):
    declared = {s.name: s.noise for s in sensors(spec.compile())}
    assert dict(recording.noise) == declared
    for name, std in declared.items():
        if name.endswith("_orientation"):
            true, measured = (Rotation.from_quat(x[name], scalar_first=True) for x in (recording.true, recording))
            noise = (true.inv() * measured).as_rotvec()
        else:
            noise = recording[name] - recording.true[name]
        assert np.isclose(noise.std(), std, rtol=0.1), name
        flat = noise.reshape(len(noise), -1)
        correlation = np.mean(flat[1:] * flat[:-1]) / std**2
        assert abs(correlation) < 4 / np.sqrt(flat[1:].size), name


def test_an_arm_follows_moves_at_another_rate():
    spec, moves = scenes.load("arm"), Trapezoids.drawn(np.random.default_rng(0), 4, 2)
    slow, fast = (simulate(spec, moves, samples=round(2 * rate), rate=rate, noise_scale=0) for rate in (100, 500))
    assert fast.rate == pytest.approx(500) and fast.provenance["rate_hz"] == 500
    assert fast.provenance["tracking_error_rad"] < 0.01
    for channel in ("elbow_position", "elbow_torque", "ground_force"):
        np.testing.assert_array_equal(fast[channel][::5], slow[channel])
    assert fast.units["elbow_torque"] == "N m"
    with pytest.raises(ModelError, match="must divide"):
        simulate(spec, moves, samples=10, rate=300)


TILT = {"tilt_deg": 5, "azimuth_deg": 120}
SCENES = ({}, TILT, TILT | {"contact": "pad"}, TILT | {"contact": "handle"}, {"contact": "pad handle"})


def looped(spec, samples, seed):
    """The true channels by calls of mj_step, with readings at a copy of each recorded state."""
    model = spec.compile()
    reader = spec.compile()
    reader.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    reader.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    h, driven = model.opt.timestep, servos(model, 2)
    lead, steps = round(LEAD_IN / h), round(1 / (RATE * h))
    time = np.arange(-lead, (samples - 1) * steps + 1) * h
    desired = Motion(*DOUBLE_PENDULUM.trajectory(time, np.random.default_rng(seed).spawn(2)[0]))
    commands = driven.commands(time, desired)
    moving, reading, state = mujoco.MjData(model), mujoco.MjData(reader), np.empty(mujoco.mj_stateSize(model, STATE))
    moving.qpos[driven.qpos], moving.qvel[driven.dof] = desired.q[0], desired.dq[0]
    readings, forward = [], []
    for k, command in enumerate(commands):
        if k >= lead and (k - lead) % steps == 0:
            mujoco.mj_getState(model, moving, state, STATE)
            for act in (mujoco.mj_forward, mujoco.mj_step):
                mujoco.mj_resetData(reader, reading)
                mujoco.mj_setState(reader, reading, state, STATE)
                mujoco.mj_setState(reader, reading, command, COMMAND)
                act(reader, reading)
                if act is mujoco.mj_forward:
                    forward.append((reading.qacc.copy(), reading.sensordata.copy()))
            readings.append(reading.sensordata.copy())
            for sensor in sensors(model):
                if sensor.dof is not None:
                    rate = (reading.qvel - moving.qvel) / h
                    readings[-1][sensor.part] = rate[sensor.dof]
        mujoco.mj_setState(model, moving, command, COMMAND)
        mujoco.mj_step(model, moving)
    qacc, sensordata = (np.array(x) for x in zip(*forward, strict=True))
    return {s.name: np.squeeze(np.array(readings)[:, s.part]) for s in sensors(model)}, qacc, sensordata


def assert_same(recording, other):
    assert recording.provenance == other.provenance
    for name in recording.true:
        np.testing.assert_array_equal(recording.true[name], other.true[name])
        np.testing.assert_array_equal(recording[name], other[name])


@pytest.mark.parametrize("scene", SCENES, ids=str)
def test_a_recording_is_what_a_loop_over_steps_records(scene):
    spec = scenes.load("double_pendulum", **scene)
    recording = simulate(spec, DOUBLE_PENDULUM, seed=3)
    for name, expected in looped(spec, SAMPLES, 3)[0].items():
        np.testing.assert_array_equal(recording.true[name], expected)


@pytest.mark.parametrize("integrator", ["EULER", "RK4", "IMPLICIT", "IMPLICITFAST"])
def test_accelerations_and_sensors_are_those_of_the_forward_dynamics_at_the_recorded_state(integrator):
    spec = scenes.load("double_pendulum", contact="handle")
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    for joint in spec.joints:
        joint.damping = np.full_like(joint.damping, 3.0)
    recording = simulate(spec, DOUBLE_PENDULUM, samples=50, seed=3)
    readings, qacc, sensordata = looped(spec, 50, 3)
    for sensor in sensors(spec.compile()):
        true = recording.true[sensor.name]
        np.testing.assert_array_equal(true, readings[sensor.name])
        if sensor.dof is None:
            np.testing.assert_array_equal(true, np.squeeze(sensordata[:, sensor.part]))
        else:
            np.testing.assert_allclose(true, qacc[:, sensor.dof], rtol=0, atol=1e-12)


@pytest.mark.parametrize("scene", SCENES[-1:], ids=str)
def test_threads_and_company_make_no_difference(scene):
    spec = scenes.load("double_pendulum", **scene)
    seeds = [7, 0, 5, 0, *range(100, 100 + TOGETHER)]
    alone = [simulate(spec, DOUBLE_PENDULUM, samples=60, seed=seed) for seed in seeds]
    for threads in (1, 3):
        together = simulate_many(spec, DOUBLE_PENDULUM, seeds=seeds, samples=60, threads=threads)
        for one, other in zip(together, alone, strict=True):
            assert_same(one, other)


def test_servos_that_lose_the_excitation_are_refused():
    spec = scenes.load("double_pendulum")
    spec.actuator("servo1").forcerange = [-20, 20]
    with pytest.raises(ValueError, match=r"lost the excitation after 0\.\d\d s by 0\.\d\d rad: it must stay") as e:
        simulate_many(spec, DOUBLE_PENDULUM, seeds=range(3), threads=2)
    assert "servo of joint 'joint1'" in str(e.value)


TIME = np.arange(-20, 20) / 20


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


@cache
def mechanism(**drives):
    return sim.mechanism(mujoco.MjSpec.from_string(driven_arm.text(more=driven_arm.ACTUATORS, **drives)))


@cache
def commanded(lag=0, noise=1.0):
    time, channels = driven_arm.commanded(lag=lag, noise=noise)
    return with_servos(ident.Recording(time, channels), {}, mechanism(), [])


def error(q, log):
    """RMS error of simulated coordinates (n,)."""
    return np.sqrt(((q - log.of_joints(driven_arm.JOINTS, "position")) ** 2).mean(axis=0))


def test_the_true_model_follows_what_its_servos_did():
    log = commanded(noise=0.0)
    assert (error(rolled_out(mechanism(), log), log) < 2e-3).all()
    weak = mechanism(armature=(0.6, 0.5, 0.2), damping=(3.0, 3.0, 1.0))
    assert (error(rolled_out(weak, log), log) > 1e-2).all()


def test_commands_act_later_by_the_lag():
    log = commanded(lag=2)
    now, later = (error(rolled_out(mechanism(), log, lag=lag), log) for lag in (0.0, 0.02))
    assert (later < 0.5 * now).all()


def test_every_joint_of_the_model_needs_a_command():
    log = commanded()
    without = ident.Recording(log.time, log.measured, servos={"turn": log.servos["turn"]})
    with pytest.raises(InputError, match="needs a command of every joint; lift, bend have none"):
        rolled_out(mechanism(), without)
    crate = '<worldbody><body name="crate"><freejoint name="loose"/><geom size="1"/></body>'
    text = driven_arm.text().replace("<worldbody>", crate)
    arm = sim.mechanism(mujoco.MjSpec.from_string(text), "column")
    with pytest.raises(InputError, match=r"of every joint of the model; .*loose"):
        rolled_out(arm, log)


def test_the_updated_model_follows_as_well_as_the_true_one():
    """Of the estimate from the first part of a recording, on the rest of it."""
    result = ident.identify(mechanism(), commanded())
    followed = following(result)
    # Here the model as it came is the true one.
    assert (followed.after < 1.2 * followed.before).all() and followed.seconds == pytest.approx(4.8, abs=0.1)
    assert followed.units == ("rad",) * 3


def test_the_report_says_how_well_models_follow():
    made = Following(("a", "b"), ("rad", "m"), np.array([0.02, 0.03]), np.array([0.01, 0.033]), 9.4)
    assert made.better == 1
    (line,) = following_lines(made)
    assert "follows 1 of 2 joints better than the model as it came" in line and "0.80 of the other's" in line
    table = following_table(made)
    assert table.rows[0][0] == "a" and table.rows[1][3] == pytest.approx(1.1)
    came = Following(("a",), ("rad",), np.array([np.nan]), np.array([0.01]), 9.4)
    assert came.better == 1 and "and the model as it came diverges." in following_lines(came)[0]
    assert following_table(came).rows[0][1] is None
    assert "diverges" in following_lines(Following(("a",), ("rad",), np.array([0.1]), np.array([np.nan]), 1.0))[0]
