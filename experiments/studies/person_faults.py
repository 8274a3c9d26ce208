"""Set-up errors of a laboratory's plates and a person's joints."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ident.geometry.se3 import inverse, pose
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.wrench import transform_wrench


@dataclass(frozen=True, eq=False)
class Faults:
    """Set-up errors with one person in one laboratory.

    Attributes:
        tilts: Rotations of joint axes about the point on them that is next to the body's origin, by joint.
        gravity: Rotation of gravity.
        frames: Poses of the sensors' frames in their stated frames (4, 4).
        gains: Readings of a sensor's six channels for one unit (6,).
        zeros: Zero errors of joints, rad.
    """

    tilts: Mapping[str, Rotation] = field(default_factory=dict)
    gravity: Rotation = field(default_factory=Rotation.identity)
    frames: Mapping[str, np.ndarray] = field(default_factory=dict)
    gains: Mapping[str, np.ndarray] = field(default_factory=dict)
    zeros: Mapping[str, float] = field(default_factory=dict)

    def true(self, who: Mechanism) -> Mechanism:
        """The person with true axes and gravity, from the stated one."""
        bodies = [self._tilted(body) for body in who.tree.bodies]
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
    )
