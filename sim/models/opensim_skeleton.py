"""Kinematic tree of an OpenSim model, including followers and the coordinates that lead them."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ident.errors import ModelError
from ident.geometry import se3
from ident.mechanism.body import BASE, Body, Follower
from ident.mechanism.tree import Tree
from sim.models.notes import note
from sim.models.opensim_elements import GROUND, Frames
from sim.models.opensim_joints import (
    Coordinate,
    Dependence,
    ElementaryMotion,
    Link,
    coordinate_elements,
    dependences,
    links_in_order,
    needed_span,
)

Worst = tuple[float, str]
"""An error in m or rad, and the name of its turn or slide."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The tree of all bodies, and the coordinates that move it.

    Attributes:
        tree: All bodies, on the ground.
        coordinates: All coordinates of the file by name.
    """

    tree: Tree
    coordinates: Mapping[str, Coordinate]

    @classmethod
    def of(cls, model: ET.Element, frames: Frames, ignore: Collection[str]) -> "Skeleton":
        """Skeleton of a model.

        Raises:
            ModelError: Something cannot be read; the message names it.
        """
        links = links_in_order(model, frames)
        every = [Coordinate.of(element) for link in links for element in coordinate_elements(link.joint)]
        coordinates = {coordinate.name: coordinate for coordinate in every}
        if len(coordinates) < len(every):
            raise ModelError("Every coordinate of the model needs a name of its own.")
        chains = _Chains(coordinates, dependences(model, coordinates, ignore))
        for link in links:
            chains.add(link)
        if not chains.bodies:
            raise ModelError("The model has no body besides the ground.")
        if chains.distances:
            note(f"Tabulated functions of coordinates are polynomials here, off by at most {chains.distances}.")
        return cls(Tree(tuple(chains.bodies)), coordinates)

    def default(self, name: str) -> float:
        """Default of a coordinate."""
        if name not in self.coordinates:
            raise ModelError(f"There is no coordinate '{name}'; there are {', '.join(self.coordinates)}.")
        return self.coordinates[name].default

    def limits(self, name: str) -> tuple[float, float] | None:
        """Range of a coordinate, limited to the tables of its followers; None if unlimited."""
        spans = [lead.span for lead in self.tree.followers.values() if lead.joint == name]
        own = self.coordinates[name].range
        spans += [own] if own else []
        return (max(low for low, _ in spans), min(high for _, high in spans)) if spans else None

    def based(self, base: str) -> tuple[Tree, np.ndarray | None]:
        """Tree of a body and all its descendants, and the body's rotation matrix in the ground, None if it moves."""
        below, R = self._below(base), np.eye(3)
        for i in below:
            R = self.tree.bodies[i].home[:3, :3] @ R
        return self.tree.beyond(below[0]), None if any(self.tree.bodies[i].moves for i in below) else R

    def _below(self, base: str) -> list[int]:
        """Indices of a body, its parent, and so on to the ground."""
        bodies = [name for name, body in zip(self.tree.names, self.tree.bodies, strict=True) if not body.massless]
        if base not in bodies:
            raise ModelError(f"The model has no body named '{base}'; its bodies are {', '.join(bodies)}.")
        path = [self.tree.names.index(base)]
        while self.tree.bodies[path[-1]].parent != BASE:
            path.append(self.tree.bodies[path[-1]].parent)
        return path


