"""The regressor of Eq. 14 in closed form, for one sample of numbers or of signals.

With x_1, x_2, x_3 the columns of R_0i and x_4 = p_0i in the base frame, and J the pseudo-inertia of body i,
d'Alembert's principle summed over the body's mass elements gives

    F = Σ_k J_4k ẍ_k        τ = Σ_jk J_jk x_j × ẍ_k        ẍ_k = S x_k,   S = α̂ + ω̂ ω̂,   ẍ_4 = p̈ - g

which is linear in φ because J is. `ident.model.dim` computes the same matrix term by term.
"""

from typing import NamedTuple

import numpy as np

from ident.geometry.inertia import symmetric
from ident.geometry.se3 import Ad, hat, pose
from ident.mechanism.body import BASE, Body
from ident.mechanism.tree import Tree


class BodyMotion(NamedTuple):
    """Motion of a frame, in base axes.

    Attributes:
        R: Its rotation matrix (3, 3).
        p: Its origin (3,).
        w: Angular velocity ω (3,).
        dw: Angular acceleration α (3,).
        a: Acceleration of the origin less gravity (3,).
        S: Matrix of the second derivative of a vector fixed in the frame, `ẍ = S x` (3, 3).
    """

    R: np.ndarray
    p: np.ndarray
    w: np.ndarray
    dw: np.ndarray
    a: np.ndarray
    S: np.ndarray


def base_motion(w: np.ndarray, dw: np.ndarray, a: np.ndarray) -> BodyMotion:
    """Motion of the base frame in its current axes, from ω, α and its acceleration less gravity (3,)."""
    return BodyMotion(np.eye(3), np.zeros(3), w, dw, a, _second_derivative(w, dw))


def body_motions(tree: Tree, root: BodyMotion, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> list[BodyMotion]:
    """Motions of all bodies, in base axes.

    Args:
        tree: The mechanism.
        root: Motion of the base frame.
        q: Joint coordinates (n_q,); `dq`, `ddq` velocities and accelerations (n,).
    """
    motions: list[BodyMotion] = []
    for body, (q_i, dq_i, ddq_i) in zip(tree.bodies, tree.body_states(q, dq, ddq), strict=True):
        parent = root if body.parent == BASE else motions[body.parent]
        motions.append(_moved(parent, body, q_i, dq_i, ddq_i))
    return motions


def base_wrench_rows(tree: Tree, motions: list[BodyMotion]) -> np.ndarray:
    """Regressor of the wrench on the mechanism (Eq. 14): rows `[F; τ]` in the base frame (6, 10 b)."""
    return np.hstack([np.zeros((6, 0)), *(_body_columns(motions[i]) for i in tree.inertial)])


def body_wrench(motion: BodyMotion, phi: np.ndarray) -> np.ndarray:
    """Wrench on one body with parameters φ (10,), in the base frame (6,)."""
    R, p, _, _, a, S = motion
    h, inertia = R @ phi[1:4], symmetric(phi[4:])
    second = np.eye(3) * (np.trace(inertia) / 2) - inertia
    force = a * phi[0] + S @ h
    A = R @ second @ R.T @ S.T
    turning = np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])
    return np.concatenate([force, hat(p) @ force + hat(h) @ a + turning])


def body_wrenches(tree: Tree, motions: list[BodyMotion], phi: np.ndarray) -> list[np.ndarray]:
    """Inertial and gravitational wrench of every body in the base frame (6,), zeros for massless ones."""
    wrenches = [np.zeros(6)] * len(tree.bodies)
    for i, own in zip(tree.inertial, phi.reshape(-1, 10), strict=True):
        wrenches[i] = body_wrench(motions[i], own)
    return wrenches


