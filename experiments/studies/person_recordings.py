"""Recordings of a simulated person in a laboratory with known faults: noise, set-up errors, markers on skin."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

import scenes
from ident.estimation.noise import autoregressive as filtered
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.geometry.se3 import inverse, pose
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor
from ident.recordings.recording import Recording
from ident.recordings.wrench import Sensor, transform_wrench
from sim.markers.marked_model import MarkedModel, marked_model
from sim.markers.trial_fit import check_fit, fit_trial
from sim.markers.trial_recording import recording
from sim.models.model_mechanism import mechanism
from sim.models.model_update import updated_spec
from sim.motion import person
from sim.motion.person import RAIL, Style

CAREFUL = {
    "origin": 0.001,
    "rotation": np.radians(0.1),
    "gain": 0.002,
    "gravity": np.radians(0.05),
    "zero": np.radians(0.5),
    "axis": np.radians(0.5),
    "centre": 0.0,
}
"""Set-up uncertainty of a laboratory with calibrated plates and joints, as `ident.setup.PRIORS`."""


@dataclass(frozen=True)
class Laboratory:
    """Noise and set-up errors of a laboratory.

    Attributes:
        angle_deg: Standard deviation of joint angles, degrees.
        decay: Autocorrelation of their noise at a lag of one sample.
        position: Standard deviation of the pelvis's position, m.
        force: Standard deviation of the plates' forces, N; a tenth of it for moments, N m; a third for the rail.
        late: Delay of plates and rail, s.
        rate: Samples per second, Hz.
        rail: True if there is a rail to hold.
        markers: True if angles and the pelvis's pose are fitted to markers, instead of having noise of their own.
        marker: Standard deviation of the markers' positions, m.
        skin: Standard deviation of the skin's motion, m; see `from_markers`.
        setup: Uncertainty of its set-up, as `CAREFUL`, which its recordings state.
    """

    angle_deg: float = 0.5
    decay: float = 0.0
    position: float = 0.002
    force: float = 1.5
    late: float = 0.02
    rate: float = 100.0
    rail: bool = True
    markers: bool = False
    marker: float = 0.002
    skin: float = 0.004
    setup: Mapping[str, float] = field(default_factory=lambda: CAREFUL)

    def times(self, seconds: float) -> np.ndarray:
        """Sample times of a recording of this length, s (N,)."""
        return np.arange(round(seconds * self.rate)) / self.rate


BASE = "pelvis"
"""The root body."""


@dataclass(frozen=True, eq=False)
class Faults:
    """Set-up errors with one person in one laboratory.

    Attributes:
        tilts: Rotations of joint axes about the point on them that is next to the body's origin, by joint.
        gravity: Rotation of gravity.
        frames: Poses of the sensors' frames in their stated frames (4, 4).
        gains: Readings of a sensor's six channels for one unit (6,).
        zeros: Zero errors of joints, rad.
        centres: Displacements of joints in their parents' frames, by the compounds' names, m (3,).
    """

    tilts: Mapping[str, Rotation] = field(default_factory=dict)
    gravity: Rotation = field(default_factory=Rotation.identity)
    frames: Mapping[str, np.ndarray] = field(default_factory=dict)
    gains: Mapping[str, np.ndarray] = field(default_factory=dict)
    zeros: Mapping[str, float] = field(default_factory=dict)
    centres: Mapping[str, np.ndarray] = field(default_factory=dict)

    def true(self, who: Mechanism) -> Mechanism:
        """The person with true axes, centres and gravity, from the stated one."""
        bodies = [self._tilted(body) for body in who.tree.bodies]
        for joint, shift in self.centres.items():
            body = bodies[first := who.tree.compounds[joint][0]]
            bodies[first] = replace(body, home=pose(body.home[:3, :3], body.home[:3, 3] + shift))
        return replace(who, tree=Tree(tuple(bodies)), gravity=self.gravity.as_matrix() @ who.gravity)

    def read(self, sensor: str, wrench: np.ndarray) -> np.ndarray:
        """Reading of a sensor for a wrench in the stated frame (N, 6)."""
        there = transform_wrench(inverse(self.frames[sensor]), wrench) if sensor in self.frames else wrench
        return there * self.gains.get(sensor, 1.0)

    def shown(self, who: Mechanism, q: np.ndarray) -> np.ndarray:
        """Readings of the joints for their coordinates (N, n_q)."""
        parts = who.tree.body_coordinates(q)
        joints = zip(who.tree.bodies, parts, strict=True)
        return np.hstack([x + self.zeros.get(body.joint, 0.0) if x.size else x for body, x in joints])

    def _tilted(self, body: Body) -> Body:
        if body.joint not in self.tilts:
            return body
        v, w = np.split(body.twist, 2)
        point, axis = np.cross(w, v), self.tilts[body.joint].as_matrix() @ w
        return replace(body, twist=np.concatenate([np.cross(point, axis), axis]))


def drawn(who: Mechanism, sensors: Iterable[str], known: Mapping[str, float], rng: np.random.Generator) -> Faults:
    """Random set-up errors.

    Args:
        who: The person.
        sensors: Names of her contacts.
        known: Standard deviations, as `CAREFUL`; kinds that are missing have no error.
        rng: Random generator.
    """

    def by_chance(kind: str, number: int) -> np.ndarray:
        return known.get(kind, 0.0) * rng.normal(size=number)

    hinges = [body.joint for body in who.tree.bodies if body.coordinates and body.turns]
    frames = {
        name: pose(Rotation.from_rotvec(by_chance("rotation", 3)).as_matrix(), by_chance("origin", 3))
        for name in sensors
    }
    return Faults(
        tilts={joint: Rotation.from_rotvec(by_chance("axis", 3)) for joint in hinges},
        gravity=Rotation.from_rotvec(by_chance("gravity", 3)),
        frames=frames,
        gains={name: 1 + by_chance("gain", 6) for name in frames},
        zeros={joint: float(by_chance("zero", 1)[0]) for joint in hinges},
        centres={joint: by_chance("centre", 3) for joint in who.tree.compounds},
    )


def from_markers(
    who: Mechanism,
    tree: Tree,
    time: np.ndarray,
    motion: Motion,
    size: tuple[float, float],
    rng: np.random.Generator,
    felt: Recording,
) -> Recording:
    """Recording with angles and base pose fitted to noisy markers, as by `multicontact angles`.

    Skin moves over bone at random, correlated over about 0.3 s, and shifts as the joint turns, each marker in its own
    direction: per radian by twice the standard deviation of the random motion.

    Args:
        who: The stated person, whose joints the fit uses.
        tree: Her true joints.
        time: Times of the frames, s (N,).
        motion: Her motion.
        size: Standard deviations of the markers' positions and of the skin's motion, m.
        rng: Random generator of all noise.
        felt: Measurements of plates and rail on the same clock.
    """
    marked, places = _marked(who)
    poses = tree.poses(motion.q)
    if motion.base is not None:
        poses = motion.base.T[:, None] @ poses
    turns = tree.body_coordinates(motion.q)
    noise, skin = size
    decay = np.exp(-float(np.median(np.diff(time))) / 0.3)
    measured = []
    for body, place in places:
        i = tree.names.index(body)
        by_chance = np.stack([autoregressive(rng, len(time), decay) for _ in range(3)], axis=1)
        slides = 2 * _direction(rng) * _turned(turns[i])[:, None]
        own = place + skin * (by_chance + slides)
        at = poses[:, i, :3, 3] + (poses[:, i, :3, :3] @ own[..., None])[..., 0]
        measured.append(at + noise * rng.normal(size=at.shape))
    postures = fit_trial(marked, np.stack(measured, axis=1))
    check_fit(postures)
    return recording(postures, time, who.tree.names[0], {"sigma_m": postures.sigma}, felt)


def _turned(coordinates: np.ndarray) -> np.ndarray:
    """Angle of a body's joint from its home, rad (N,): from angles (N, 1), quaternions (N, 4) or nothing (N, 0)."""
    if coordinates.shape[1] == 4:
        return 2 * np.arctan2(np.linalg.norm(coordinates[:, 1:], axis=1), np.abs(coordinates[:, 0]))
    return coordinates.sum(axis=1)


