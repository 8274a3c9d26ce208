"""Recordings of a robot, an arm and a person with noise, drift, outliers, quantisation and friction; the arm's log."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

import scenes
from docs.tools.noise_conditions import SLOWING, SUBJECTS, Condition, drawn_bodies, drives
from experiments.studies.person_recordings import autoregressive
from ident.files.atomic import replacing
from ident.files.table import vector_columns
from ident.geometry.se3 import inverse
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor, drive_columns, joint_torque_regressor
from ident.recordings.recording import STATES, Recording
from ident.recordings.stated import Servo, model_servo
from ident.recordings.wrench import Sensor, transform_wrench
from sim.motion.excitation import DesiredMotion, Excitation, Trapezoids
from sim.simulation.readings import play, sensors, steps_per_sample
from sim.simulation.simulate import LEAD_IN, servos, simulate, with_noise

FREQUENCIES, ANGLES = np.array([0.15, 0.31, 0.52, 0.78]), np.array([0.5, 0.38, 0.26, 0.16])
"""Frequencies, Hz, and amplitudes, rad, of the sinusoids of each joint, before random scaling."""

GROUND = "ground_force", "ground_torque"
"""Channels of the wrench on the base."""

TOOL, LOAD = "tool", {"tool_force": 0.1, "tool_torque": 0.005}
"""Body that a sensor carries, which has its name, and the sensor's channels with their noise, N and N m."""


def sinusoids(rng: np.random.Generator, joints: int, seconds: float) -> Excitation:
    """Sums of four sinusoids for each joint, with random frequencies, amplitudes and phases, of any duration."""
    frequency = FREQUENCIES * rng.uniform(0.9, 1.1, size=(joints, 4))
    angles = ANGLES * rng.uniform(0.3, 1, size=(joints, 4))
    amplitude = angles * (2 * np.pi * frequency) ** 2
    return Excitation(np.zeros(joints), amplitude, frequency, rng.uniform(0, 2 * np.pi, size=(joints, 4)))


MOTIONS: Mapping[str, Callable[[np.random.Generator, int, float], DesiredMotion]] = {
    "sinusoids": sinusoids,
    "trapezoids": Trapezoids.drawn,
}
"""Motions that are drawn for each recording."""


def noisy_recording(condition: Condition, seed: int, number: int) -> Recording:
    """Recording of a condition by its number; for equal numbers, conditions differ by their sensors alone.

    Args:
        condition: Motion and sensors.
        seed: Seed of the whole study.
        number: Number of the recording.
    """
    exact, _ = exact_recording(condition, seed, number)
    _, white, faults, others, _, gains = _seeds(seed, number)
    exact = _misstated(exact, condition, np.random.default_rng(gains))
    joints = SUBJECTS[condition.subject].mechanism.tree.joints
    states = {f"{joint}_{kind}" for joint in joints for kind in STATES}
    factors = dict.fromkeys(states, condition.scale) | dict.fromkeys(GROUND, condition.wrench_scale)
    noise = {name: level * factors.get(name, 1) for name, level in exact.noise.items()}
    recording = with_noise(replace(exact, noise=noise), np.random.default_rng(white))
    rng = np.random.default_rng(faults)
    measured = _disturbed(recording, condition, rng, np.random.default_rng(others))
    if not condition.missing:
        return replace(recording, measured=measured)
    there = rng.random(exact.time.size) >= condition.missing
    kept, true = ({name: x[there] for name, x in each.items()} for each in (measured, recording.true))
    return replace(recording, time=recording.time[there], measured=kept, true=true)


def exact_recording(condition: Condition, seed: int, number: int) -> tuple[Recording, Motion | None]:
    """The same recording without noise, and its motion if velocities and accelerations are known."""
    who = SUBJECTS[condition.subject]
    own = int(_seeds(seed, number)[0].generate_state(1)[0])
    if who.excitation is None:
        drawn = condition.motion, condition.rate, condition.rubs, condition.stribeck, condition.sensors
        recording, motion = _drawn_motion(condition.subject, condition.length, own, *drawn)
    else:
        # Without noise on the motion all recordings are equal.
        recording = _motion(condition.subject, condition.length, own if who.excitation.noise else 0)
        joints = who.mechanism.tree.joints
        known = all(f"{joint}_{kind}" in recording.true for joint in joints for kind in STATES)
        motion = Motion(*recording.noise_free.joint_states(joints)) if known else None
    if not condition.drawn:
        return recording, motion
    assert motion is not None
    return _of_bodies(recording, condition.subject, motion, true_bodies(condition, seed, number)), motion


