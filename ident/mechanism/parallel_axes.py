"""Axes of loops that are parallel but for small angles, which a file's digits or a scan leave."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ident.errors import ModelError
from ident.mechanism.body import BASE
from ident.mechanism.constraint import members_of

if TYPE_CHECKING:
    from ident.mechanism.closure import Closure
    from ident.mechanism.tree import Tree

DIGITS = 1e-4
"""Angle below which axes in loops are meant to be parallel, rad: that of two angles with four decimals."""

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


class Alignment(NamedTuple):
    """A tree with axes of its loops parallel.

    Attributes:
        tree: The tree.
        angles: Angles by which axes were turned, rad, by the names of their joints.
    """

    tree: "Tree"
    angles: Mapping[str, float]


def alignments(tree: "Tree") -> tuple[Alignment, Alignment]:
    """A tree with those axes of its loops parallel that have to be, and with all that may be meant to be.

    Axes have to be parallel if only a model's digits keep them from it, or if loops move only then: with any angle
    between two axes a four-bar of four hinges is rigid.
    """
    if (closure := tree.closure) is None:
        return Alignment(tree, {}), Alignment(tree, {})
    likely, named = (nearly_parallel(closure, angle) for angle in (LIKELY, NAMED))
    parallel = _aligned(tree, likely)
    every = parallel if named.keys() == likely.keys() else _aligned(tree, named)
    needed = {i for i, turn in likely.items() if turn.angle < DIGITS}
    if (other := parallel.tree.closure) and len(needed) < len(likely):
        ranks = zip(closure.constraints, closure.ranks(), other.ranks(), strict=True)
        needed |= members_of(closure.part, [row for row, skew, aligned in ranks if aligned < skew])
    least = _aligned(tree, {i: turn for i, turn in likely.items() if i in needed})
    return least, every if every.angles else parallel


def _aligned(tree: "Tree", turns: Mapping[int, Turn]) -> Alignment:
    """A tree with some axes of its loops turned, by indices of the loops' bodies; as it is if they then stay open."""
    if (closure := tree.closure) is None or not turns:
        return Alignment(tree, {})
    twists = {closure.part.bodies[i].name: turn.twist for i, turn in turns.items()}
    part, whole = (
        tuple(replace(body, twist=twists.get(body.name, body.twist)) for body in each.bodies)
        for each in (closure.part, tree)
    )
    try:
        closed = replace(closure, part=replace(closure.part, bodies=part)).in_posture()
    except ModelError:
        return Alignment(tree, {})
    return Alignment(replace(tree, bodies=whole, closure=closed), {turn.joint: turn.angle for turn in turns.values()})


def nearly_parallel(closure: "Closure", within: float = NAMED) -> dict[int, Turn]:
    """Axes of loops that are parallel to others but for an angle, by the indices of the loops' bodies.

    Bodies whose axes are parallel move in a plane: their axes are parallel at joint coordinates of zero too. Meant is
    the direction that most of them have; hinges in the place of a ball have none of their own.
    """
    R, axes, out, bodies = list[np.ndarray](), dict[int, np.ndarray](), dict[int, Turn](), closure.part.bodies
    for i, body in enumerate(bodies):
        R.append((np.eye(3) if body.parent == BASE else R[body.parent]) @ body.home[:3, :3])
        if body.turns and not (body.joint in closure.dependent and body.joint.endswith((".x", ".y", ".z"))):
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
