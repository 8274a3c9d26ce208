"""Joint torques and body poses of a desired motion, for all its samples at once.

Only driven joints move; every other one stays as the model draws it. A link is described in a frame of its own that is
the world's at home, so that its twist and its inertia are those that MuJoCo gives at home, and its pose in its parent's
frame is `exp(ξ̂ q)`. On whatever such a motion acts, twists, wrenches, points or quaternions, with X the matrix of ξ̂
there,

    exp(X q) = 1 + s X + c X²        s = sin q, c = 1 - cos q for a hinge (X³ = -X);  s = q, c = 0 for a slide (X² = 0)

Arrays are laid out samples-last, (6, N), inside this module.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.models.mujoco_model import gravity_of


@dataclass(frozen=True, eq=False)
class Link:
    """A driven joint with what moves with it.

    Attributes:
        parent: Index of the link that carries it, -1 for the world.
        column: The joint's column in a motion.
        twist: Joint twist `[v; ω]`, |ω| = 1 for a hinge and ω = 0 for a slide (6,).
        inertia: Inertia of its bodies, so that `inertia @ twist` is a momentum (6, 6).
    """

    parent: int
    column: int
    twist: np.ndarray
    inertia: np.ndarray

    def coefficients(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s and c for joint positions q (N,)."""
        return (np.sin(q), 1 - np.cos(q)) if self.twist[3:].any() else (q, np.zeros_like(q))


@dataclass(frozen=True, eq=False)
class Chain:
    """The driven links of a model, parents first; they may branch.

    Attributes:
        links: The links.
        carrier: For every body, the index of the link that it belongs to, -1 if it rests.
        position: Positions of all bodies in the world at home, m (bodies, 3).
        quaternion: Their orientations, w, x, y, z (bodies, 4).
        gravity: Acceleration of gravity, m/s² (3,).
    """

    links: tuple[Link, ...]
    carrier: tuple[int, ...]
    position: np.ndarray
    quaternion: np.ndarray
    gravity: np.ndarray

    def torques(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """What moves the links, by the recursion of Newton and Euler.

        Args:
            q: Joint positions from home, rad or m (N, n).
            dq: Velocities (N, n); `ddq` accelerations (N, n).

        Returns:
            Torques in N m, or forces in N, in the order of the columns (N, n).
        """
        rest = np.zeros((6, 1)), np.concatenate([-self.gravity, np.zeros(3)])[:, None]
        steps = [(-_ad(link.twist), *link.coefficients(q[:, link.column])) for link in self.links]
        motions: list[tuple[np.ndarray, np.ndarray]] = []
        wrenches: list[np.ndarray] = []
        for link, (X, s, c) in zip(self.links, steps, strict=True):
            V, dV = (_moved(x, X, s, c) for x in (motions[link.parent] if link.parent >= 0 else rest))
            V = V + np.outer(link.twist, dq[:, link.column])
            dV = dV + (X @ V) * dq[:, link.column] + np.outer(link.twist, ddq[:, link.column])
            motions.append((V, dV))
            wrenches.append(link.inertia @ dV + _gyroscopic(V, link.inertia @ V))
        torques = np.empty(q.shape)
        for link, (X, s, c) in zip(reversed(self.links), reversed(steps), strict=True):
            wrench = wrenches.pop()
            torques[:, link.column] = link.twist @ wrench
            if link.parent >= 0:
                wrenches[link.parent] += _moved(wrench, X.T, s, c)
        return torques

    def poses(self, body: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses of a body in the world.

        Args:
            body: Its id.
            q: Joint positions from home, rad or m (N, n).

        Returns:
            Positions, m (N, 3), and quaternions, w, x, y, z (N, 4).
        """
        point, quaternion = np.append(self.position[body], 1.0)[:, None], self.quaternion[body][:, None]
        i = self.carrier[body]
        while i >= 0:
            link = self.links[i]
            angle = q[:, link.column]
            point = _moved(point, _on_points(link.twist), *link.coefficients(angle))
            quaternion = _moved(quaternion, _on_quaternions(link.twist), *link.coefficients(angle / 2))
            i = link.parent
        samples = np.zeros(len(q))
        return (point[:3] + samples).T, (quaternion + samples).T


def chain(model: mujoco.MjModel, joints: Sequence[int]) -> Chain:
    """The links that hinges and slides drive.

    Args:
        model: Compiled model.
        joints: Ids of the joints, in the order of a motion's columns.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    columns = {int(joint): column for column, joint in enumerate(joints)}
    links: list[Link] = []
    carrier = [-1]
    for body in range(1, model.nbody):
        carrier.append(carrier[model.body_parentid[body]])
        for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            if joint in columns:
                links.append(Link(carrier[body], columns[joint], _twist(model, data, joint), np.zeros((6, 6))))
                carrier[body] = len(links) - 1
        if carrier[body] >= 0:
            links[carrier[body]].inertia[:] += _inertia(model, data, body)
    return Chain(tuple(links), tuple(carrier), data.xpos.copy(), data.xquat.copy(), gravity_of(model))


def _twist(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> np.ndarray:
    axis = data.xaxis[joint]
    if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
        return np.concatenate([axis, np.zeros(3)])
    return np.concatenate([np.cross(data.xanchor[joint], axis), axis])


def _inertia(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> np.ndarray:
    m, c, R = model.body_mass[body], _hat(data.xipos[body]), data.ximat[body].reshape(3, 3)
    return np.block([[m * np.eye(3), -m * c], [m * c, R @ np.diag(model.body_inertia[body]) @ R.T - m * c @ c]])


def _hat(x: np.ndarray) -> np.ndarray:
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def _ad(twist: np.ndarray) -> np.ndarray:
    """ξ̂ as it acts on twists."""
    v, w = _hat(twist[:3]), _hat(twist[3:])
    return np.block([[w, v], [np.zeros((3, 3)), w]])


def _on_points(twist: np.ndarray) -> np.ndarray:
    """ξ̂ as it acts on points x, y, z, 1."""
    return np.block([[_hat(twist[3:]), twist[:3, None]], [np.zeros((1, 4))]])


def _on_quaternions(twist: np.ndarray) -> np.ndarray:
    """Twice ξ̂ as it acts on quaternions: their product with ω from the left."""
    w = twist[3:]
    return np.block([[np.zeros((1, 1)), -w[None]], [w[:, None], _hat(w)]])


def _moved(x: np.ndarray, X: np.ndarray, s: np.ndarray, c: np.ndarray) -> np.ndarray:
    """`exp(X q) x` for samples x (k, N)."""
    once = X @ x
    return x + s * once + c * (X @ once)


def _gyroscopic(V: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Wrench `-ad(V)ᵀ P` that turns a momentum P along with a frame of twist V (6, N)."""
    return np.concatenate([_cross(V[3:], P[:3]), _cross(V[3:], P[3:]) + _cross(V[:3], P[:3])])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of samples-last vectors (3, N)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
