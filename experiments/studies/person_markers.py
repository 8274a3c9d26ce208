"""Markers on a person's moving skin, and the angles that the package's own fit estimates from them."""

from functools import lru_cache

import numpy as np

from experiments.studies.noise_processes import autoregressive
from ident.geometry.inertia import com_from_parameters
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from sim.markers.marked_model import MarkedModel, marked_model
from sim.markers.recording import recording
from sim.markers.trial_fit import check_fit, fit_trial
from sim.models.model_update import updated_spec

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