def joint_torques(tree: Tree, motions: list[BodyMotion], q: np.ndarray, wrenches: list[np.ndarray]) -> np.ndarray:
    """Torques of the n freedoms that balance wrenches on the bodies: `τ_Ji = ξ_iᵀ Σ_carried Γ` (Eq. 11).

    Args:
        tree: The mechanism.
        motions: Motions of the bodies.
        q: Joint coordinates, as by `Tree.started`.
        wrenches: Wrench on each body in the base frame (6,), or its rows (6, k).
    """
    carried, felt = list(wrenches), list[np.ndarray]()
    for i in reversed(range(len(tree.bodies))):
        parent = tree.bodies[i].parent
        if parent != BASE:
            carried[parent] = carried[parent] + carried[i]
    for i, body in enumerate(tree.bodies):
        # The joint's twist in the base frame, like the wrench: power is the same in any frame.
        screws = Ad(pose(motions[i].R, motions[i].p)) @ body.motions
        felt.append(screws.T @ carried[i])
    return tree.joint_sums(q, felt)


def joint_torque_rows(tree: Tree, motions: list[BodyMotion], q: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Regressor of the joint torques (n, 10 b), from that of the wrench."""
    rows = [np.zeros(Y.shape, Y.dtype) for _ in tree.bodies]
    for k, i in enumerate(tree.inertial):
        own = slice(10 * k, 10 * k + 10)
        rows[i][:, own] = Y[:, own]
    return joint_torques(tree, motions, q, rows)


def _moved(parent: BodyMotion, body: Body, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> BodyMotion:
    """Motion of a body from its parent's."""
    R_joint, p_joint = _joint_pose(body, q)
    R, offset = parent.R @ R_joint, parent.R @ p_joint
    p, a = parent.p + offset, parent.a + parent.S @ offset
    if not body.moves:
        return BodyMotion(R, p, parent.w, parent.dw, a, parent.S)
    slides, turns = R @ body.motions[:3], R @ body.motions[3:]
    slide, turn = slides @ dq, turns @ dq
    w = parent.w + turn
    dw = parent.dw + turns @ ddq + hat(parent.w) @ turn
    a = a + slides @ ddq + hat(2 * parent.w + turn) @ slide
    return BodyMotion(R, p, w, dw, a, _second_derivative(w, dw))


def _joint_pose(body: Body, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and position (3,) of a body in its parent's frame, `home @ joint_pose` with constants folded."""
    R_home, p_home = body.home[:3, :3], body.home[:3, 3]
    if not body.moves:
        return R_home, p_home
    if body.is_ball:
        T = body.home @ body.joint_pose(q)
        return T[:3, :3], T[:3, 3]
    v, K = body.twist[:3], hat(body.twist[3:])
    if isinstance(q[0], float):  # a joint that constraints hold still, among signals
        q = q.astype(float)
    sin, cos, angle = np.sin(q), np.cos(q), q[0]
    R = R_home @ (np.eye(3) + K @ K) + R_home @ K * sin - R_home @ K @ K * cos
    p = p_home + R_home @ K @ v + R_home @ (v + K @ K @ v) * angle - R_home @ K @ v * cos - R_home @ K @ K @ v * sin
    return R, p


def _body_columns(motion: BodyMotion) -> np.ndarray:
    """Regressor columns of one body (6, 10), rows 0-2 force, 3-5 moment."""
    R, p, _, dw, a, S = motion
    ddx = S @ R
    out = np.zeros((6, 10), np.result_type(p, a, ddx))
    out[:3, 0], out[3:, 0] = a, hat(p) @ a
    out[:3, 1:4], out[3:, 1:4] = ddx, hat(p) @ ddx - hat(a) @ R
    # Σ_k x_k × ẍ_k = 2 α. As Σ = tr(I)/2 - I, I_xx enters with (-Σ_xx + Σ_yy + Σ_zz)/2 and I_xy with -Σ_xy.
    moments = [hat(x) @ ddx for x in R.T]
    for k in range(3):
        out[3:, 4 + k] = dw - moments[k][:, k]
    for column, (j, k) in enumerate(((0, 1), (0, 2), (1, 2)), start=7):
        out[3:, column] = -moments[j][:, k] - moments[k][:, j]
    return out


def _second_derivative(w: np.ndarray, dw: np.ndarray) -> np.ndarray:
    """`S = α̂ + ω̂ ω̂` with `ẍ = S x` (3, 3)."""
    return hat(dw) + hat(w) @ hat(w)