def true_bodies(condition: Condition, seed: int, number: int) -> np.ndarray:
    """φ of a recording's bodies (10 b,)."""
    arm = SUBJECTS[condition.subject].mechanism
    return drawn_bodies(arm, np.random.default_rng(_seeds(seed, number)[4])) if condition.drawn else arm.known


def _seeds(seed: int, number: int) -> list[np.random.SeedSequence]:
    """Seeds of a recording's motion, white noise, faults, other noise, bodies, and gains."""
    return np.random.SeedSequence((seed, number)).spawn(6)


def _misstated(recording: Recording, condition: Condition, rng: np.random.Generator) -> Recording:
    """The recording with wrong gains of its servos, or else of its wrenches' channels, and their standard deviation."""
    if not condition.gain:
        return recording
    factors = 1 + condition.gain * rng.normal(size=(max(2, len(recording.servos)), 3))
    if recording.servos:
        drawn = zip(recording.servos.items(), factors[:, 0].tolist(), strict=True)
        stated = {joint: Servo(factor * own.kp, factor * own.kv) for (joint, own), factor in drawn}
        return replace(recording, servos=stated, scales=dict.fromkeys(stated, condition.gain))
    names = GROUND if GROUND[0] in recording.true else LOAD
    wrong = {name: own * recording.true[name] for name, own in zip(names, factors, strict=True)}
    read = {**recording.true, **wrong}
    return replace(recording, measured=read, true=read, setup={"gain": condition.gain})


def _disturbed(
    recording: Recording, condition: Condition, rng: np.random.Generator, others: np.random.Generator
) -> dict[str, np.ndarray]:
    """Channels with autocorrelated noise on angles, outliers, noise from Student's t, drift, and steps."""
    measured, noise = dict(recording.measured), recording.noise
    angles = [f"{joint}_position" for joint in SUBJECTS[condition.subject].mechanism.tree.joints]
    if condition.decay:
        for name in angles:
            drawn = autoregressive(rng, recording.time.size, condition.decay)
            measured[name] = recording.true[name] + noise[name] * drawn
    # Outliers have twenty times the noise's deviation.
    for name in [*angles, *GROUND] if condition.outliers else ():
        gross = (rng.random(measured[name].shape) < condition.outliers) * rng.normal(size=measured[name].shape)
        measured[name] = measured[name] + 20.0 * noise[name] * gross
    for name, true in recording.true.items() if condition.freedom else ():
        if name in noise:
            measured[name] = true + noise[name] * student(others, true.shape, condition.freedom)
    for name in GROUND if condition.drift else ():
        measured[name] = measured[name] + noise[name] * DRIFTS[condition.drift](others, measured[name].shape)
    steps = dict.fromkeys(angles, condition.steps[0]) | dict(zip(GROUND, condition.steps[1:], strict=True))
    return {name: quantised(x, steps.get(name, 0.0)) for name, x in measured.items()}


@lru_cache(maxsize=2)
def _motion(subject: str, samples: int, seed: int) -> Recording:
    who = SUBJECTS[subject]
    assert who.excitation is not None
    return simulate(scenes.load(who.scene), who.excitation, samples=samples, seed=seed)


