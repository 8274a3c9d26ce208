"""Mechanisms whose loops have parallel axes, where only small angles keep them from it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from ident.errors import ModelError
from ident.mechanism.constraint import members_of
from ident.mechanism.parallel_axes import Turn, nearly_parallel
from ident.mechanism.tree import Tree

DIGITS = 1e-4
"""Angle below which axes in loops are meant to be parallel, rad: that of two angles with four decimals."""


class Alignment(NamedTuple):
    """A tree with axes of its loops parallel.

    Attributes:
        tree: The tree.
        angles: Angles by which axes were turned, rad, by the names of their joints.
    """

    tree: Tree
    angles: Mapping[str, float]


def alignments(tree: Tree) -> tuple[Alignment, Alignment]:
    """A tree with those axes of its loops parallel that have to be, and with all that may be meant to be.

    Axes have to be parallel if only a model's digits keep them from it, or if loops move only then: with any angle
    between two axes a four-bar of four hinges is rigid.
    """
    turns = nearly_parallel(tree.closure.part.bodies) if tree.closure else {}
    every = _aligned(tree, turns)
    needed = {i for i, turn in turns.items() if turn.angle < DIGITS}
    if (closure := tree.closure) and (other := every.tree.closure) and len(needed) < len(turns):
        ranks = zip(closure.constraints, closure.ranks(), other.ranks(), strict=True)
        needed |= members_of(closure.part, [row for row, skew, parallel in ranks if parallel < skew])
    return _aligned(tree, {i: turn for i, turn in turns.items() if i in needed}), every


def _aligned(tree: Tree, turns: Mapping[int, Turn]) -> Alignment:
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
