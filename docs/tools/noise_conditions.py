"""Subjects and conditions of the study of noise, and the truth; a new condition is a row of `CONDITIONS`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

import scenes
from experiments.data import paper
from experiments.data.paper import SCENE
from experiments.studies.excitation_problem import random_motion
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import drive_names
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.parameters.prior import KNOWN
from sim.models.model_mechanism import mechanism
from sim.models.notes import joint_name
from sim.motion.excitation import BOWING, DOUBLE_PENDULUM, Excitation
from sim.simulation.simulate import RATE


@dataclass(frozen=True, eq=False)
class Subject:
    """A mechanism that moves, with its motion.

    Attributes:
        scene: Name of the scene.
        base: Body whose frame is {0}.
        excitation: The motion; None if each recording has its own.
        samples: Samples of a recording, unless the condition states another number.
    """

    scene: str
    base: str
    excitation: Excitation | None
    samples: int

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the true φ as its prior."""
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
        """The motion commanded to its servos."""
        assert self.excitation is not None
        return Motion(*self.excitation.trajectory(np.arange(self.samples) / RATE))


SUBJECTS: Mapping[str, Subject] = {
    "pendulum": Subject(SCENE, "base", DOUBLE_PENDULUM, paper.SAMPLES),
    "person": Subject("bowing", "foot", BOWING, 3000),
    "arm": Subject("arm", "base", None, 1000),
    "payload": Subject("arm", "base", None, 1000),
}
"""The paper's double pendulum; a person who bows for 30 s on a force plate, with only angles measured; an arm of four
joints, with angles measured, and joint torques, commands or the wrench on its base; and its tool on a sensor."""

OPEN: Mapping[str, Any] = {"known": False, "offsets": True, "drive": []}
"""Identification with constant offsets, as is usual, and without the model's prior, which here is the truth."""

DRIVEN: Mapping[str, Any] = {**OPEN, "drive": ["rotor", "viscous", "coulomb"]}
"""The same with rotor inertia and friction of each joint."""

SLOWING: Mapping[str, Any] = {**OPEN, "drive": [*DRIVEN["drive"], "stribeck"]}
"""The same with Stribeck friction."""

KNOWING = {**OPEN, "known": True}
"""The same with the model's bodies as a prior, which differ from the recorded ones."""


@dataclass(frozen=True)
class Condition:
    """Motion and sensors of recordings. Noise is the scene's by default.

    Attributes:
        subject: One of `SUBJECTS`.
        label: Label in tables and figures.
        scale: Factor on the noise of joint angles, velocities and accelerations.
        decay: Autocorrelation of the angles' noise at a lag of one sample, as an AR(1) process.
        missing: Share of the instants that are not recorded.
        outliers: Share of the angles, forces and torques with additional errors of twenty times the noise.
        compared: True to compare all estimators, False for the trajectory estimate alone.
        motion: Motion drawn for each recording, one of `MOTIONS`; by default the subject's own.
        rate: Samples per second; rates other than `RATE` for drawn motions only.
        samples: Samples of a recording, 0 for the subject's own number.
        rubs: True for friction and rotor inertia in the joints, simulated by MuJoCo; else a drawn motion is exact.
        stribeck: True for rotor inertia and friction by the estimator's law, with Stribeck friction.
        sensors: Sensors of a subject with a drawn motion, out of `wrench`, `torques`, `commands` and `tool`.
        gain: Relative standard deviation, which is stated, of the stated gains of servos, or else of the channels of
            the wrench.
        wrench_scale: Factor on the noise of forces and torques of the ground.
        drift: Noise added to the white noise of the ground's wrench, of equal variance, one of `DRIFTS`.
        freedom: Degrees of freedom of Student's t distribution of all noise, 0 for normal noise.
        steps: Quantisation steps of angles (rad), forces (N) and torques (N m), 0 for none.
        drawn: True to draw each recording's bodies from the prior around the model's.
        options: Options of `ident.identify` for the trajectory estimate; by default no offsets, no held-out samples.
    """

    subject: str
    label: str
    scale: float = 1.0
    decay: float = 0.0
    missing: float = 0.0
    outliers: float = 0.0
    compared: bool = False
    motion: str = ""
    rate: float = RATE
    samples: int = 0
    rubs: bool = False
    stribeck: bool = False
    sensors: tuple[str, ...] = ("wrench",)
    gain: float = 0.0
    wrench_scale: float = 1.0
    drift: str = ""
    freedom: float = 0.0
    steps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drawn: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def length(self) -> int:
        """Samples of a recording."""
        return self.samples or SUBJECTS[self.subject].samples


