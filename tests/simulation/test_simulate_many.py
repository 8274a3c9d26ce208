"""Simulations in MuJoCo's thread pool: bit for bit those of a loop over steps, in any number of threads."""

import mujoco
import numpy as np
import pytest

import scenes
from ident.mechanism.motion import Motion
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.readings import COMMAND, STATE, sensors
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
    with pytest.raises(
        ValueError, match=r"lost the excitation after 0\.\d\d s by 0\.\d\d rad: it must stay within"
    ) as e:
        simulate_many(spec, DOUBLE_PENDULUM, seeds=range(3), threads=2)
    assert "servo of joint 'joint1'" in str(e.value)
