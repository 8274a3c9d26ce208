"""Axes of loops that are parallel but for small angles, which a file's digits or a scan leave."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ident.mechanism.body import BASE, Body

LIKELY = 0.03
"""Angle below which they may be meant to be, rad: drawings and scans are off by some milliradians."""

NAMED = 3 * LIKELY
"""Angle below which they are named, rad: a drawing or a scan that is worse than most."""

EXACT = 1e-12
"""Angle below which they are parallel in computed numbers, rad."""


class Turn(NamedTuple):
    """An axis that is nearly parallel to others, or a slide that is nearly across them.

    Attributes:
        joint: Name of its joint, or of the body that follows another joint.
        angle: The angle that is missing, rad.
        twist: Twist of the joint without it, through the same point and with the same pitch (6,).
    """

    joint: str
    angle: float
    twist: np.ndarray


def nearly_parallel(bodies: Sequence[Body], dependent: Collection[str], within: float = NAMED) -> dict[int, Turn]:
    """Axes of a tree's bodies that are parallel to others but for an angle, by the bodies' indices.

    Bodies whose axes are parallel move in a plane: their axes are parallel at joint coordinates of zero too. Meant is
    the direction that most of them have; hinges in the place of a ball have none of their own.
    """
    R, axes, out = list[np.ndarray](), dict[int, np.ndarray](), dict[int, Turn]()
    for i, body in enumerate(bodies):
        R.append((np.eye(3) if body.parent == BASE else R[body.parent]) @ body.home[:3, :3])
        if body.turns and not (body.joint in dependent and body.joint.endswith((".x", ".y", ".z"))):
            axes[i] = R[i] @ body.twist[3:]
    names = [body.joint or body.name for body in bodies]
    for i, own in axes.items():
        signed = [axis * np.sign(axis @ own) for axis in axes.values()]
        alike = [axis for axis in signed if np.linalg.norm(axis - own) < within]
        meant = max(alike, key=lambda axis: sum(np.linalg.norm(axis - other) < EXACT for other in alike))
        (v, w), turned = np.split(bodies[i].twist, 2), R[i].T @ meant
        if (angle := float(np.linalg.norm(turned - w))) > EXACT:
            out[i] = Turn(names[i], angle, np.r_[np.cross(np.cross(w, v), turned) + w @ v * turned, turned])
    normals = [R[i] @ out[i].twist[3:] if i in out else axis for i, axis in axes.items()]
    for i in (i for i, body in enumerate(bodies) if body.moves and not (body.is_ball or body.turns)):
        own = R[i] @ bodies[i].twist[:3]
        off = next((own @ normal * normal for normal in normals if EXACT < abs(own @ normal) < within), None)
        if off is not None:
            angle = float(np.linalg.norm(off))
            out[i] = Turn(names[i], angle, np.r_[R[i].T @ (own - off) / np.sqrt(1 - angle**2), np.zeros(3)])
    return out