def _rubbing(label: str, motion: str, rate: float, **others: Any) -> Condition:
    """Condition of an arm with friction, for 20 s."""
    given: dict[str, Any] = {"rubs": True, "sensors": ("torques",), "options": DRIVEN} | others
    return Condition("arm", label, motion=motion, rate=rate, samples=round(20 * rate), **given)


def _on_a_plate(label: str, motion: str, rate: float, seconds: float, **others: Any) -> Condition:
    """Condition of an arm on a force plate, exact except for white noise."""
    return Condition(
        *("arm", label), motion=motion, rate=rate, samples=round(seconds * rate), **({"options": OPEN} | others)
    )


def _carrying(label: str, gain: float = 0.0) -> Condition:
    """Condition of an arm with its tool on a sensor."""
    given: dict[str, Any] = {"sensors": ("tool",), "options": {"offsets": True}}
    return Condition("payload", label, motion="sinusoids", gain=gain, **given)


ENCODER = 2 * np.pi / 2**14
"""Step of an encoder of 14 bits, rad."""

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
    "rubs_sinusoids_200": _rubbing("rubs, sinusoids, 200 Hz", "sinusoids", 200),
    "rubs_trapezoids_100": _rubbing("rubs, trapezoids, 100 Hz", "trapezoids", 100),
    "rubs_trapezoids_500": _rubbing("rubs, trapezoids, 500 Hz", "trapezoids", 500),
    "stribeck": _rubbing("Stribeck friction, 200 Hz", "sinusoids", 200, rubs=False, stribeck=True, options=SLOWING),
    "commands_sinusoids": _rubbing("commands, sinusoids", "sinusoids", 200, sensors=("commands",)),
    "commands_sinusoids_fine": _rubbing(
        "commands, sinusoids, noise ×0.1", "sinusoids", 200, sensors=("commands",), scale=0.1
    ),
    "commands_trapezoids": _rubbing("commands, trapezoids", "trapezoids", 200, sensors=("commands",)),
    "commands_sinusoids_plate": _rubbing(
        "commands, kp ±5 %, wrench, sinusoids", "sinusoids", 200, sensors=("commands", "wrench"), gain=0.05
    ),
    "commands_trapezoids_plate": _rubbing(
        "commands, kp ±5 %, wrench, trapezoids", "trapezoids", 200, sensors=("commands", "wrench"), gain=0.05
    ),
    "trapezoids_100": _on_a_plate("trapezoids, 100 Hz", "trapezoids", 100, 10),
    "trapezoids_500": _on_a_plate("trapezoids, 500 Hz", "trapezoids", 500, 10),
    "trapezoids_1000": _on_a_plate("trapezoids, 1000 Hz", "trapezoids", 1000, 10),
    "trapezoids_1000_strong": _on_a_plate("trapezoids, 1000 Hz, wrench ×10", "trapezoids", 1000, 10, wrench_scale=10),
    "flicker": _on_a_plate("white and 1/f, 12 s", "sinusoids", 100, 12, drift="flicker"),
    "random_walk": _on_a_plate("white and walk, 12 s", "sinusoids", 100, 12, drift="walk"),
    "quantised": Condition("pendulum", "steps of 0.3 N", steps=(ENCODER, 0.3, 0.03), options=OPEN),
    "quantised_alone": _on_a_plate(
        *("steps of 0.3 N, noise ×0.1", "sinusoids", 100, 10), scale=0.1, wrench_scale=0.1, steps=(ENCODER, 0.3, 0.03)
    ),
    "student": Condition("pendulum", "Student's t, 3 d.f.", freedom=3, options=OPEN),
    "short": _on_a_plate("180 samples", "sinusoids", 100, 1.8),
    "torques_and_wrench": _on_a_plate(
        "torques and wrench, 100 Hz", "sinusoids", 100, 10, sensors=("torques", "wrench")
    ),
    "gains": _on_a_plate("gains ±1 %", "sinusoids", 100, 10, gain=0.01),
    "payload": _carrying("payload, 10 s"),
    "payload_gains": _carrying("payload, 10 s, gains ±1 %", gain=0.01),
    "bodies_drawn": Condition("pendulum", "bodies drawn", drawn=True, options=KNOWING),
    "bodies_drawn_x10": Condition(
        "pendulum", "bodies drawn, ×10, 1.5 s", scale=10, wrench_scale=10, samples=150, drawn=True, options=KNOWING
    ),
    "arm_drawn": _on_a_plate("bodies drawn, 3 s", "sinusoids", 100, 3, drawn=True, options=KNOWING),
}
"""Conditions of the study by name; at ×1 and 0.5° the noise is that of the scenes."""


