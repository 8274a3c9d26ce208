"""Markers on a simulated person, and errors of the set-up that are drawn for each."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.studies.noise_processes import autoregressive
from ident.geometry.inertia import com_from_parameters
from ident.geometry.se3 import inverse, pose
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from ident.recordings.wrench import transform_wrench
from sim.markers.marked_model import MarkedModel, marked_model
from sim.markers.trial_fit import check_fit, fit_trial
from sim.markers.trial_recording import recording
from sim.models.model_update import updated_spec


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
            body = bodies[first := who.tree.first_link(who.tree.compounds[joint][0])]
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


EACH = 4
"""Markers on each body."""

LASTS = 0.3
"""Correlation time of the skin's random motion, s."""

PER_RADIAN = 2.0
"""Shift of the skin per radian of the body's joint, over the standard deviation of its random motion."""


def from_markers(
    who: Mechanism,
    tree: Tree,
    time: np.ndarray,
    motion: Motion,
    size: tuple[float, float],
    rng: np.random.Generator,
    felt: Recording,
    base: str = "pelvis",
) -> Recording:
    """Recording with angles and base pose fitted to noisy markers, as by `multicontact angles`.

    Skin moves over bone at random, correlated over about `LASTS`, and shifts as the joint turns, each marker in its
    own direction.

    Args:
        who: The stated person, whose joints the fit uses.
        tree: Her true joints.
        time: Times of the frames, s (N,).
        motion: Her motion.
        size: Standard deviations of the markers' positions and of the skin's motion, m.
        rng: Random generator of all noise.
        felt: Measurements of plates and rail on the same clock.
        base: The root body.
    """
    marked, places = _marked(who)
    poses = tree.poses(motion.q)
    if motion.base is not None:
        poses = motion.base.T[:, None] @ poses
    turns = tree.body_coordinates(motion.q)
    noise, skin = size
    decay = np.exp(-float(np.median(np.diff(time))) / LASTS)
    measured = []
    for body, place in places:
        i = tree.names.index(body)
        by_chance = np.stack([autoregressive(rng, len(time), decay) for _ in range(3)], axis=1)
        slides = PER_RADIAN * _direction(rng) * _turned(turns[i])[:, None]
        own = place + skin * (by_chance + slides)
        at = poses[:, i, :3, 3] + (poses[:, i, :3, :3] @ own[..., None])[..., 0]
        measured.append(at + noise * rng.normal(size=at.shape))
    postures = fit_trial(marked, np.stack(measured, axis=1))
    check_fit(postures)
    return recording(postures, time, base, {"sigma_m": postures.sigma}, felt)


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
    """The model with `EACH` markers on each body with mass, and these bodies and positions in their frames.

    Markers are at random points of the ellipsoid with the body's mass and moments of inertia.
    """
    spec, rng, places = updated_spec(who, who.known), np.random.default_rng(0), []
    labels = []
    for body, phi in zip(who.bodies, who.known.reshape(-1, 10), strict=True):
        mass, centre, central = com_from_parameters(phi)
        moments, axes = np.linalg.eigh(central)
        # Moments of an ellipsoid of half-axes a: m (a_j² + a_k²) / 5.
        half = np.sqrt(np.maximum(5 / mass * (moments.sum() / 2 - moments), 0))
        for k in range(EACH):
            place = centre + axes @ (half * _direction(rng))
            labels.append(f"{body}_marker{k}")
            spec.body(body).add_site(name=labels[-1], pos=place)
            places.append((body, place))
    marked, _ = marked_model(spec, labels)
    return marked, places
