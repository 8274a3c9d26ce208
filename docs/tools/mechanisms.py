"""Mechanisms of the benchmark, and random samples of their motion."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import scenes
from experiments.data.paper import SCENE
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.geometry.se3 import pose, rotation
from ident.mechanism.body import BASE, Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import CHUNK, base_wrench_regressor
from ident.parameters.base_parameters import STANDARD_GRAVITY, BaseParameters, find_base_parameters
from ident.parameters.structure import Sensors
from sim.models.mujoco_model import tree_from_model

PENDULUM, ARM, TREE = "double pendulum", "7-link arm", "30-body tree"
"""Names of the mechanisms whose axes are along the axes of their frames."""

TILTED = f"{PENDULUM}, tilted"
"""Name of the double pendulum with tilted axes."""

NOISE = 0.1
"""Standard deviation of the noise on the wrench, N and N m."""


@dataclass(frozen=True, eq=False)
class Subject(Mechanism):
    """A mechanism of the benchmark; its first body is its base.

    Attributes:
        name: Name in the tables.
        moving: True if the base moves.
    """

    name: str = ""
    moving: bool = False

    @cached_property
    def parameters(self) -> BaseParameters:
        """Its base parameters."""
        return find_base_parameters(self, sensors=Sensors(moving_base=self.moving))

    def samples(self, number: int, seed: int = 0) -> Samples:
        """Samples with states of unit variance, and the wrench of random parameters with noise of `NOISE`."""
        rng = np.random.default_rng(seed)
        q, dq, ddq = rng.normal(size=(3, number, len(self.tree.freedoms)))
        base = BaseMotion.from_free_joint(*(rng.normal(size=(number, k)) for k in (7, 6, 6))) if self.moving else None
        samples = Samples(Motion(q, dq, ddq, base), NOISE * rng.normal(size=(number, 6)))
        psi = rng.normal(size=self.parameters.rank)
        for start in range(0, number, CHUNK):
            part = samples[start : start + CHUNK]
            part.measured[:] += self.regressor(part, self.parameters.kept) @ psi
        return samples

    def pieces(self, number: int, size: int) -> Iterator[Samples]:
        """Random samples, generated piece by piece."""
        for seed, start in enumerate(range(0, number, size)):
            yield self.samples(min(size, number - start), seed)

    def regressor(
        self, samples: Samples, columns: Sequence[int] | None = None, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Our regressor with all columns or some, in new memory or in `out` (N, 6, ·)."""
        states, base = samples.motion.states, samples.motion.base
        return base_wrench_regressor(self.tree, *states, gravity=self.gravity, base=base, columns=columns, out=out)

    @cached_property
    def equations(self) -> Equations:
        """Equations of its total wrench."""
        return Equations(self, self.parameters)


def double_pendulum(tilt_deg: float = 0.0) -> Subject:
    """The double pendulum of the scene, of three bodies."""
    name = TILTED if tilt_deg else PENDULUM
    return subject(name, tree_from_model(scenes.load(SCENE, tilt_deg=tilt_deg), "base"))


def subject(name: str, tree: Tree, *, moving: bool = False) -> Subject:
    """A tree under standard gravity."""
    return Subject(tree, STANDARD_GRAVITY, name=name, moving=moving)


def mechanisms() -> tuple[Subject, ...]:
    """Mechanisms with axes along their frames' axes, which simplifies the arithmetic, and twins with general axes."""
    return (
        double_pendulum(),
        double_pendulum(tilt_deg=5),
        subject(ARM, chain(8)),
        subject(f"{ARM}, general", in_general_position(chain(8))),
        subject(TREE, humanoid(), moving=True),
        subject(f"{TREE}, general", in_general_position(humanoid()), moving=True),
    )


def chain(bodies: int) -> Tree:
    """A base and an arm whose joints turn about z axes, each at right angles to its neighbours."""
    quarter = pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0.0, 0, 0.3]))
    links = [_hinged(i, i - 1, quarter, np.array([0.0, 0, 1])) for i in range(1, bodies)]
    return Tree((_base(), *links))


def humanoid() -> Tree:
    """A pelvis with two legs of six joints, and a spine of three with a neck of two and two arms of six; 30 bodies."""
    legs_and_spine = [(0, 6, [0, 0.1, 0]), (0, 6, [0, -0.1, 0]), (0, 3, [0, 0, 0.2])]
    neck_and_arms = [(15, 2, [0, 0, 0.3]), (15, 6, [0, 0.2, 0.2]), (15, 6, [0, -0.2, 0.2])]
    bodies = [_base()]
    for parent, links, place in legs_and_spine + neck_and_arms:
        for k in range(links):
            home = pose(np.eye(3), np.array(place if k == 0 else [0.02, 0, -0.15]))
            bodies.append(_hinged(len(bodies), parent if k == 0 else len(bodies) - 1, home, np.eye(3)[2 - k % 3]))
    return Tree(tuple(bodies))


def in_general_position(tree: Tree) -> Tree:
    """The same tree of hinges with random axes and random home poses."""
    rng = np.random.default_rng(0)
    links = []
    for i, body in enumerate(tree.bodies[1:], start=1):
        axis = rng.normal(size=3)
        home = pose(rotation(rng.normal(size=4)), 0.3 * rng.normal(size=3))
        links.append(_hinged(i, body.parent, home, axis / np.linalg.norm(axis)))
    return Tree((tree.bodies[0], *links))


def _base() -> Body:
    return Body("base", BASE, np.eye(4), np.zeros(6))


def _hinged(index: int, parent: int, home: np.ndarray, axis: np.ndarray) -> Body:
    return Body(f"link{index}", parent, home, np.concatenate([np.zeros(3), axis]), f"joint{index}")