@lru_cache(maxsize=2)
def _drawn_motion(
    subject: str, samples: int, seed: int, motion: str, rate: float, rubs: bool, stribeck: bool, felt: tuple[str, ...]
) -> tuple[Recording, Motion | None]:
    """A noise-free recording of a drawn motion; simulated by MuJoCo if joints have its friction."""
    who = SUBJECTS[subject]
    spec, joints = scenes.load(who.scene), who.mechanism.tree.joints
    desired = MOTIONS[motion](np.random.default_rng(seed), len(joints), samples / rate)
    if "commands" in felt:
        recording, exact = _commanded(subject, desired, samples, rate), None
    elif rubs:
        recording, exact = simulate(spec, desired, samples=samples, rate=rate, noise_scale=0), None
    else:
        exact = Motion(*desired.trajectory(np.arange(samples) / rate))
        recording = _of_motion(subject, exact, rate, stribeck)
    channels = [f"{joint}_position" for joint in joints]
    channels += _torques(subject) if "torques" in felt else []
    channels += [f"{joint}_command" for joint in recording.servos]
    channels += GROUND if "wrench" in felt else []
    channels += LOAD if TOOL in felt else []
    true = {name: recording.true[name] for name in channels}
    levels = LOAD | {sensor.name: sensor.noise for sensor in sensors(spec.compile())}
    noise = {name: levels.get(name, 0.0) for name in channels}
    places = {TOOL: Sensor(TOOL)} if TOOL in felt else {}
    return replace(recording, measured=true, true=true, noise=noise, sensors=places), exact


def _commanded(subject: str, desired: DesiredMotion, samples: int, rate: float) -> Recording:
    """A recording of servos that hold the command of each sample, by MuJoCo.

    Accelerations jump with the commands and fall until the next one. So the wrench is averaged over the two samples
    about each instant, with weights that fall linearly to zero, as the second differences of the angles are. With
    Euler's method, servos would lag behind by half a step.
    """
    spec, arm = scenes.load(SUBJECTS[subject].scene), SUBJECTS[subject].mechanism
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model = spec.compile()
    driven, steps, lead = servos(model, desired.joints), steps_per_sample(model, rate), round(LEAD_IN * rate)
    time = np.arange(-lead, samples + 1) / rate
    motion = Motion(*desired.trajectory(time))
    commands = driven.commands(time, motion)
    qpos, qvel = model.qpos0[None].copy(), np.zeros((1, model.nv))
    qpos[:, driven.qpos], qvel[:, driven.dof] = motion.q[0], motion.dq[0]
    around = np.arange(-steps, steps + 1)
    instants = (steps * (lead + np.arange(samples))[:, None] + around).ravel()
    read = play(model, qpos, qvel, commands.repeat(steps, axis=0)[None], instants).sensordata[0]
    read = read.reshape(samples, len(around), -1)
    # At the jump, values of both sides are extrapolated from those of two steps.
    weights = 1 - abs(around) / steps
    weights[steps - 2 : steps + 3] += [-0.5, 1, -1, 1, -0.5]
    at, averaged = read[:, steps], np.einsum("nac,a->nc", read, weights / steps)
    channels = {f"{joint}_command": u[lead:-1] for joint, u in zip(arm.tree.joints, commands.T, strict=True)}
    for each in sensors(model):
        part = each.part.start if each.is_scalar else each.part
        channels[each.name] = averaged[:, part] if each.name in GROUND else at[:, part]
    stated = {joint: model_servo(arm, joint) for joint in arm.tree.joints}
    own = {joint: servo for joint, servo in stated.items() if servo is not None}
    return Recording(time[lead:-1], channels, true=channels, servos=own)


def _of_motion(subject: str, motion: Motion, rate: float, stribeck: bool) -> Recording:
    """Angles, torques and wrenches of links without disturbances, or with those of drives."""
    who = SUBJECTS[subject]
    tree, loads = who.mechanism.tree, _loads(subject, motion)
    if stribeck:
        columns = np.concatenate(drive_columns(tree, motion, SLOWING["drive"]), axis=2)
        added = columns @ np.array([*drives(who.mechanism, scenes.load(who.scene).compile(), stribeck=True).values()])
        loads |= {name: loads[name] + x for name, x in zip(_torques(subject), added.T, strict=True)}
    channels = {f"{joint}_position": q for joint, q in zip(tree.joints, motion.q.T, strict=True)} | loads
    return Recording(np.arange(len(motion)) / rate, channels, true=channels)


def _torques(subject: str) -> list[str]:
    """Names of the channels of joint torques."""
    return [f"{joint}_torque" for joint in SUBJECTS[subject].mechanism.tree.joints]


