"""Carriers: chains of joints with known kinematics, whose angles determine the motion of a mechanism's base."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from ident.errors import InputError
from ident.geometry.se3 import Ad, ad, applied, inverse
from ident.mechanism.body import BASE
from ident.mechanism.constraint import Constraint, members_of
from ident.mechanism.loops import Constraints
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree

UNBOUND = Constraints()
"""Constraints of a tree without any."""


@dataclass(frozen=True, eq=False)
class Carrier:
    """A chain of bodies on a base at rest; its last body is the base of the carried mechanism.

    Its masses have no effect on a sensor between it and the carried mechanism.

    Attributes:
        tree: The chain, before whose last body those stand that are in loops with it.
        constraints: Constraints of these loops.
    """

    tree: Tree
    constraints: Constraints = field(default_factory=Constraints)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.tree.joints

    @property
    def coordinates(self) -> int:
        """Number of the joints' coordinates."""
        return sum(body.coordinates for body in self.tree.bodies)

    def closed(self, lacking: Collection[str]) -> "Carrier":
        """The carrier with those joints dependent that loops determine, if some without positions are among them."""
        names = () if self.tree.closure else self.constraints.dependent(self.tree, lacking)
        if not {*names} & {*lacking}:
            return self
        return replace(self, tree=self.tree.closed(self.constraints.closure(self.tree, names)))

    def motion(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> BaseMotion:
        """Motion of the last body.

        The recursion from one body to the next is

            V_i = Ad(T) V_{i-1} + S q̇        V̇_i = Ad(T) V̇_{i-1} + ad(V_i) S q̇ + S q̈.

        Args:
            q: Joint coordinates in rad, m or quaternions (…, n_q).
            dq: Joint velocities, rad/s or m/s (…, n); `ddq` accelerations.

        Returns:
            Poses of that body in the frame of the base at rest, its twists and their rates.
        """
        tree = self.tree
        T = np.broadcast_to(np.eye(4), (*np.shape(q)[:-1], 4, 4))
        V = dV = np.zeros((*np.shape(q)[:-1], 6))
        states = tree.body_states(q, dq, ddq)
        for i in tree.chain(len(tree.bodies) - 1):
            body, (q_i, dq_i, ddq_i) = tree.bodies[i], states[i]
            step = body.home @ body.joint_pose(q_i) if body.moves else body.home
            T, across = T @ step, Ad(inverse(step))
            own = dq_i @ body.motions.T
            V = applied(across, V) + own
            dV = (across @ dV[..., None] + ad(V) @ own[..., None])[..., 0] + ddq_i @ body.motions.T
        return BaseMotion(T, V, dV)


def divided(tree: Tree, name: str, constraints: Constraints = UNBOUND) -> tuple[Carrier, Tree, tuple[int, ...]]:
    """Splits a tree before one of its bodies.

    Args:
        tree: The tree.
        name: The body.
        constraints: Constraints of the tree, by default none.

    Returns:
        The carrier of the body; the tree of the body, whose frame is {0}, and of all bodies on it; and their indices in
        the whole tree.

    Raises:
        InputError: There is no such body, or no joint moves it.
    """
    if name not in tree.names:
        raise InputError(f"There is no body '{name}' to be carried; the bodies are {', '.join(tree.names)}.")
    last = tree.names.index(name)
    chain, carried = {*tree.chain(last)}, tree.carried(last)
    rows = [row for row in constraints.rows if not members_of(tree, [row]) & {*carried} - {last}]
    own = list[Constraint]()
    for _ in rows:
        own = [row for row in rows if members_of(tree, [row]) & chain]
        chain = chain.union(*(tree.chain(i) for i in members_of(tree, own)))
    order = [*sorted(chain - {last}), last]
    parents = {k: place for place, k in enumerate(order)} | {BASE: BASE}
    bodies = tuple(replace(tree.bodies[k], parent=parents[tree.bodies[k].parent]) for k in order)
    carrier = Carrier(Tree(bodies), replace(constraints, rows=tuple(own)))
    if not any(tree.bodies[i].coordinates for i in tree.chain(last)):
        raise InputError(f"No joint moves '{name}', so that its weight cannot be separated from its sensor's offset.")
    root = replace(tree.bodies[carried[0]], parent=BASE, home=np.eye(4), twist=np.zeros(6), joint="")
    on_it = [replace(tree.bodies[k], parent=carried.index(tree.bodies[k].parent)) for k in carried[1:]]
    return carrier, Tree((root, *on_it)), carried
