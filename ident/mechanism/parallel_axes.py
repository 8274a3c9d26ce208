"""Axes of loops that are parallel but for small angles, which a file's digits or a scan leave."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ident.errors import ModelError
from ident.mechanism.body import BASE, Body
from ident.mechanism.constraint import members_of

if TYPE_CHECKING:
    from ident.mechanism.tree import Tree

DIGITS = 1e-4
"""Angle below which axes in loops are meant to be parallel, rad: that of two angles with four decimals."""

LIKELY = 0.03
"""Angle below which they may be meant to be, rad: drawings and scans are off by some milliradians."""

EXACT = 1e-12
"""Angle below which they are parallel in computed numbers, rad."""


class Turn(NamedTuple):
    """An axis that is nearly parallel to others, or a slide that is nearly across them.

    Attributes:
        angle: The angle that is missing, rad.
        twist: Twist of the joint without it, through the same point and with the same pitch (6,).
    """

    angle: float
    twist: np.ndarray


@dataclass(frozen=True, eq=False)
class Alignment:
    """A tree with axes of its loops parallel.

    Attributes:
        tree: The tree.
        angles: Angles by which axes were turned, rad, by the names of their joints.
    """

    tree: "Tree"
    angles: Mapping[str, float]


def nearly_parallel(tree: "Tree") -> dict[int, Turn]:
    """Axes of a tree that are nearly parallel to others, by their bodies' indices.

    Bodies whose axes are parallel move in a plane: their axes are parallel at joint coordinates of zero too. Meant is
    the direction that most of them have; hinges in the place of a ball have none of their own.
    """
    R, axes, out = list[np.ndarray](), dict[int, np.ndarray](), dict[int, Turn]()
    for i, body in enumerate(tree.bodies):
        R.append((np.eye(3) if body.parent == BASE else R[body.parent]) @ body.home[:3, :3])
        if body.turns and not body.depends.endswith((".x", ".y", ".z")):
            axes[i] = R[i] @ body.twist[3:]
    for i, own in axes.items():
        signed = [axis * np.sign(axis @ own) for axis in axes.values()]
        alike = [axis for axis in signed if np.linalg.norm(axis - own) < LIKELY]
        meant = max(alike, key=lambda axis: sum(np.linalg.norm(axis - other) < EXACT for other in alike))
        v, w = np.split(tree.bodies[i].twist, 2)
        turned = R[i].T @ meant
        if (angle := float(np.linalg.norm(turned - w))) > EXACT:
            out[i] = Turn(angle, np.concatenate([np.cross(np.cross(w, v), turned) + w @ v * turned, turned]))
    normals = [R[i] @ out[i].twist[3:] if i in out else axis for i, axis in axes.items()]
    for i, body in enumerate(tree.bodies):
        if body.is_ball or body.turns or not body.moves:
            continue
        own = R[i] @ body.twist[:3]
        for normal in (each for each in normals if EXACT < abs(own @ each) < LIKELY):
            across = own - own @ normal * normal
            out[i] = Turn(
                float(abs(own @ normal)), np.concatenate([R[i].T @ across / np.linalg.norm(across), [0.0] * 3])
            )
            break
    return out


def alignments(tree: "Tree") -> tuple[Alignment, Alignment]:
    """A tree with those axes of its loops parallel that have to be, and with all that may be meant to be.

    Axes have to be parallel if only a model's digits keep them from it, or if loops move only then: with any angle
    between two axes a four-bar of four hinges is rigid.
    """
    if (closure := tree.closure) is None or not (turns := nearly_parallel(closure.part)):
        return Alignment(tree, {}), Alignment(tree, {})
    every = _aligned(tree, turns)
    needed = {i for i, turn in turns.items() if turn.angle < DIGITS}
    if every.tree.closure and len(needed) < len(turns):
        ranks = zip(closure.constraints, closure.ranks(), every.tree.closure.ranks(), strict=True)
        needed |= members_of(closure.part, [row for row, skew, parallel in ranks if parallel < skew])
    return _aligned(tree, {i: turn for i, turn in turns.items() if i in needed}), every


def _aligned(tree: "Tree", turns: Mapping[int, Turn]) -> Alignment:
    """A tree with some axes of its loops turned, by indices of the loops' bodies."""
    if (closure := tree.closure) is None or not turns:
        return Alignment(tree, {})
    own = {closure.part.bodies[i].name: turn for i, turn in turns.items()}

    def turned(bodies: Iterable[Body]) -> tuple[Body, ...]:
        return tuple(replace(body, twist=own[body.name].twist) if body.name in own else body for body in bodies)

    part = replace(closure.part, bodies=turned(closure.part.bodies))
    try:
        closed = replace(closure, part=part).in_posture()
    except ModelError:
        return Alignment(tree, {})
    angles = {closure.part.bodies[i].joint: turn.angle for i, turn in turns.items()}
    return Alignment(replace(tree, bodies=turned(tree.bodies), closure=closed), angles)
