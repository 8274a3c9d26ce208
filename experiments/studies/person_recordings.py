"""Simulated recordings of a person on two force plates who holds a rail, with a laboratory's sensors."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

import scenes
from experiments.data.person import Laboratory
from experiments.studies.noise_processes import autoregressive
from experiments.studies.person_markers import Faults, from_markers
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.geometry.se3 import inverse, pose
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.recording import Recording
from ident.recordings.wrench import Sensor, transform_wrench
from sim.models.mechanism import mechanism
from sim.motion import person
from sim.motion.person import RAIL, Style

BASE = "pelvis"
"""The root body."""

PLATES = {"left": (0.0, 0.25, 0.0), "right": (0.0, -0.25, 0.0)}
"""Centres of the force plates, m; each carries the foot of its side."""

SENSORS = {
    **{side: Sensor(f"{side}_foot", pose(np.eye(3), np.array(at)), True, "world") for side, at in PLATES.items()},
    "rail": Sensor("right_hand", pose(np.eye(3), RAIL), True, "world"),
}
"""Sensors of the wrenches; plates and rail rest in the world."""

HELD = np.array([[4.0, 3.0, 12.0], [6.0, 5.0, 20.0]])
"""Mean and amplitude of the force on the rail, N."""


@lru_cache(maxsize=1)
def humanoid() -> Mechanism:
    """The person, with the true φ as the prior."""
    return mechanism(scenes.load("humanoid"), BASE)


def mistaken(true: Mechanism, rng: np.random.Generator, share: float = 0.2) -> Mechanism:
    """The mechanism with a wrong prior, independently for each body.

    Masses and central moments are wrong by this share, centres of mass by this share of the radius of gyration.
    """
    bodies = []
    for phi in true.known.reshape(-1, 10):
        mass, centre, central = com_from_parameters(phi)
        heavier, thicker = np.exp(share * rng.normal(size=2))
        radius = np.sqrt(np.trace(central) / 2 / mass)
        moved = centre + share * radius * rng.normal(size=3)
        bodies.append(parameters_from_com(heavier * mass, moved, heavier * thicker * central))
    return replace(true, prior=np.concatenate(bodies))


def moved(activity: str, time: np.ndarray, seed: int, *, rail: bool = True, who: Mechanism | None = None) -> Motion:
    """The true motion of an activity at some times, s (N,); the right hand may hold the rail."""
    rng = np.random.default_rng((seed, 0))
    style = Style(pace=float(rng.uniform(0.4, 0.65)), size=float(rng.uniform(0.85, 1.1)), rail=rail, seed=seed)
    return person.motion((who or humanoid()).tree, activity, time, style)


def recorded(
    activity: str,
    seconds: float,
    seed: int,
    laboratory: Laboratory = Laboratory(),  # noqa: B008
    faults: Faults = Faults(),  # noqa: B008
) -> Recording:
    """Recording of an activity by noisy sensors.

    Args:
        activity: One of `sim.motion.person.ACTIVITIES`.
        seconds: Duration, s.
        seed: Seed of the motion and of all noise.
        laboratory: The laboratory.
        faults: Set-up errors.
    """
    time, who = laboratory.times(seconds), faults.true(humanoid())
    true, late = (moved(activity, t, seed, rail=laboratory.rail, who=who) for t in (time, time - laboratory.late))
    recording = sensed(who, time, (true, late), laboratory, np.random.default_rng((seed, 1)), faults=faults)
    provenance = {**recording.provenance, "activity": activity, "seed": seed}
    return replace(recording, setup=laboratory.setup, provenance=provenance)


def sensed(
    who: Mechanism,
    time: np.ndarray,
    motions: tuple[Motion, Motion],
    laboratory: Laboratory,
    rng: np.random.Generator,
    unmeasured: np.ndarray | float = 0.0,
    faults: Faults = Faults(),  # noqa: B008
) -> Recording:
    """Recording of a person by a laboratory's sensors.

    Args:
        who: The person, with a moving pelvis.
        time: Sample times, s (N,).
        motions: Her motion at these times, and at the earlier times that delayed plates and rail measure.
        laboratory: The laboratory.
        rng: Random generator of all noise.
        unmeasured: Wrench on her in the world without a sensor (N, 6).
        faults: Set-up errors of sensors and joints.
    """
    true, late = motions
    measured = {}
    for name, wrench in _wrenches(who, late, rng, laboratory, unmeasured).items():
        std = laboratory.force * (1 if name in PLATES else 1 / 3)
        read = faults.read(name, wrench)
        measured[f"{name}_force"] = read[:, :3] + std * rng.normal(size=(len(read), 3))
        measured[f"{name}_torque"] = read[:, 3:] + std / 10 * rng.normal(size=(len(read), 3))
    true = replace(true, q=faults.shown(who, true.q))
    sensors = {name: sensor for name, sensor in SENSORS.items() if f"{name}_force" in measured}
    if laboratory.markers:
        felt = Recording(time, measured, sensors=sensors)
        return from_markers(humanoid(), who.tree, time, true, (laboratory.marker, laboratory.skin), rng, felt)
    for body, x in zip(who.tree.bodies, who.tree.body_coordinates(true.q), strict=True):
        if body.coordinates:
            measured[f"{body.joint}_position"] = _noisy(x, rng, laboratory)
    assert true.base is not None
    base = true.base.T.copy()
    base[:, :3, 3] += laboratory.position * rng.normal(size=(len(time), 3))
    base[:, :3, :3] = base[:, :3, :3] @ _turns(rng, len(time), laboratory).as_matrix()
    return Recording(time, measured, sensors=sensors, base=base)


def _wrenches(
    who: Mechanism,
    motion: Motion,
    rng: np.random.Generator,
    laboratory: Laboratory,
    unmeasured: np.ndarray | float,
) -> dict[str, np.ndarray]:
    """Wrenches on plates and rail (N, 6), which add up with the unmeasured one to the motion's wrench."""
    base = motion.base
    assert base is not None
    Y = base_wrench_regressor(who.tree, *motion.states, gravity=who.gravity, base=base)
    left_over = transform_wrench(base.T, Y @ who.known) - unmeasured
    sensed = {}
    if laboratory.rail:
        waves = np.sin(2 * np.pi * rng.uniform(0.2, 0.8, 3) * np.arange(len(left_over))[:, None] / laboratory.rate)
        sensed["rail"] = np.hstack([HELD[0] + HELD[1] * waves, np.zeros((len(left_over), 3))])
        left_over = left_over - transform_wrench(SENSORS["rail"].pose, sensed["rail"])
    # The feet share the load by their distances from the centre of pressure.
    aside = left_over[:, 3] / left_over[:, 2]
    poses = base.T[:, None] @ who.tree.poses(motion.q)
    y = {side: poses[:, who.tree.names.index(f"{side}_foot"), 1, 3] for side in PLATES}
    share = np.clip((aside - y["right"]) / (y["left"] - y["right"]), 0, 1)[:, None]
    for name, part in (("left", share), ("right", 1 - share)):
        sensed[name] = transform_wrench(inverse(SENSORS[name].pose), part * left_over)
    return sensed


def _turns(rng: np.random.Generator, samples: int, laboratory: Laboratory) -> Rotation:
    """Small random rotations."""
    noise = np.stack([autoregressive(rng, samples, laboratory.decay) for _ in range(3)], axis=1)
    return Rotation.from_rotvec(np.radians(laboratory.angle_deg) * noise)


def _noisy(x: np.ndarray, rng: np.random.Generator, laboratory: Laboratory) -> np.ndarray:
    """Noisy angles (N,) from (N, 1), or quaternions (N, 4)."""
    if x.shape[1] == 4:
        turned = Rotation.from_quat(x, scalar_first=True) * _turns(rng, len(x), laboratory)
        return np.asarray(turned.as_quat(scalar_first=True))
    noise = autoregressive(rng, len(x), laboratory.decay)
    return np.asarray(x[:, 0] + np.radians(laboratory.angle_deg) * noise)