def _loads(subject: str, motion: Motion, phi: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """The wrenches on base and tool and the joint torques of a motion, for the model's links or others."""
    arm = SUBJECTS[subject].mechanism
    phi = arm.known if phi is None else phi
    columns = base_wrench_regressor(arm.tree, *motion.states, gravity=arm.gravity)
    wrench = columns @ phi
    torques = joint_torque_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ phi
    out = dict(zip(_torques(subject), torques.T, strict=True))
    out |= dict(zip(GROUND, (wrench[:, :3], wrench[:, 3:]), strict=True))
    if TOOL in arm.bodies:
        own = slice(10 * arm.bodies.index(TOOL), 10 * arm.bodies.index(TOOL) + 10)
        place = arm.tree.poses(motion.q)[:, arm.tree.names.index(TOOL)]
        load = transform_wrench(inverse(place), columns[..., own] @ phi[own])
        out |= dict(zip(LOAD, (load[:, :3], load[:, 3:]), strict=True))
    return out


def _of_bodies(recording: Recording, subject: str, motion: Motion, phi: np.ndarray) -> Recording:
    """The same motion with other bodies."""
    loads = {name: x for name, x in _loads(subject, motion, phi).items() if name in recording.true}
    true = {**recording.true, **loads}
    return replace(recording, measured=true, true=true)


def flicker(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Noise whose power falls as 1/f, each column of mean zero and variance one (N, …)."""
    samples = shape[0]
    spectrum = np.fft.rfft(rng.normal(size=shape), axis=0)
    falls = np.arange(len(spectrum), dtype=float).reshape(-1, *[1] * (len(shape) - 1)) ** 0.5
    # The constant part is zero.
    falls[0] = np.inf
    return _standard(np.fft.irfft(spectrum / falls, n=samples, axis=0))


def random_walk(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Sums of white noise, each column of mean zero and variance one (N, …)."""
    return _standard(np.cumsum(rng.normal(size=shape), axis=0))


DRIFTS = {"flicker": flicker, "walk": random_walk}
"""Drifting noise, by its name in conditions."""


def student(rng: np.random.Generator, shape: tuple[int, ...], freedom: float) -> np.ndarray:
    """White noise of variance one from Student's t with more than two degrees of freedom."""
    return rng.standard_t(freedom, size=shape) * np.sqrt((freedom - 2) / freedom)


def quantised(x: np.ndarray, step: float) -> np.ndarray:
    """Readings as multiples of a step, unchanged if it is zero."""
    return step * np.round(x / step) if step else x


def _standard(x: np.ndarray) -> np.ndarray:
    """Columns with mean zero and variance one."""
    x = x - x.mean(axis=0)
    return np.asarray(x / x.std(axis=0))


BALL, PLACE, RADIUS = 0.5, (0.06, 0.12, 0.0), 0.03
"""Mass, kg, centre in the tool's frame, m, and radius of the load, a ball, m."""

DECIMALS = {"position": 5, "force": 2, "torque": 3}
"""Decimals of the log by quantity, several of them within the noise."""


def loaded_arm() -> mujoco.MjSpec:
    """The scene `arm` with the load welded to its tool."""
    spec = scenes.load("arm")
    inertia = [0.4 * BALL * RADIUS**2] * 3
    ball = spec.body("tool").add_body(name="load", pos=PLACE)
    ball.mass, ball.ipos, ball.inertia, ball.explicitinertial = BALL, [0, 0, 0], inertia, True
    return spec


def save_log(path: Path) -> None:
    """Writes angles, torques and the wrench of the plate at 100 Hz, along sums of sinusoids, as a controller would."""
    seconds, seed = 12, 2
    motion = sinusoids(np.random.default_rng(seed), 4, seconds)
    log = simulate(loaded_arm(), motion, samples=100 * seconds, seed=seed)
    columns, formats = {"time": log.time}, ["%.2f"]
    for name, values in log.measured.items():
        kind = name.rpartition("_")[2]
        if kind in DECIMALS:
            columns |= (parts := vector_columns(name, values))
            formats += [f"%.{DECIMALS[kind]}f"] * len(parts)
    with replacing(path) as temporary:
        rows = np.column_stack(list(columns.values()))
        np.savetxt(temporary, rows, formats, delimiter=",", header=",".join(columns), comments="", encoding="utf-8")
