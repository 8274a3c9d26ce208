"""Constraints of positions between bodies of a mechanism: frames or points that coincide, and sums of coordinates."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ident.geometry.se3 import Ad, ad, applied, hat, pose
from ident.mechanism.body import BASE, Follower

if TYPE_CHECKING:
    from ident.mechanism.tree import Tree


class BodyKinematics(NamedTuple):
    """Poses (…, 4, 4), screws (…, 6, f), twists and their rates (…, 6) of bodies, and their joints' states."""

    poses: list[np.ndarray]
    screws: list[np.ndarray]
    twists: list[np.ndarray]
    rates: list[np.ndarray]
    states: list[tuple[np.ndarray, ...]]


Rows = tuple[np.ndarray, dict[int, np.ndarray], np.ndarray]
"""Residuals (…, m), derivatives by the rates of bodies' joints (…, m, f), and accelerations without those (…, m)."""


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

    def rows(self, tree: "Tree", at: BodyKinematics) -> Rows:
        """Rows of the constraint, in base axes."""
        ends = [tree.names.index(name) if name in tree.names else BASE for name in self.bodies]
        chains = [tree.chain(i) for i in ends]
        common = set(chains[0]) & set(chains[1])
        size = 6 if self.whole else 3
        residual, bias, by_body, R = np.zeros(3), np.zeros(size), dict[int, np.ndarray](), []
        for sign, i, chain, place in zip((1, -1), ends, chains, self.places, strict=True):
            own = np.reshape(place, (4, 4))
            T, V, A = (own, np.zeros(6), np.zeros(6)) if i == BASE else (at.poses[i] @ own, at.twists[i], at.rates[i])
            p, w = T[..., :3, 3], V[..., 3:]
            # The twist of the point, in base axes.
            at_point = Ad(pose(np.broadcast_to(np.eye(3, dtype=int), (*p.shape[:-1], 3, 3)), -p))[..., :size, :]
            turned = applied(hat(w), applied(at_point, V)[..., :3])
            centripetal = np.concatenate([turned, 0 * w], axis=-1)[..., :size]
            residual, bias = residual + sign * p, bias + sign * (applied(at_point, A) + centripetal)
            by_body |= {k: sign * at_point @ at.screws[k] for k in set(chain) - common}
            R.append(T[..., :3, :3])
        if self.whole:
            E = R[0] @ np.swapaxes(R[1], -1, -2)
            turn = [(E[..., j, k] - E[..., k, j]) / 2 for j, k in ((2, 1), (0, 2), (1, 0))]
            residual = np.concatenate([residual, np.stack(turn, axis=-1)], axis=-1)
        return residual, by_body, bias


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

    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray]) -> "Relation":
        """The relation with some coordinates fixed, by the names of the bodies."""
        sides = self.first, self.second
        constant, shift = (sum(w * float(coordinates[x][0]) for x, w in own if x in coordinates) for own in sides)
        law = Polynomial(self.coefficients)(Polynomial([shift, 1])) - constant
        first, second = (tuple((x, w) for x, w in own if x not in coordinates) for own in sides)
        return replace(self, first=first, second=second, coefficients=tuple(law.coef.tolist()))

    def rows(self, tree: "Tree", at: BodyKinematics) -> Rows:
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


Constraint = Coincidence | Relation
"""A constraint of positions."""


def kinematics(tree: "Tree", q: np.ndarray, dq: np.ndarray | None) -> BodyKinematics:
    """Kinematics of a tree on a base at rest, without the joints' accelerations."""
    at = BodyKinematics([], [], [], [], [])
    still = 0 * q[..., :1] + np.zeros(len(tree.freedoms))
    at.states.extend(tree.body_states(q, still if dq is None else dq, still))
    for body, (x, dx, ddx) in zip(tree.bodies, at.states, strict=True):
        T, V, A = body.home @ body.joint_pose(x), np.zeros(6), np.zeros(6)
        if body.parent != BASE:
            T, V, A = at.poses[body.parent] @ T, at.twists[body.parent], at.rates[body.parent]
        S = Ad(T) @ body.motions
        own = applied(S, dx)
        at.poses.append(T)
        at.screws.append(S)
        at.twists.append(V + own)
        at.rates.append(A + applied(S, ddx) + applied(ad(V), own))
    return at


def members_of(tree: "Tree", rows: Collection[Constraint]) -> set[int]:
    """Indices of the bodies through which the loops of constraints go."""
    members = set[int]()
    for each in rows:
        ends = [tree.names.index(name) if name in tree.names else BASE for name in each.bodies]
        members |= set(tree.chain(ends[0])) ^ set(tree.chain(ends[1])) if isinstance(each, Coincidence) else set(ends)
    leads = {tree.followers[i].joint for i in members if i in tree.followers}
    return members | {i for i, body in enumerate(tree.bodies) if body.joint in leads}
