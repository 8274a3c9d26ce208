"""Another library's regressor, in the fastest loop that its Python interface allows (extra `peers`)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.files.limits import library
from ident.geometry import se3
from ident.geometry.inertia import PINOCCHIO
from ident.mechanism.body import BASE, Body
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree

PINOCCHIO_NAME = "Pinocchio"
"""Name in the tables."""

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


def missing() -> tuple[str, ...]:
    """A note on the missing installation of Pinocchio; empty if it is installed."""
    try:
        Pinocchio(Tree((Body("base", BASE, np.eye(4), np.zeros(6)),)), np.zeros(3))
    except InputError as error:
        return (f"{PINOCCHIO_NAME} is not compared with. {error}",)
    return ()


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
