"""Subjects of the benchmark: mechanisms and a loop of MuJoCo steps; and Pinocchio's regressor."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

import scenes
from experiments.data.paper import SCENE
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.files.limits import library
from ident.geometry import se3
from ident.geometry.inertia import PINOCCHIO
from ident.geometry.se3 import pose, rotation
from ident.mechanism.body import BASE, Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import CHUNK, base_wrench_regressor
from ident.parameters.base_parameters import STANDARD_GRAVITY, BaseParameters, find_base_parameters
from ident.parameters.structure import Sensors
from sim.models.mujoco_model import tree_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.readings import steps_per_sample
from sim.simulation.simulate import LEAD_IN, RATE, servos

PENDULUM, ARM, TREE = "double pendulum", "7-link arm", "30-body tree"
"""Names of the mechanisms whose axes are along the axes of their frames."""

TILTED = f"{PENDULUM}, tilted"
"""Name of the double pendulum with tilted axes."""

PINOCCHIO_NAME = "Pinocchio"
"""Name in the tables."""


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
        """Samples with states of unit variance, and the wrench of random parameters with noise of 0.1 N and N m."""
        rng = np.random.default_rng(seed)
        q, dq, ddq = rng.normal(size=(3, number, len(self.tree.freedoms)))
        base = BaseMotion.from_free_joint(*(rng.normal(size=(number, k)) for k in (7, 6, 6))) if self.moving else None
        samples = Samples(Motion(q, dq, ddq, base), 0.1 * rng.normal(size=(number, 6)))
        psi = rng.normal(size=self.parameters.rank)
        for start in range(0, number, CHUNK):
            part = samples[start : start + CHUNK]
            part.measured[:] += self.regressor(part, self.parameters.kept) @ psi
        return samples

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


def bare_loop(spec: mujoco.MjSpec, samples: int) -> Callable[[], None]:
    """Loop over the steps of a recording with its controls, which reads nothing."""
    model = spec.compile()
    driven = servos(model, len(DOUBLE_PENDULUM.offset))
    steps = round(LEAD_IN / model.opt.timestep) + steps_per_sample(model, RATE) * (samples - 1)
    time = np.arange(steps) * model.opt.timestep - LEAD_IN
    desired = Motion(*replace(DOUBLE_PENDULUM, noise=0.0).trajectory(time))
    controls = driven.commands(time, desired)

    def loop() -> None:
        data = mujoco.MjData(model)
        data.qpos[driven.qpos], data.qvel[driven.dof] = desired.q[0], desired.dq[0]
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)

    return loop


States = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Positions, velocities and accelerations, one row for each sample."""


class Pinocchio:
    """The tree on a free-flyer in Pinocchio.

    Joints turn about their own origins: a joint's frame is on its axis.

    Attributes:
        model: The tree as a Pinocchio model.
        joint: Index of the joint that carries each body.
        in_joint: Pose of each body in that joint's frame.
    """

    def __init__(self, tree: Tree, gravity: np.ndarray) -> None:
        """Builds the model of a tree; gravity is in its base frame, m/s² (3,).

        Raises:
            InputError: Pinocchio is not installed.
        """
        with library("peers", "This"):
            import pinocchio as pin
        self.tree, self.model, self._pin = tree, pin.Model(), pin
        self.model.gravity.linear = gravity
        root = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
        self.joint, self.in_joint = {BASE: root}, {BASE: np.eye(4)}
        for i, body in enumerate(tree.bodies):
            parent, home = self.joint[body.parent], self.in_joint[body.parent] @ body.home
            if not body.moves:
                self.joint[i], self.in_joint[i] = parent, home
                continue
            kind, center = _joint(pin, body)
            T = home @ se3.pose(np.eye(3), center)
            self.joint[i] = self.model.addJoint(parent, kind, pin.SE3(T[:3, :3], T[:3, 3]), f"joint{i}")
            self.in_joint[i] = se3.pose(np.eye(3), -center)
        self._neutral = pin.neutral(self.model)

    def states(self, states: States, base: BaseMotion | None) -> States:
        """Our states (N, ·) in Pinocchio's order; the base rests if its motion is not given.

        Pinocchio's quaternions are `x, y, z, w`, and its joints may be in another order.
        """
        own = self.tree.body_coordinates(states[0]), *map(self.tree.body_velocities, states[1:])
        samples = len(states[0])
        q, (v, a) = np.tile(self._neutral, (samples, 1)), np.zeros((2, samples, self.model.nv))
        if base is not None:
            q[:, :7] = [self._pin.SE3ToXYZQUAT(self._pin.SE3(T)) for T in base.T]
            v[:, :6], a[:, :6] = base.V, base.dV
        for i, (x, dx, ddx) in enumerate(zip(*own, strict=True)):
            body, at = self.tree.bodies[i], self.model.joints[self.joint[i]]
            if body.moves:
                x = np.roll(x, -1, axis=1) / np.linalg.norm(x, axis=1)[:, None] if body.is_ball else x
                q[:, at.idx_q : at.idx_q + at.nq] = x
                v[:, at.idx_v : at.idx_v + at.nv], a[:, at.idx_v : at.idx_v + at.nv] = dx, ddx
        return q, v, a

    @property
    def rows(self) -> list[int]:
        """Indices of our velocities among Pinocchio's."""
        joints = [self.model.joints[self.joint[i]] for i in self.tree.moving]
        return [row for at in joints for row in range(at.idx_v, at.idx_v + at.nv)]

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Regressors (N, 6, 10 b) in Pinocchio's order of columns: the free-flyer's rows of the torque regressor."""
        # Iterating over rows is faster than indexing them.
        model, data, regressor = self.model, self.model.createData(), self._pin.computeJointTorqueRegressor
        out = np.empty((len(q), 6, 10 * (model.njoints - 1)))
        for own, x, dx, ddx in zip(out, q, v, a, strict=True):
            own[:] = regressor(model, data, x, dx, ddx)[:6]
        return out

    def columns(self, columns: Sequence[int]) -> list[int]:
        """Indices of our columns among Pinocchio's, for bodies whose frames are their joints'."""
        order = [PINOCCHIO.index(k) for k in range(10)]
        bodies = [self.joint[i] - 1 for i in self.tree.inertial]
        return [10 * bodies[k // 10] + order[k % 10] for k in columns]


def _joint(pin: Any, body: Body) -> tuple[Any, np.ndarray]:
    """Pinocchio's fastest joint for a body, and the joint's center in the body's frame (3,)."""
    v, w = body.twist[:3], body.twist[3:]
    if body.is_ball:
        return pin.JointModelSpherical(), np.array([v[2, 1], v[0, 2], v[1, 0]])
    if not w.any():
        return pin.JointModelPrismaticUnaligned(v), np.zeros(3)
    # Joints about an axis of their frame are faster.
    for axis, aligned in zip(np.eye(3), (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ), strict=True):
        if np.array_equal(w, axis):
            return aligned(), np.cross(w, v)
    return pin.JointModelRevoluteUnaligned(w), np.cross(w, v)
