"""Simulations in MuJoCo's thread pool: bit for bit those of a loop over steps, in any number of threads."""

import mujoco
import numpy as np
import pytest

import scenes
from ident.mechanism.motion import Motion
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.rollout import COMMAND, STATE
from sim.simulation.sensors import sensors
from sim.simulation.servos import servos
from sim.simulation.simulate import LEAD_IN, RATE, SAMPLES, TOGETHER, simulate, simulate_many

TILT = {"tilt_deg": 5, "azimuth_deg": 120}
SCENES = ({}, TILT, TILT | {"contact": "pad"}, TILT | {"contact": "handle"}, {"contact": "pad handle"})


def looped(spec, samples, seed):
    """The true channels by calls of mj_step, with readings at a copy of each recorded state.

    Returns:
        Readings by channel; and MuJoCo's own qacc and sensordata at the recorded states (N, nv) and (N, nsensordata).
    """
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


@pytest.mark.parametrize("scene", SCENES[1:], ids=str)
def test_threads_and_company_make_no_difference(scene):
    spec = scenes.load("double_pendulum", **scene)
    seeds = [7, 0, 5, 0, *range(100, 100 + TOGETHER)]
    alone = [simulate(spec, DOUBLE_PENDULUM, samples=60, seed=seed) for seed in seeds]
    for threads in (1, 2, 3):
        together = simulate_many(spec, DOUBLE_PENDULUM, seeds=seeds, samples=60, threads=threads)
        for one, other in zip(together, alone, strict=True):
            assert_same(one, other)


def test_threads_are_as_many_as_processors_where_nobody_says():
    spec = scenes.load("double_pendulum")
    first, second = (
        simulate_many(spec, DOUBLE_PENDULUM, seeds=np.arange(3), samples=5, threads=threads) for threads in (None, 1)
    )
    for a, b in zip(first, second, strict=True):
        assert_same(a, b)


def test_a_longer_recording_begins_with_the_shorter_one():
    spec = scenes.load("double_pendulum", contact="pad")
    short, long = (simulate(spec, DOUBLE_PENDULUM, samples=samples) for samples in (1, 120))
    for name, x in short.true.items():
        np.testing.assert_array_equal(long.true[name][:1], x)


def test_no_seeds_no_recordings():
    assert simulate_many(scenes.load("double_pendulum"), DOUBLE_PENDULUM, seeds=[]) == []


def test_a_simulation_needs_a_thread():
    with pytest.raises(ValueError, match="at least one thread, got 0"):
        simulate_many(scenes.load("double_pendulum"), DOUBLE_PENDULUM, seeds=[1], threads=0)


def test_servos_that_lose_the_excitation_are_refused():
    spec = scenes.load("double_pendulum")
    spec.actuator("servo1").forcerange = [-20, 20]
    with pytest.raises(
        ValueError, match=r"lost the excitation after 0\.\d\d s by 0\.\d\d rad: it must stay within"
    ) as e:
        simulate_many(spec, DOUBLE_PENDULUM, seeds=range(3), threads=2)
    assert "servo of joint 'joint1'" in str(e.value)


@pytest.mark.parametrize("reset", [True, False])
def test_a_simulation_that_diverges_is_refused(reset, tmp_path, monkeypatch):
    # By itself MuJoCo writes a log into the working folder, and by default it resets the motion and goes on.
    monkeypatch.chdir(tmp_path)
    spec = scenes.load("double_pendulum")
    for actuator in spec.actuators:
        actuator.forcelimited = False
        actuator.gainprm[0], actuator.biasprm[1] = 1e9, -1e9
    if not reset:
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    with pytest.raises(ValueError, match=r"lost the excitation after 0\.00 s by nan rad"):
        simulate(spec, DOUBLE_PENDULUM, samples=3)
    assert not list(tmp_path.iterdir())


def test_a_bystander_that_diverges_is_no_recording_either(tmp_path, monkeypatch):
    # It falls ever faster, until MuJoCo resets it and with it the arm, which tracked well all the time.
    monkeypatch.chdir(tmp_path)
    spec = scenes.load("double_pendulum")
    body = spec.worldbody.add_body(mass=1, inertia=[1, 1, 1], explicitinertial=True)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], damping=-15, limited=False)
    assert simulate(spec, DOUBLE_PENDULUM, samples=20).provenance["tracking_error_rad"] < 0.001
    with pytest.raises(ValueError, match=r"lost the excitation after 0\.[34]\d s by nan rad"):
        simulate(spec, DOUBLE_PENDULUM, samples=60)
    assert not list(tmp_path.iterdir())