class _Chains:
    """Builder of a tree, to which bodies are added with their joints one by one."""

    def __init__(self, coordinates: Mapping[str, Coordinate], dependences: Mapping[str, Dependence]) -> None:
        self.coordinates, self.dependences = coordinates, dependences
        self.bodies: list[Body] = []
        self.place = {GROUND: BASE}
        self.worst: dict[bool, Worst] = {False: (0.0, ""), True: (0.0, "")}

    @property
    def distances(self) -> str:
        """Largest errors of polynomials for slides and turns, for a note."""
        both = (("mm", *self.worst[False]), ("mrad", *self.worst[True]))
        return " and ".join(f"{1e3 * x:.2g} {unit} ({where})" for unit, x, where in both if where)

    def add(self, link: Link) -> None:
        """Adds a body to the tree, preceded by massless links for all steps of its joint but the last."""
        parent = self.place[link.parent.body]
        moving = [(factor, self._dependence(factor)) for factor in link.factors]
        home, steps = _folded(link.parent.pose, moving)
        own = self._leading(steps)
        for element in coordinate_elements(link.joint):
            name = str(element.get("name"))
            if self.dependences[name].leader == name and name not in own.values():
                # A massless link that only has a coordinate, for followers to refer to.
                turns = any(factor.turns for factor, _, _ in steps if factor.coordinate == name)
                twist = np.eye(6)[3 if turns else 0]
                self.bodies.append(Body(f"{name}:coordinate", parent, np.eye(4), twist, name, True))
        to_child = se3.inverse(link.child.pose)
        if not steps:
            self.bodies.append(Body(link.child.body, parent, home @ to_child, np.zeros(6)))
        for k, (factor, dependence, after) in enumerate(steps):
            last = k == len(steps) - 1
            behind = after @ to_child if last else after
            name = link.child.body if last else f"{link.child.body}:{factor.name.partition(', ')[2]}"
            twist, follows = factor.twist, None
            if k in own:
                constant, slope = dependence.curve.exact.coef.tolist()  # type: ignore[union-attr]
                home, twist = home @ se3.exp(twist, constant), slope * twist
            else:
                follows = self._follower(factor, dependence)
            twist = se3.Ad(se3.inverse(behind)) @ twist
            self.bodies.append(Body(name, parent, home @ behind, twist, own.get(k, ""), not last, follows))
            parent, home = len(self.bodies) - 1, np.eye(4)
        self.place[link.child.body] = len(self.bodies) - 1

    def _dependence(self, factor: ElementaryMotion) -> Dependence:
        """Dependence of a turn or slide on a free coordinate."""
        if not factor.coordinate:
            return Dependence(None, factor.curve)
        return self.dependences[factor.coordinate].then(factor.curve)

    def _leading(self, steps: "list[_Step]") -> dict[int, str]:
        """First step of each coordinate that equals it up to sign and a constant, by index."""
        own: dict[int, str] = {}
        for k, (factor, dependence, _) in enumerate(steps):
            name, exact = factor.coordinate, dependence.curve.exact
            itself = dependence.leader == name and exact is not None and exact.degree() == 1
            if itself and abs(exact.coef[1]) == 1 and name not in own.values():  # type: ignore[union-attr]
                own[k] = name
        return own

    def _follower(self, factor: ElementaryMotion, dependence: Dependence) -> Follower:
        """A turn or slide as a function of its leader's coordinate, whose largest error is remembered."""
        leader = str(dependence.leader)
        span = needed_span(self.coordinates[leader], dependence.curve)
        fitted, distance = dependence.curve.fitted(*span)
        if distance > self.worst[factor.turns][0]:
            self.worst[factor.turns] = distance, factor.name
        return Follower(leader, tuple(fitted.coef.tolist()), span)


_Step = tuple[ElementaryMotion, Dependence, np.ndarray]
"""A turn or slide that moves, its dependence, and the constant pose behind it."""


def _folded(home: np.ndarray, moving: list[tuple[ElementaryMotion, Dependence]]) -> tuple[np.ndarray, list[_Step]]:
    """Folds constant turns and slides into the poses of those that move.

    Returns:
        The pose before the first moving step, and the moving steps.
    """
    steps: list[_Step] = []
    for factor, dependence in moving:
        if dependence.leader is not None:
            steps.append((factor, dependence, np.eye(4)))
            continue
        constant = se3.exp(factor.twist, float(dependence.curve.evaluated(0.0)))
        if steps:
            steps[-1] = (*steps[-1][:2], steps[-1][2] @ constant)
        else:
            home = home @ constant
    return home, steps
