"""Loops of a mechanism: places that coincide, sums of coordinates, and the joints that these make dependent."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import null_space

from ident.errors import ModelError
from ident.geometry.se3 import Ad, applied, hat, inverse, pose
from ident.mechanism.body import BASE, Body, Follower
from ident.mechanism.closure import OPEN, BodyKinematics, Closure, Rows
from ident.tolerances import HUGE, ROUNDING

if TYPE_CHECKING:
    from ident.mechanism.tree import Tree

PARALLEL = 5e-3
"""Angle up to which axes of loops count as parallel, rad: drawings and scans are off by some milliradians, with more of
which loops in a plane open visibly."""

SKEW = 0.1
"""Angle up to which axes of loops may be meant to be parallel, rad: axes that are not are usually degrees apart."""

INDEPENDENT = 1e-3
"""Part of a column of the constraints, or of an axis, that counts as independent of others: models state places and
axes with few digits."""


@dataclass(frozen=True)
class Coincidence:
    """Two frames or points that coincide, each on a body.

    Attributes:
        name: Name of the constraint.
        bodies: Names of both bodies.
        places: Poses of the frames on them, row by row (16,).
        whole: True for frames, False for points.
    """

    name: str
    bodies: tuple[str, ...]
    places: tuple[tuple[float, ...], ...]
    whole: bool = False

    def ends(self, tree: "Tree") -> list[int]:
        """Indices of both bodies in a tree, `BASE` for one that is none of it."""
        return [tree.names.index(name) if name in tree.names else BASE for name in self.bodies]

    def members(self, tree: "Tree") -> set[int]:
        """Indices of the bodies between both."""
        one, other = self.ends(tree)
        return {*tree.chain(one)} ^ {*tree.chain(other)}

    def rows(self, tree: "Tree", at: BodyKinematics, length: float) -> Rows:
        """Rows of the constraint, in base axes."""
        ends, between = self.ends(tree), self.members(tree)
        size = 6 if self.whole else 3
        unit = np.repeat([1 / length, 1.0], 3)[:size]
        residual, bias, by_body, R = np.zeros(3), np.zeros(size), dict[int, np.ndarray](), []
        for sign, i, place in zip((1, -1), ends, self.places, strict=True):
            T, V, A = at.poses[i] @ np.reshape(place, (4, 4)), at.twists[i], at.rates[i]
            p, w = T[..., :3, 3], V[..., 3:]
            # The twist of the point, in base axes.
            at_point = Ad(pose(np.broadcast_to(np.eye(3, dtype=int), (*p.shape[:-1], 3, 3)), -p))[..., :size, :]
            turned = applied(hat(w), applied(at_point, V)[..., :3])
            centripetal = np.concatenate([turned, 0 * w], axis=-1)[..., :size]
            residual, bias = residual + sign * p, bias + sign * (applied(at_point, A) + centripetal)
            by_body |= {k: sign * at_point @ at.screws[k] for k in between & {*tree.chain(i)}}
            R.append(T[..., :3, :3])
        if self.whole:
            E = R[0] @ np.swapaxes(R[1], -1, -2)
            turn = [(E[..., j, k] - E[..., k, j]) / 2 for j, k in ((2, 1), (0, 2), (1, 0))]
            residual = np.concatenate([residual, np.stack(turn, axis=-1)], axis=-1)
        return unit * residual, {k: unit[:, None] * own for k, own in by_body.items()}, unit * bias


@dataclass(frozen=True)
class Relation:
    """A sum of joint coordinates that is a polynomial of another such sum.

    Attributes:
        name: Name of the constraint.
        first: Weights of the coordinates by the names of the bodies that the joints carry.
        second: Weights of the others.
        coefficients: Coefficients of the polynomial, the constant first.
    """

    name: str
    first: tuple[tuple[str, float], ...]
    second: tuple[tuple[str, float], ...]
    coefficients: tuple[float, ...]

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that the joints carry."""
        return tuple(name for name, _ in (*self.first, *self.second))

    def members(self, tree: "Tree") -> set[int]:
        """Indices of these bodies."""
        return {*map(tree.names.index, self.bodies)}

    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray]) -> "Relation":
        """The relation with some coordinates fixed, by the names of the bodies."""
        sides = self.first, self.second
        constant, shift = (sum(w * float(coordinates[x][0]) for x, w in own if x in coordinates) for own in sides)
        law = Polynomial(self.coefficients)(Polynomial([shift, 1])) - constant
        first, second = (tuple((x, w) for x, w in own if x not in coordinates) for own in sides)
        return replace(self, first=first, second=second, coefficients=tuple(law.coef.tolist()))

    def rows(self, tree: "Tree", at: BodyKinematics, length: float) -> Rows:
        """The row of the constraint."""
        law, by_body, places = Follower(self.name, self.coefficients), dict[int, np.ndarray](), tree.names.index
        left, right = (
            [sum((w * at.states[places(name)][k] for name, w in side), np.zeros(1)) for k in range(3)]
            for side in (self.first, self.second)
        )
        value, _, ddvalue = law.states(*right)
        for side, factor in ((self.first, 1.0), (self.second, -law.slope(right[0]))):
            for i, weight in ((places(name), weight) for name, weight in side):
                by_body[i] = by_body.get(i, 0) + (factor * weight + 0 * at.states[i][0])[..., None]
        return left[0] - value, by_body, left[2] - ddvalue


