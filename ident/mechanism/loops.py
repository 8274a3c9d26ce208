"""Loops of a mechanism: its constraints of positions, and the joints that these make dependent."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ident.errors import ModelError
from ident.mechanism.body import BASE
from ident.mechanism.closure import Closure
from ident.mechanism.constraint import Constraint, Relation, members_of

if TYPE_CHECKING:
    from ident.mechanism.tree import Tree

INDEPENDENT = 1e-3
"""Part of a column of the constraints that counts as independent of others: models state places with few digits."""


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints between bodies of a mechanism, and the posture in which its model states them.

    Attributes:
        rows: The constraints.
        posture: Coordinates by joint, each (1,) or (4,).
    """

    rows: tuple[Constraint, ...] = ()
    posture: Mapping[str, np.ndarray] = field(default_factory=dict)

    def dependent(self, tree: "Tree", lacking: Collection[str] = (), driven: Collection[str] = ()) -> tuple[str, ...]:
        """Names of the joints that the others determine: first those without a column, then those without a drive.

        Args:
            tree: The tree, without a closure.
            lacking: Names of the joints whose positions are not measured.
            driven: Names of the joints with a torque or a command.
        """
        if not self.rows:
            return ()
        closure = self._closure(tree, ())
        kinds = {
            body.joint: 2 if body.is_ball else -1 if body.joint in lacking else int(body.joint in driven)
            for body in closure.part.bodies
        }
        owners = np.repeat(closure.part.joints, [closure.part.bodies[i].freedoms for i in closure.part.moving])
        chosen = _independent_columns(closure.rows(closure.anchors)[1][0], [kinds[joint] for joint in owners])
        names = {str(joint) for joint in owners[chosen]}
        return tuple(joint for joint in closure.part.joints if joint in names)

    def closure(self, tree: "Tree", dependent: tuple[str, ...]) -> Closure:
        """Loops closed in the model's posture, arguments as for `dependent`.

        Raises:
            ModelError: They cannot be closed or are singular there, leave joints no motion, or go through a ball joint.
        """
        closure, names = self._closure(tree, dependent), " ".join(row.name for row in self.rows)
        part = closure.part
        if balls := [body.joint for body in part.bodies if body.is_ball and body.joint in dependent]:
            raise ModelError(
                f"Loops through the ball joint '{balls[0]}' are not closed. Put three hinges in its place, or leave "
                f"constraints out with --ignore, of {names}."
            )
        if dependent == part.joints and len(self.rows) > 1 and not tree.still:
            raise ModelError(
                f"The constraints {names.replace(' ', ', ')} contradict each other: they leave {', '.join(dependent)} "
                f"no motion. Leave the wrong one out with --ignore, of {names}."
            )
        return closure.in_posture()

    def _closure(self, tree: "Tree", dependent: tuple[str, ...]) -> Closure:
        """Closure with the model's posture as its anchor, in which the loops may be open."""
        part = part_of(tree, self.rows)
        q = np.concatenate([np.zeros(0), *(self.posture[joint] for joint in part.joints)])[None]
        return Closure(part, self.rows, dependent, q)

    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray], tree: "Tree") -> "Constraints":
        """The constraints of a tree in which some bodies' joints were fixed, at coordinates by the bodies' names."""
        rows = list(self.rows)
        for body, q in coordinates.items():
            rows = [row.fixed(body, float(q[0])) if isinstance(row, Relation) else row for row in rows]
        return replace(self, rows=tuple(rows)).within(tree)

    def coupled(self, tree: "Tree") -> tuple[str, ...]:
        """Names of a tree's joints through which the loops go."""
        return tuple(tree.bodies[i].joint for i in sorted(members_of(tree, self.rows)) if tree.bodies[i].joint)

    def within(self, tree: "Tree") -> "Constraints":
        """The constraints among a tree's bodies that move against each other.

        Raises:
            ModelError: One is between a body of the tree and another.
        """
        rows = list[Constraint]()
        for row in self.rows:
            inside = [name in tree.names for name in row.bodies]
            if any(inside) and not all(inside):
                raise ModelError(f"The constraint '{row.name}' is between a body of this part and one outside it.")
            if inside and all(inside) and any(tree.bodies[i].moves for i in members_of(tree, [row])):
                rows.append(row)
        return replace(self, rows=tuple(rows))


def part_of(tree: "Tree", rows: Collection[Constraint]) -> "Tree":
    """The bodies of a tree through which the loops of constraints go, all other bodies at rest."""
    members = sorted(members_of(tree, rows))
    places = {i: k for k, i in enumerate(members)}
    own = ((tree.bodies[i], places.get(tree.bodies[i].parent, BASE)) for i in members)
    return type(tree)(tuple(replace(body, parent=parent) for body, parent in own))


def _independent_columns(J: np.ndarray, order: Collection[int]) -> list[int]:
    """Indices of as many columns as the rank, those of a lower order first, the most independent of each order."""
    left, norms, out = J.copy(), np.linalg.norm(J, axis=0), list[int]()
    for level in sorted(set(order)):
        while True:
            size = np.where(np.array(order) == level, np.linalg.norm(left, axis=0) / np.maximum(norms, 1e-12), 0)
            if size.max(initial=0) < INDEPENDENT:
                break
            # Joints near the base rather determine those on them.
            k = int(np.flatnonzero(size > size.max() / 2)[-1])
            unit = left[:, k] / np.linalg.norm(left[:, k])
            left = left - np.outer(unit, unit @ left)
            out.append(k)
    return out