def drawn_bodies(mechanism: Mechanism, rng: np.random.Generator) -> np.ndarray:
    """φ of bodies drawn from the prior around a mechanism's, as in `ident.parameters.prior` (10 b,)."""
    return np.concatenate([_drawn(phi, rng) for phi in mechanism.known.reshape(-1, 10)])


def _drawn(phi: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """φ of a body with independent random errors of mass, centre of mass and central inertia (10,)."""
    mass, center, inertia = com_from_parameters(phi)
    values, axes = np.linalg.eigh(inertia)
    root = (axes * np.sqrt(np.maximum(values, 0))) @ axes.T
    entries = rng.normal(size=(3, 3))
    return parameters_from_com(
        mass * (1 + KNOWN["mass"] * rng.normal()),
        center + KNOWN["center"] * rng.normal(size=3),
        inertia + KNOWN["inertia"] * root @ (entries + entries.T) @ root / 2,
    )


def drives(
    mechanism: Mechanism, model: mujoco.MjModel, *, stribeck: bool = False, delay: float = 0.0
) -> dict[str, float]:
    """Rotor inertia, viscous, Coulomb and perhaps Stribeck friction of each joint in a model, by column name.

    Dampers that act late by a delay, s, as by half a step of Euler's method, are rotors as well.
    """
    addresses = {joint_name(model, j): int(model.jnt_dofadr[j]) for j in range(model.njnt)}
    rotor = model.dof_armature + delay * model.dof_damping
    stated = {"rotor": rotor, "viscous": model.dof_damping, "coulomb": model.dof_frictionloss}
    # Dry joints break loose at one and a half times their friction.
    stated |= {"stribeck": 0.5 * model.dof_frictionloss} if stribeck else {}
    return {
        name: float(values[addresses[joint]])
        for kind, values in stated.items()
        for name, joint in zip(drive_names(mechanism.tree, [kind]), mechanism.tree.joints, strict=True)
    }


def truth(equations: Equations, phi: np.ndarray, stated: Mapping[str, float]) -> np.ndarray:
    """True values of base parameters and drives (r + d,).

    A drive without a column of its own, such as the rotor of a joint that turns a link about a fixed axis, is absorbed
    by base parameters: its column is a combination of theirs.

    Args:
        equations: Equations with the identified columns.
        phi: φ of the bodies (10 b,).
        stated: Values of all drives by name; empty without drives.
    """
    own = np.r_[equations.parameters.regroup(phi), [stated[name] for name in equations.drives]]
    others = [name for name in stated if name not in equations.drives]
    if not others or not equations.torques:
        return own
    columns = _columns(equations.with_drives((*equations.drives, *others)).with_offsets(()))
    kept, taken = columns[:, : len(own)], columns[:, len(own) :]
    sizes = np.linalg.norm(kept, axis=0)
    combined = np.linalg.lstsq(kept / sizes, taken, rcond=None)[0] / sizes[:, None]
    left = np.linalg.norm(taken - kept @ combined, axis=0)
    # Friction that is not identified is not absorbed, and is not part of the parameters' truth.
    is_taken = left < 1e-8 * np.linalg.norm(taken, axis=0)
    return own + combined[:, is_taken] @ np.array([stated[name] for name in others])[is_taken]


def _columns(equations: Equations) -> np.ndarray:
    """Columns at random states, channel by channel (C N, columns)."""
    motion = random_motion(equations.mechanism)
    samples = Samples(motion, np.zeros((len(motion.q), len(equations.channels))))
    blocks = [block[:-1].reshape(len(block) - 1, -1).T.copy() for block in equations.rows(samples)]
    return np.concatenate(blocks)