Row = Coincidence | Relation
"""A constraint of positions."""


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints between bodies of a mechanism, and the posture in which its model states them.

    Attributes:
        rows: The constraints.
        posture: Coordinates by joint, each (1,) or (4,).
    """

    rows: tuple[Row, ...] = ()
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
        first = {*self.followers(tree), *(body.joint for body in tree.bodies if body.is_ball)}
        order = [-1 if joint in lacking else 2 if joint in driven else int(joint not in first) for joint in owners]
        chosen = owners[_independent_columns(J, order)]
        # Of a ball all that the constraints see has to follow.
        ranks = {joint: _row_space(J[:, owners == joint]).shape[1] for joint in chosen}
        return tuple(joint for joint in tree.joints if joint in ranks and sum(chosen == joint) == ranks[joint])

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
        opened = type(tree)(tuple(bodies))
        own = tuple(joint for joint in opened.joints if joint in dependent or joint not in tree.joints)
        return opened.closed(replace(self, posture=posture)._closure(opened, own).in_posture())

    def checked(self, tree: "Tree") -> "Constraints":
        """The constraints, of which none contradicts others.

        Raises:
            ModelError: One has numbers beyond all use, or together they leave joints no motion that each leaves them.
        """
        for row in self.rows:
            numbers = row.places if isinstance(row, Coincidence) else row.coefficients
            if not (np.abs(numbers) < HUGE).all():
                raise ModelError(
                    f"The constraint '{row.name}' needs numbers below {HUGE:g}, as of its anchor or polycoef."
                )
        for wrong in () if tree.still else self._contradictory(tree):
            names = [row.name for row in wrong.rows]
            raise ModelError(
                f"The constraints {', '.join(names)} contradict each other: no motion of "
                f"{', '.join(wrong.coupled(tree))} satisfies all of them. Leave the wrong one out with --ignore, of "
                f"{' '.join(names)}."
            )
        return self

    def _contradictory(self, tree: "Tree") -> Iterator["Constraints"]:
        """Sets of constraints that each leave motion, but together none or, if sums, in the model's posture alone."""
        loose = [one for row in self.rows if not (one := replace(self, rows=(row,))).held(tree)]
        together = replace(self, rows=tuple(row for each in loose for row in each.rows))
        still = together._still(tree) if loose else set()
        # Others that have joints of their own do not hide them.
        among = tuple(row for each in loose for row in each.rows if {*each.coupled(tree)} <= still)
        yield from replace(self, rows=among).held(tree)
        sums = tuple(row for row in self.rows if isinstance(row, Relation))
        for each in replace(self, rows=sums).apart(tree):
            if len(each.rows) > 1 and not each._agree(tree):
                yield each

    def _agree(self, tree: "Tree") -> bool:
        """True if sums of coordinates can be satisfied in the model's posture and, by as many joints, about it."""
        closure = self._closure(tree, self.dependent(tree))
        about = closure.about(np.random.default_rng(0), 9, 1.0)
        *_, q = closure.way(np.vstack([closure.anchors[:, closure.coordinates[0]], about]))
        residual, J, _ = closure.rows(q)
        sizes = np.linalg.svd(J, compute_uv=False)
        before, *after = (sizes > INDEPENDENT * sizes[:, :1]).sum(axis=1)
        return bool(np.linalg.norm(residual[0]) <= OPEN and np.median(after) <= before)

    def apart(self, tree: "Tree") -> list["Constraints"]:
        """The constraints in sets that have no joint in common."""
        sets = list[Constraints]()
        for own in (replace(self, rows=(row,)) for row in self.rows):
            near = [each for each in sets if {*each.coupled(tree)} & {*own.coupled(tree)}]
            joined = replace(self, rows=(*(row for each in near for row in each.rows), *own.rows))
            sets = [each for each in sets if each not in near] + [joined]
        return sets

    def aligned(self, tree: "Tree") -> tuple["Tree", list[str], list[str]]:
        """The tree with those axes of its loops parallel that nearly are, and the angles by which axes are not.

        A loop of hinges moves only if its axes are parallel, and any angle that a file's digits leave adds parameters.
        Hinges turn to the axis nearest to the base, slides until they are across it.

        Returns:
            The tree, joints whose axes were turned, and joints whose axes stay but may be meant to be parallel, each
            with its angle.
        """
        bodies, moved, drawn = list(tree.bodies), list[str](), list[str]()
        members = members_of(tree, [row for row in self.rows if isinstance(row, Coincidence)])
        axes = [i for i in members if tree.bodies[i].moves and not tree.bodies[i].is_ball]
        normals, q = list[tuple[np.ndarray, np.ndarray]](), self._coordinates(tree)
        R, at = tree.poses(q)[:, :3, :3], tree.body_coordinates(q)
        for i in sorted(axes, key=lambda i: (not tree.bodies[i].turns, i)):
            body = bodies[i]
            v, w = np.split(body.twist, 2)
            own = R[i] @ (w if body.turns else v)
            if body.turns:
                near = [(np.linalg.norm(np.cross(axis, own)), np.sign(axis @ own) * turned) for axis, turned in normals]
            else:
                near = [(abs(own @ turned), own - own @ turned * turned) for _, turned in normals]
            off, meant = min(near, key=lambda each: each[0], default=(SKEW, own))
            angle = float(np.linalg.norm(meant - own))
            if off < SKEW and angle > ROUNDING:
                (moved if off < PARALLEL else drawn).append(f"{body.joint or body.name} {angle:.2g} rad")
            meant = meant if off < PARALLEL else own
            normals += [(own, meant)] if body.turns else []
            if off < PARALLEL and angle:
                turned = R[i].T @ meant
                hinge, slide = (np.cross(np.cross(w, v), turned), turned), (turned / np.linalg.norm(turned), w)
                there = replace(body, twist=np.concatenate(hinge if body.turns else slide))
                # The model's posture stays as it is.
                home = body.home @ body.joint_pose(at[i]) @ inverse(there.joint_pose(at[i]))
                bodies[i] = replace(there, home=home)
        return replace(tree, bodies=tuple(bodies)), moved, drawn

    def _still(self, tree: "Tree") -> set[str]:
        """Joints that all constraints together leave no motion in the model's posture."""
        J, owners = self._columns(tree)
        moves = np.linalg.norm(null_space(J, rcond=INDEPENDENT), axis=1) > INDEPENDENT
        return {*owners} - {*owners[moves]}

    def held(self, tree: "Tree") -> list["Constraints"]:
        """Those of the sets as of `apart` that leave their joints no motion."""
        return [each for each in self.apart(tree) if {*each.coupled(tree)} == {*each.dependent(tree)} != set()]

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
        for joint in [*laws] * len(laws):
            lead, law = laws[joint]
            if lead in laws:
                laws[joint] = laws[lead][0], law(laws[lead][1])
        # Those that are left in a ring follow themselves.
        free = {joint: own for joint, own in laws.items() if own[0] not in laws}
        return {joint: Follower(lead, tuple(law.coef.tolist())) for joint, (lead, law) in free.items()}

    def _closure(self, tree: "Tree", dependent: tuple[str, ...]) -> Closure:
        """Closure with the model's posture as its anchor, in which the loops may be open.

        Its part are the bodies through which the loops go, all other bodies at rest.
        """
        part = type(tree)(tree.part(sorted(members_of(tree, self.rows))))
        return Closure(part, self.rows, dependent, self._coordinates(part)[None])

    def _coordinates(self, tree: "Tree") -> np.ndarray:
        """Coordinates of a tree in the model's posture (n_q,)."""
        return np.concatenate([np.zeros(0), *(self.posture[joint] for joint in tree.joints)])

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
        rows = list[Row]()
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


def members_of(tree: "Tree", rows: Collection[Row]) -> set[int]:
    """Indices of the bodies through which the loops of constraints go."""
    members = set[int]().union(*(each.members(tree) for each in rows))
    leads = {tree.followers[i].joint for i in members if i in tree.followers}
    return members | {i for i, body in enumerate(tree.bodies) if body.joint in leads}


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
    for level in sorted(order):
        size = np.where(np.array(order) == level, np.linalg.norm(left, axis=0) / np.maximum(norms, 1e-12), 0)
        if size.max() >= INDEPENDENT:
            # Joints near the base rather determine those on them.
            k = int(np.flatnonzero(size > size.max() / 2)[-1])
            unit = left[:, k] / np.linalg.norm(left[:, k])
            left = left - np.outer(unit, unit @ left)
            out.append(k)
    return out
