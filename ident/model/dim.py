"""The paper's recursive dynamic identification model, one function per equation (Eq. 7-14), for one sample.

This is the readable specification. `ident.model.regressor` computes the same matrix for many samples at once. Equations
are used in their corrected form; docs/reproduction.md lists all errata. With arrays of symbols (dtype object) the
functions derive the model symbolically.
"""

import numpy as np

from ident.geometry import se3
from ident.geometry.inertia import symmetric
from ident.mechanism.body import BASE, Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion


def relative_pose(body: Body, theta: np.ndarray) -> np.ndarray:
    """Eq. 7: `T_{i-1,i} = T_{i-1,i}(0) exp(ξ̂_i θ_i)` (4, 4), from the coordinates of one joint."""
    return body.home @ body.joint_pose(theta)


def body_twist(T_0i: np.ndarray, spatial_twist: np.ndarray) -> np.ndarray:
    """Eq. 8: the joint twist in the frame of its body, `ξ_i = Ad(T_0i(0)⁻¹) ξ_spatial` (6,).

    Args:
        T_0i: Home pose of the body in the base frame (4, 4).
        spatial_twist: Joint twist at home, written in the base frame (6,).
    """
    return se3.Ad(se3.inverse(T_0i)) @ spatial_twist


def forward_recursion(
    mechanism: Mechanism, motion: Motion
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Eq. 9: relative pose, twist and twist rate of every body.

    The base frame rests unless its motion is given, and gravity enters as its acceleration: `V_0 = 0`, `V̇_0 = [-g; 0]`.

    Args:
        mechanism: The mechanism.
        motion: One sample: q (n_q,), q̇ and q̈ (n,), and the motion of the base.

    Returns:
        Three lists over the bodies: T_{i-1,i} (4, 4), V_i (6,) and V̇_i (6,), the last two in body axes.
    """
    tree, base, down = mechanism.tree, motion.base, mechanism.gravity
    theta, dtheta, ddtheta = zip(*tree.body_states(motion.q, motion.dq, motion.ddq), strict=True)
    if base is None:
        V_0, dV_0 = np.zeros(6, dtype=int), np.zeros(6, dtype=int)
    else:
        V_0, dV_0, down = base.V, base.dV, base.T[:3, :3].T @ down
    dV_0 = dV_0 - np.concatenate([down, np.zeros(3, dtype=int)])
    T: list[np.ndarray] = []
    V: list[np.ndarray] = []
    dV: list[np.ndarray] = []
    for i, body in enumerate(tree.bodies):
        T.append(relative_pose(body, theta[i]))
        to_body = se3.Ad(se3.inverse(T[i]))
        carried = to_body @ (V_0 if body.parent == BASE else V[body.parent])
        dcarried = to_body @ (dV_0 if body.parent == BASE else dV[body.parent])
        own = body.motions @ dtheta[i]
        V.append(carried + own)
        dV.append(dcarried + body.motions @ ddtheta[i] - se3.ad(own) @ carried)
    return T, V, dV


def spatial_inertia(phi: np.ndarray) -> np.ndarray:
    """Eq. 10: `M = [[m 1, -m r̂], [m r̂, I']]` of one body from its φ (10,), in the body frame (6, 6)."""
    mr = se3.hat(phi[1:4])
    return np.block([[phi[0] * np.eye(3, dtype=int), -mr], [mr, symmetric(phi[4:])]])


def inverse_dynamics(mechanism: Mechanism, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 11: the wrench that the ground exerts on the mechanism, and the joint torques.

    Args:
        mechanism: The mechanism, with the φ of its bodies.
        motion: One sample, as in `forward_recursion`.

    Returns:
        Γ_0 `[F; τ]` in the base frame, N and N m (6,); joint torques τ_J in N m, or N for a prismatic joint (n,).
    """
    tree, (T, V, dV) = mechanism.tree, forward_recursion(mechanism, motion)
    wrench = [np.zeros(6)] * len(tree.bodies)
    for i, phi_i in zip(tree.inertial, mechanism.known.reshape(-1, 10), strict=True):
        M = spatial_inertia(phi_i)
        wrench[i] = M @ dV[i] - se3.ad(V[i]).T @ M @ V[i]
    ground = np.zeros(6)
    for i in reversed(range(len(tree.bodies))):
        carried = se3.coAd(T[i]) @ wrench[i]
        if tree.bodies[i].parent == BASE:
            ground = ground + carried
        else:
            wrench[tree.bodies[i].parent] = wrench[tree.bodies[i].parent] + carried
    torques = [body.motions.T @ wrench_i for body, wrench_i in zip(tree.bodies, wrench, strict=True)]
    return ground, tree.joint_sums(motion.q, torques)


def momentum_regressor(V: np.ndarray) -> np.ndarray:
    """Eq. 12: the matrix with `M V = momentum_regressor(V) φ` (6, 10); with V̇ it gives `M V̇`.

    Args:
        V: Twist of a body in its own axes (6,).
    """
    v, (w1, w2, w3) = V[:3], V[3:]
    out = np.zeros((6, 10), V.dtype)
    out[:3, 0] = v
    out[:3, 1:4] = se3.hat(V[3:])
    out[3:, 1:4] = -se3.hat(v)
    out[3:, 4:] = [[w1, 0, 0, w2, w3, 0], [0, w2, 0, w1, 0, w3], [0, 0, w3, 0, w1, w2]]
    return out


def body_regressor(V: np.ndarray, dV: np.ndarray) -> np.ndarray:
    """Eq. 13: `Y_i = Y_{i,1} - ad(V_i)ᵀ Y_{i,2}`, the wrench on one body being `Y_i φ_i` (6, 10).

    Args:
        V: Twist of the body in its own axes (6,).
        dV: Its rate, gravity included as in Eq. 9 (6,).
    """
    return momentum_regressor(dV) - se3.ad(V).T @ momentum_regressor(V)


def base_wrench_regressor(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Eq. 14: Y with `Γ_0 = Y φ`, for one sample.

    Args:
        mechanism: The mechanism of b bodies with φ.
        motion: One sample, as in `forward_recursion`.

    Returns:
        Y = [Ad(T_01⁻¹)ᵀ Y_1 … Ad(T_0b⁻¹)ᵀ Y_b] (6, 10 b).
    """
    T, V, dV = forward_recursion(mechanism, motion)
    T_0: list[np.ndarray] = []
    blocks = []
    for i, body in enumerate(mechanism.tree.bodies):
        T_0.append(T[i] if body.parent == BASE else T_0[body.parent] @ T[i])
        if not body.massless:
            blocks.append(se3.coAd(T_0[i]) @ body_regressor(V[i], dV[i]))
    return np.hstack(blocks)