def _direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector (3,)."""
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


@lru_cache(maxsize=2)
def _marked(who: Mechanism) -> tuple[MarkedModel, list[tuple[str, np.ndarray]]]:
    """The model with four markers on each body with mass, and these bodies and positions in their frames.

    Markers are at random points of the ellipsoid with the body's mass and moments of inertia.
    """
    spec, rng, places = updated_spec(who, who.known), np.random.default_rng(0), []
    labels = []
    for body, phi in zip(who.bodies, who.known.reshape(-1, 10), strict=True):
        mass, centre, central = com_from_parameters(phi)
        moments, axes = np.linalg.eigh(central)
        # Moments of an ellipsoid of half-axes a: m (a_j² + a_k²) / 5.
        half = np.sqrt(np.maximum(5 / mass * (moments.sum() / 2 - moments), 0))
        for k in range(4):
            place = centre + axes @ (half * _direction(rng))
            labels.append(f"{body}_marker{k}")
            spec.body(body).add_site(name=labels[-1], pos=place)
            places.append((body, place))
    marked, _ = marked_model(spec, labels)
    return marked, places


def autoregressive(rng: np.random.Generator, samples: int, decay: float) -> np.ndarray:
    """Noise of variance one, `x_k = ρ x_k-1 + √(1 - ρ²) u_k` with white u (N,)."""
    u = rng.normal(size=samples)
    u[1:] *= np.sqrt(1 - decay**2)
    return filtered(u, decay)


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


def mistaken(true: Mechanism, rng: np.random.Generator) -> Mechanism:
    """The mechanism with a wrong prior, independently for each body.

    Masses and central moments are wrong by a fifth, centres of mass by a fifth of the radius of gyration.
    """
    bodies, share = [], 0.2
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
    activity: str, seconds: float, seed: int, laboratory: Laboratory = Laboratory(), faults: Faults = Faults()
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
    faults: Faults = Faults(),
) -> Recording:
    """Recording of a person by a laboratory's sensors.

    Args:
        who: The person, with a moving pelvis.
        time: Sample times, s (N,).
        motions: Her motion at these times, and at the earlier times that delayed plates and rail measure.
        laboratory: The laboratory.
        rng: Random generator of all noise.
        faults: Set-up errors of sensors and joints.
    """
    true, late = motions
    measured = {}
    for name, wrench in _wrenches(who, late, rng, laboratory).items():
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
    who: Mechanism, motion: Motion, rng: np.random.Generator, laboratory: Laboratory
) -> dict[str, np.ndarray]:
    """Wrenches on plates and rail (N, 6), which add up to the motion's wrench."""
    base = motion.base
    assert base is not None
    Y = base_wrench_regressor(who.tree, *motion.states, gravity=who.gravity, base=base)
    left_over = transform_wrench(base.T, Y @ who.known)
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
