"""Loops of a mechanism: its constraints of positions, and the joints that these make dependent."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import null_space

from ident.errors import ModelError
from ident.mechanism.body import BASE, Body, Follower
from ident.mechanism.closure import OPEN, Closure
from ident.mechanism.constraint import Coincidence, Constraint, Relation, members_of
from ident.mechanism.parallel_axes import LIKELY, NAMED, Turn, nearly_parallel
from ident.tolerances import HUGE

if TYPE_CHECKING:
    from ident.mechanism.tree import Tree

DIGITS = 1e-4
"""Angle below which axes in loops are meant to be parallel, rad: that of two angles with four decimals."""

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

        Of the latter, balls and joints that the model makes polynomials of others are first.

        Args:
            tree: The tree; of one with a closure, the joints that this made dependent are returned.
            lacking: Names of the joints whose positions are not measured.
            driven: Names of the joints with a torque or a command.
        """
        if tree.closure or not self.rows:
            return tree.dependent
        J, owners = self._columns(tree)
        joints = dict.fromkeys(owners.tolist())
        first = {*self.followers(tree), *(body.joint for body in tree.bodies if body.is_ball)}
        kinds = {
            joint: -1 if joint in lacking else 2 if joint in driven else int(joint not in first) for joint in joints
        }
        chosen = owners[_independent_columns(J, [kinds[joint] for joint in owners])]
        # Of a ball all that the constraints see has to follow.
        ranks = {joint: _row_space(J[:, owners == joint]).shape[1] for joint in chosen}
        return tuple(joint for joint in joints if joint in ranks and sum(chosen == joint) == ranks[joint])

    def _columns(self, tree: "Tree") -> tuple[np.ndarray, np.ndarray]:
        """Derivatives in the model's posture by the velocities of the loops (m, n), and their joints' names (n,)."""
        closure = self._closure(tree, ())
        return closure.rows(closure.anchors)[1][0], closure.part.owners("freedoms")

    def closing(self, tree: "Tree", lacking: Collection[str], driven: Collection[str] = ()) -> "Tree":
        """The tree with its loops closed, itself where all their joints are measured and none is driven.

        Arguments and errors are as for `dependent` and `closed`.
        """
        names = self.dependent(tree, lacking, driven)
        needed = {*names} & {*lacking} or (names and {*driven} & {*self.coupled(tree)})
        return self.closed(tree, names) if needed and not tree.closure else tree

    def closed(self, tree: "Tree", dependent: tuple[str, ...]) -> "Tree":
        """The tree with loops closed in the model's posture, those joints dependent.

        A dependent ball joint has two hinges in its place, across the direction about which loops leave it free, as a
        rod between two balls; without such a direction three. First is that about which it turns most.

        Raises:
            ModelError: The loops cannot be closed or are singular there.
        """
        J, owners = self._columns(tree)
        bodies, places, posture = list[Body](), {BASE: BASE}, dict(self.posture)
        for i, body in enumerate(tree.bodies):
            links = [replace(body, parent=places[body.parent])]
            if body.is_ball and body.joint in dependent:
                axes, own = _row_space(J[:, owners == body.joint]), null_space(J)[owners == body.joint]
                axes = (axes @ np.linalg.svd(axes.T @ own)[0])[:, [0, *range(2, axes.shape[1]), 1]]
                links = _hinges(links[0], self.posture[body.joint], axes, len(bodies))
                posture |= {link.joint: np.zeros(1) for link in links}
            bodies += links
            places[i] = len(bodies) - 1
        names = {body.joint for body in bodies} - {*tree.joints} | {*dependent}
        opened = type(tree)(tuple(bodies))
        own = tuple(joint for joint in opened.joints if joint in names)
        return opened.closed(replace(self, posture=posture)._closure(opened, own).in_posture())

    def checked(self, tree: "Tree") -> "Constraints":
        """The constraints, of which none contradicts others.

        Raises:
            ModelError: One has numbers beyond all use; or together they leave joints no motion that each leaves them,
                or are sums that do not agree.
        """
        for row in self.rows:
            numbers = row.places if isinstance(row, Coincidence) else row.coefficients
            if not (np.abs(numbers) < HUGE).all():
                raise ModelError(
                    f"The constraint '{row.name}' needs numbers below {HUGE:g}, as of its anchor or polycoef."
                )
        loose = replace(self, rows=tuple(row for row in self.rows if not replace(self, rows=(row,)).hold(tree)))
        sums = replace(self, rows=tuple(row for row in self.rows if isinstance(row, Relation)))
        apart = sums._closure(tree, sums.dependent(tree)).apart if sums.rows else 0.0
        if len(loose.rows) > 1 and not tree.still and loose.hold(tree):
            wrong, why = loose.rows, f"they leave {', '.join(loose.coupled(tree))} no motion"
        elif apart > OPEN:
            wrong, why = sums.rows, f"{apart:.2g} rad or m remain between their sums of joints"
        else:
            return self
        names = [row.name for row in wrong]
        raise ModelError(
            f"The constraints {', '.join(names)} contradict each other: {why}. Leave the wrong one out with --ignore, "
            f"of {' '.join(names)}."
        )

    def hold(self, tree: "Tree") -> bool:
        """True if there are constraints, and they leave their joints no motion."""
        return bool(self.rows) and {*self.dependent(tree)} == {*self.coupled(tree)}

    def followers(self, tree: "Tree") -> dict[str, Follower]:
        """Joints that a constraint makes a polynomial of another one, by name, each of one that is none itself."""
        owners = {body.name: body.joint for body in tree.bodies}
        laws = dict[str, tuple[str, Polynomial]]()
        for row in self.rows:
            if isinstance(row, Relation) and len(row.first) == len(row.second) == 1:
                (own, weight), (lead, gain) = row.first[0], row.second[0]
                law = Polynomial(row.coefficients)(Polynomial([0, gain])) / weight
                if {owners[own], owners[lead]} <= {*tree.joints}:
                    laws.setdefault(owners[own], (owners[lead], law))
        for _ in range(len(laws)):
            for joint, (lead, law) in laws.items():
                if lead in laws:
                    beyond, inner = laws[lead]
                    laws[joint] = beyond, law(inner)
        # Those that are left in a ring follow themselves.
        return {
            joint: Follower(lead, tuple(law.coef.tolist())) for joint, (lead, law) in laws.items() if lead not in laws
        }

    def _closure(self, tree: "Tree", dependent: tuple[str, ...]) -> Closure:
        """Closure with the model's posture as its anchor, in which the loops may be open.

        Its part are the bodies through which the loops go, all other bodies at rest.
        """
        part = type(tree)(tree.part(sorted(members_of(tree, self.rows))))
        q = np.concatenate([np.zeros(0), *(self.posture[joint] for joint in part.joints)])[None]
        return Closure(part, self.rows, dependent, q)

    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray], tree: "Tree") -> "Constraints":
        """The constraints of a tree in which some bodies' joints were fixed, at coordinates by the bodies' names."""
        rows = (row.fixed(coordinates) if isinstance(row, Relation) else row for row in self.rows)
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
            inside = {name in tree.names for name in row.bodies}
            if len(inside) == 2:
                raise ModelError(
                    f"The constraint '{row.name}' is between a body of the mechanism and one outside it, and its force "
                    f"is missing in the equations; leave it out with --ignore {row.name} (in Python, "
                    f"ignore=['{row.name}'])."
                )
            if inside == {True} and any(tree.bodies[i].moves for i in members_of(tree, [row])):
                rows.append(row)
        return replace(self, rows=tuple(rows))


def _row_space(J: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the velocities that change constraints, from their derivatives (m, n): (n, rank)."""
    _, sizes, directions = np.linalg.svd(J)
    return directions[: np.sum(sizes > INDEPENDENT * sizes[0])].T


def _hinges(ball: Body, q: np.ndarray, axes: np.ndarray, index: int) -> list[Body]:
    """Hinges in the place of a ball joint at q, about axes in its body's frame (3, k), from an index in a tree."""
    home, out, last = ball.home @ ball.joint_pose(q), list[Body](), axes.shape[1] - 1
    for k, (letter, axis) in enumerate(zip("xyz", axes.T, strict=False)):
        joint, parent = f"{ball.joint}.{letter}", ball.parent if k == 0 else index + k - 1
        name = ball.name if k == last else f"{ball.name}:{joint}"
        out.append(Body(name, parent, home, ball.twist @ axis, joint, massless=k < last or ball.massless))
        home = np.eye(4)
    return out


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
    likely, named = (nearly_parallel(closure.part.bodies, closure.dependent, angle) for angle in (LIKELY, NAMED))
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
