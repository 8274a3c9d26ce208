"""Recordings of a robot, an arm and a person with noise, drift, outliers, quantisation and friction."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

import scenes
from experiments.noise.conditions import SUBJECTS, Condition
from experiments.noise.truth import drawn_bodies
from experiments.studies.noise_processes import DRIFTS, autoregressive, quantised, student
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.recordings.recording import STATES, Recording
from sim.motion.excitation import DesiredMotion, Excitation
from sim.motion.trapezoids import Trapezoids
from sim.simulation.sensors import sensors
from sim.simulation.simulate import simulate, with_noise

GROSS = 20.0
"""Standard deviation of outliers, over that of the noise."""

FREQUENCIES, ANGLES = np.array([0.15, 0.31, 0.52, 0.78]), np.array([0.5, 0.38, 0.26, 0.16])
"""Frequencies, Hz, and amplitudes, rad, of the sinusoids of each joint, before random scaling."""

GROUND = "ground_force", "ground_torque"
"""Channels of the wrench on the base."""


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
    _, white, faults, others, _ = _seeds(seed, number)
    joints = SUBJECTS[condition.subject].mechanism.tree.joints
    states = {f"{joint}_{kind}" for joint in joints for kind in STATES}
    factors = dict.fromkeys(states, condition.scale) | dict.fromkeys(GROUND, condition.wrench_scale)
    noise = {name: level * factors.get(name, 1) for name, level in exact.noise.items()}
    recording = with_noise(replace(exact, noise=noise), np.random.default_rng(white))
    rng = np.random.default_rng(faults)
    measured = _at_fault(recording, condition, rng)
    measured = _unusual(replace(recording, measured=measured), condition, np.random.default_rng(others))
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
        drawn = condition.motion, condition.rate, condition.rubs, condition.sensors
        recording, motion = _drawn_motion(condition.subject, condition.length, own, *drawn)
    else:
        # Without noise on the motion all recordings are equal.
        recording = _motion(condition.subject, condition.length, own if who.excitation.noise else 0)
        motion = _motion_of(recording, who.mechanism.tree.joints)
    if not condition.drawn:
        return recording, motion
    assert motion is not None
    return _of_bodies(recording, condition.subject, motion, true_bodies(condition, seed, number)), motion


def true_bodies(condition: Condition, seed: int, number: int) -> np.ndarray:
    """φ of a recording's bodies (10 b,)."""
    arm = SUBJECTS[condition.subject].mechanism
    return drawn_bodies(arm, np.random.default_rng(_seeds(seed, number)[4])) if condition.drawn else arm.known


def _seeds(seed: int, number: int) -> list[np.random.SeedSequence]:
    """Seeds of a recording's motion, white noise, faults, other noise, and bodies."""
    return np.random.SeedSequence((seed, number)).spawn(5)


def _at_fault(recording: Recording, condition: Condition, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Channels with autocorrelated noise on angles, and with outliers."""
    measured, noise = dict(recording.measured), recording.noise
    angles = [f"{joint}_position" for joint in SUBJECTS[condition.subject].mechanism.tree.joints]
    if condition.decay:
        for name in angles:
            drawn = autoregressive(rng, recording.time.size, condition.decay)
            measured[name] = recording.true[name] + noise[name] * drawn
    for name in [*angles, *GROUND] if condition.outliers else ():
        gross = (rng.random(measured[name].shape) < condition.outliers) * rng.normal(size=measured[name].shape)
        measured[name] = measured[name] + GROSS * noise[name] * gross
    return measured


def _unusual(recording: Recording, condition: Condition, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Channels with noise from Student's t, with drift, and quantised."""
    measured, noise = dict(recording.measured), recording.noise
    for name, true in recording.true.items() if condition.freedom else ():
        if name in noise:
            measured[name] = true + noise[name] * student(rng, true.shape, condition.freedom)
    for name in GROUND if condition.drift else ():
        measured[name] = measured[name] + noise[name] * DRIFTS[condition.drift](rng, measured[name].shape)
    angles = [f"{joint}_position" for joint in SUBJECTS[condition.subject].mechanism.tree.joints]
    steps = dict.fromkeys(angles, condition.steps[0]) | dict(zip(GROUND, condition.steps[1:], strict=True))
    return {name: quantised(x, steps.get(name, 0.0)) for name, x in measured.items()}


def _motion_of(recording: Recording, joints: Sequence[str]) -> Motion | None:
    """Motion of a recording; None if it lacks joint states."""
    channels = [f"{joint}_{kind}" for joint in joints for kind in STATES]
    known = all(name in recording.true for name in channels)
    return Motion(*recording.noise_free.joint_states(joints)) if known else None


@lru_cache(maxsize=2)
def _motion(subject: str, samples: int, seed: int) -> Recording:
    who = SUBJECTS[subject]
    assert who.excitation is not None
    return simulate(scenes.load(who.scene), who.excitation, samples=samples, seed=seed)


@lru_cache(maxsize=2)
def _drawn_motion(
    subject: str, samples: int, seed: int, motion: str, rate: float, rubs: bool, felt: tuple[str, ...]
) -> tuple[Recording, Motion | None]:
    """A noise-free recording of a drawn motion; simulated by MuJoCo if joints have friction."""
    who = SUBJECTS[subject]
    spec, joints = scenes.load(who.scene), who.mechanism.tree.joints
    desired = MOTIONS[motion](np.random.default_rng(seed), len(joints), samples / rate)
    if rubs:
        recording, exact = simulate(spec, desired, samples=samples, rate=rate, noise_scale=0), None
    else:
        exact = Motion(*desired.trajectory(np.arange(samples) / rate))
        recording = _of_motion(subject, exact, rate)
    channels = [f"{joint}_position" for joint in joints]
    channels += [f"{joint}_torque" for joint in joints] if "torques" in felt else []
    channels += GROUND if "wrench" in felt else []
    true = {name: recording.true[name] for name in channels}
    levels = {sensor.name: sensor.noise for sensor in sensors(spec.compile())}
    noise = {name: levels[name] for name in channels}
    return replace(recording, measured=true, true=true, noise=noise), exact


def _of_motion(subject: str, motion: Motion, rate: float) -> Recording:
    """Angles, torques and base wrench of links without disturbances."""
    joints = SUBJECTS[subject].mechanism.tree.joints
    angles = {f"{joint}_position": q for joint, q in zip(joints, motion.q.T, strict=True)}
    empty = Recording(np.arange(len(motion)) / rate, angles | _loads(subject, motion))
    return replace(empty, true=empty.measured)


def _loads(subject: str, motion: Motion, phi: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """The base wrench and the joint torques of a motion, for the model's links or others."""
    arm = SUBJECTS[subject].mechanism
    phi = arm.known if phi is None else phi
    wrench = base_wrench_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ phi
    torques = joint_torque_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ phi
    of_joints = {f"{joint}_torque": x for joint, x in zip(arm.tree.joints, torques.T, strict=True)}
    return dict(zip(GROUND, (wrench[:, :3], wrench[:, 3:]), strict=True)) | of_joints


def _of_bodies(recording: Recording, subject: str, motion: Motion, phi: np.ndarray) -> Recording:
    """The same motion with other bodies."""
    loads = {name: x for name, x in _loads(subject, motion, phi).items() if name in recording.true}
    true = {**recording.true, **loads}
    return replace(recording, measured=true, true=true)
