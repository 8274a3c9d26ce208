"""Recordings of a robot and of a person whose joint sensors are noisy in many ways."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.signal import lfilter

import scenes
from experiments.cli.defaults import SCENE
from experiments.studies import paper
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.recordings.recording import STATES, Recording
from sim.models.mechanism import mechanism
from sim.motion.excitation import BOWING, DOUBLE_PENDULUM, Excitation
from sim.simulation.simulate import RATE, simulate, with_noise

GROSS = 20.0
"""Standard deviation of outliers, in that of the noise."""


@dataclass(frozen=True, eq=False)
class Subject:
    """Who moves.

    Attributes:
        scene: Name of the scene.
        base: Body whose frame is {0}.
        excitation: The motion.
        samples: Samples of a recording.
    """

    scene: str
    base: str
    excitation: Excitation
    samples: int

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the true φ for its prior."""
        return mechanism(scenes.load(self.scene), self.base)

    @cached_property
    def parameters(self) -> BaseParameters:
        """Its base parameters."""
        return structural_base_parameters(self.mechanism)

    @cached_property
    def true(self) -> np.ndarray:
        """Their true values (r,)."""
        return self.parameters.regroup(self.mechanism.known)

    @property
    def commanded(self) -> Motion:
        """The motion that its servos are told to follow."""
        return Motion(*self.excitation.trajectory(np.arange(self.samples) / RATE))


SUBJECTS: Mapping[str, Subject] = {
    "pendulum": Subject(SCENE, "base", DOUBLE_PENDULUM, paper.SAMPLES),
    "person": Subject("bowing", "foot", BOWING, 3000),
}
"""The paper's double pendulum; and a person who bows for 30 s on a force plate, and whose angles alone are measured."""


@dataclass(frozen=True)
class Condition:
    """How the sensors err. The wrench's noise is the scene's.

    Attributes:
        subject: One of `SUBJECTS`.
        label: What readers call it.
        scale: Factor on the noise of joint angles, velocities and accelerations.
        decay: Correlation of the angles' noise from one sample to the next, that of an AR(1) process.
        missing: Share of the instants that are not recorded.
        outliers: Share of the angles, forces and torques that have `GROSS` errors besides.
        compared: Whether all estimators are compared, not the joint one alone.
    """

    subject: str
    label: str
    scale: float = 1.0
    decay: float = 0.0
    missing: float = 0.0
    outliers: float = 0.0
    compared: bool = False


CONDITIONS: Mapping[str, Condition] = {
    "pendulum_x1": Condition("pendulum", "noise ×1", compared=True),
    "pendulum_x3": Condition("pendulum", "noise ×3", scale=3, compared=True),
    "pendulum_x10": Condition("pendulum", "noise ×10", scale=10, compared=True),
    "pendulum_ar80": Condition("pendulum", "noise ×3, AR 0.80", scale=3, decay=0.8),
    "pendulum_ar95": Condition("pendulum", "noise ×3, AR 0.95", scale=3, decay=0.95),
    "pendulum_missing": Condition("pendulum", "5 % missing", missing=0.05),
    "pendulum_outliers": Condition("pendulum", "1 % outliers", outliers=0.01),
    "person_half_degree": Condition("person", "noise 0.5°", compared=True),
    "person_one_degree": Condition("person", "noise 1°", scale=2, compared=True),
    "person_ar95": Condition("person", "noise 0.5°, AR 0.95", decay=0.95, compared=True),
}
"""What is looked at; at ×1 and 0.5° the noise is that of the scenes."""


def noisy_recording(condition: Condition, seed: int, number: int) -> Recording:
    """One of many recordings; those of the same number differ between conditions by their sensors alone.

    Args:
        condition: How the sensors err.
        seed: Seed of the whole study.
        number: Number of the recording.
    """
    motions, sensors, faults = np.random.SeedSequence((seed, number)).spawn(3)
    exact = _simulated(condition.subject, int(motions.generate_state(1)[0]))
    joints = SUBJECTS[condition.subject].mechanism.tree.joints
    states = {f"{joint}_{kind}" for joint in joints for kind in STATES}
    angles = [f"{joint}_position" for joint in joints]
    noise = {name: level * (condition.scale if name in states else 1) for name, level in exact.noise.items()}
    recording = with_noise(replace(exact, noise=noise), np.random.default_rng(sensors))
    measured, rng = dict(recording.measured), np.random.default_rng(faults)
    if condition.decay:
        for name in angles:
            measured[name] = exact.true[name] + noise[name] * autoregressive(rng, exact.time.size, condition.decay)
    for name in [*angles, "ground_force", "ground_torque"] if condition.outliers else ():
        gross = (rng.random(measured[name].shape) < condition.outliers) * rng.normal(size=measured[name].shape)
        measured[name] = measured[name] + GROSS * noise[name] * gross
    there = rng.random(exact.time.size) >= condition.missing if condition.missing else slice(None)
    kept, true = ({name: x[there] for name, x in each.items()} for each in (measured, recording.true))
    return replace(recording, time=recording.time[there], measured=kept, true=true)


def autoregressive(rng: np.random.Generator, samples: int, decay: float) -> np.ndarray:
    """Noise of variance one, `x_k = ρ x_k-1 + √(1 - ρ²) u_k` with white u (N,)."""
    u = rng.normal(size=samples)
    u[1:] *= np.sqrt(1 - decay**2)
    return np.asarray(lfilter([1.0], [1.0, -decay], u))


def _simulated(subject: str, seed: int) -> Recording:
    """A simulation with noise on its motion; without, every one is the same."""
    return _motion(subject, seed if SUBJECTS[subject].excitation.noise else 0)


@lru_cache(maxsize=2)
def _motion(subject: str, seed: int) -> Recording:
    who = SUBJECTS[subject]
    return simulate(scenes.load(who.scene), who.excitation, samples=who.samples, seed=seed)
