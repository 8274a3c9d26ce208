"""The regressor of Eq. 14 in closed form, for many samples at once.

With x_1, x_2, x_3 the columns of R_0i and x_4 = p_0i in the base frame, and J the pseudo-inertia of body i,
d'Alembert's principle summed over the body's mass elements gives

    F = Σ_k J_4k ẍ_k        τ = Σ_jk J_jk x_j × ẍ_k        ẍ_k = α × x_k + ω × (ω × x_k),   ẍ_4 = p̈ - g

which is linear in φ because J is. Inside this module arrays are laid out samples-last, (3, N), so that every line
streams through the cache; `ident.dim` computes the same matrix term by term.
"""

from typing import NamedTuple

import numpy as np

from ident.se3 import Ad, hat
from ident.tree import BASE, Body, Tree


class _Motion(NamedTuple):
    """Motion of a frame in base axes, samples-last."""

    R: np.ndarray
    p: np.ndarray
    w: np.ndarray
    dw: np.ndarray
    a: np.ndarray
    """Acceleration of the origin less gravity."""


CHUNK = 2048
"""Samples worked on together: about as many as the temporaries of one body need to stay in the cache."""


def base_wrench_regressor(
    tree: Tree, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, *, gravity: np.ndarray
) -> np.ndarray:
    """Regressor of the wrench that the ground exerts on a mechanism with a fixed base: `Γ_0 = Y φ` (Eq. 14).

    Args:
        tree: The mechanism of b bodies and n joints.
        q: Joint coordinates in rad or m (N, n); `dq`, `ddq` their first and second time derivatives (N, n).
        gravity: Acceleration of gravity in the base frame, m/s² (3,).

    Returns:
        Y (N, 6, 10 b), rows `[F; τ]` in the base frame, columns in the order of `ident.inertia.PARAMETERS`. The array
        is a view of a C-contiguous (10 b, 6, N) block.

    Raises:
        ValueError: The joint arrays do not have the shape (N, n).
    """
    states = [tree.body_values(np.asarray(x, float)) for x in (q, dq, ddq)]
    if states[0].ndim != 2 or len({x.shape for x in states}) != 1:
        raise ValueError(
            f"q, dq and ddq need one shape (N, {len(tree.moving)}), got "
            f"{np.shape(q)}, {np.shape(dq)} and {np.shape(ddq)}."
        )
    samples = len(states[0])
    out = np.zeros((10 * len(tree.bodies), 6, samples))
    minus_g = -np.asarray(gravity, float)
    for start in range(0, samples, CHUNK):
        part = slice(start, start + CHUNK)
        q_part, dq_part, ddq_part = (x[part].T for x in states)
        _fill(tree, q_part, dq_part, ddq_part, minus_g, out[:, :, part])
    return out.transpose(2, 1, 0)


def joint_torque_regressor(
    tree: Tree, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, *, gravity: np.ndarray
) -> np.ndarray:
    """Regressor of the joint torques, `τ_J = Y φ`: Eq. 11's projection `τ_Ji = ξ_iᵀ Γ_i` of the wrench on a link.

    Args:
        tree: The mechanism of b bodies and n joints.
        q: Joint coordinates in rad or m (N, n); `dq`, `ddq` their first and second time derivatives (N, n).
        gravity: Acceleration of gravity in the base frame, m/s² (3,).

    Returns:
        Y (N, n, 10 b), rows in N m, or N for a prismatic joint.

    Raises:
        ValueError: The joint arrays do not have the shape (N, n).
    """
    Y = base_wrench_regressor(tree, q, dq, ddq, gravity=gravity)
    poses = tree.poses(np.asarray(q, float))
    out = np.zeros((len(Y), len(tree.moving), Y.shape[2]))
    for j, i in enumerate(tree.moving):
        # The body's wrench about the base, times the joint's twist in the base frame: power is the same in any frame.
        screw = (Ad(poses[:, i]) @ tree.bodies[i].twist)[:, None]
        for k in tree.carried(i):
            columns = slice(10 * k, 10 * k + 10)
            out[:, j, columns] = (screw @ Y[:, :, columns])[:, 0]
    return out


def _fill(tree: Tree, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, minus_g: np.ndarray, out: np.ndarray) -> None:
    """Writes the regressor of one chunk into `out` (10 b, 6, C); joint values come samples-last (b, C)."""
    zero = np.zeros((3, q.shape[1]))
    one = np.broadcast_to(np.eye(3)[..., None], (3, 3, q.shape[1]))
    base = _Motion(one, zero, zero, zero, zero + minus_g[:, None])
    motion: list[_Motion] = []
    for i, body in enumerate(tree.bodies):
        motion.append(_moved(base if body.parent == BASE else motion[body.parent], body, q[i], dq[i], ddq[i]))
        _body_columns(motion[i], out[10 * i : 10 * i + 10])


def _moved(parent: _Motion, body: Body, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> _Motion:
    """Motion of a body from its parent's, for any joint twist."""
    R_p, p_p, w_p, dw_p, a_p = parent
    R_home, p_home = body.home[:3, :3], body.home[:3, 3]
    v, axis = body.twist[:3], body.twist[3:]
    K = hat(axis)
    sin, versine = np.sin(q), 1 - np.cos(q)
    R_joint = _outer(R_home, 1) + _outer(R_home @ K, sin) + _outer(R_home @ K @ K, versine)
    p_joint = _outer(p_home, 1) + _outer(R_home @ v, q)
    p_joint = p_joint + _outer(R_home @ K @ v, versine) + _outer(R_home @ K @ K @ v, q - sin)

    R = R_p[:, 0, None] * R_joint[0] + R_p[:, 1, None] * R_joint[1] + R_p[:, 2, None] * R_joint[2]
    offset = R_p[:, 0] * p_joint[0] + R_p[:, 1] * p_joint[1] + R_p[:, 2] * p_joint[2]
    turn, slide, swing = (_turned(R, x) for x in (axis, v, K @ v))
    w = w_p + turn * dq
    dw = dw_p + turn * ddq + _cross(w_p, turn) * dq
    relative = slide * ddq + swing * dq**2 + 2 * _cross(w_p, slide) * dq
    return _Motion(R, p_p + offset, w, dw, a_p + _second_derivative(offset, w_p, dw_p) + relative)


def _body_columns(motion: _Motion, out: np.ndarray) -> None:
    """Ten columns of one body, written into `out` (10, 6, C); rows 0-2 force, 3-5 moment."""
    R, p, w, dw, a = motion
    x = [R[:, k] for k in range(3)]
    ddx = [_second_derivative(column, w, dw) for column in x]
    out[0, :3] = a
    out[0, 3:] = _cross(p, a)
    for k in range(3):
        out[1 + k, :3] = ddx[k]
        out[1 + k, 3:] = _cross(p, ddx[k]) + _cross(x[k], a)
    # Σ = tr(I)/2 - I, so that I_xx enters with (-Σ_xx + Σ_yy + Σ_zz)/2 and I_xy with -Σ_xy.
    own = [_cross(x[k], ddx[k]) for k in range(3)]
    half = (own[0] + own[1] + own[2]) / 2
    for k in range(3):
        out[4 + k, 3:] = half - own[k]
    for row, (j, k) in enumerate(((0, 1), (0, 2), (1, 2)), start=7):
        out[row, 3:] = -_cross(x[j], ddx[k]) - _cross(x[k], ddx[j])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of samples-last vectors (3, C)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    np.subtract(a[1] * b[2], a[2] * b[1], out=out[0])
    np.subtract(a[2] * b[0], a[0] * b[2], out=out[1])
    np.subtract(a[0] * b[1], a[1] * b[0], out=out[2])
    return out


def _second_derivative(x: np.ndarray, w: np.ndarray, dw: np.ndarray) -> np.ndarray:
    """Second time derivative of vectors x that turn with angular velocity w and acceleration dw."""
    return _cross(dw, x) + _cross(w, _cross(w, x))


def _outer(constant: np.ndarray, values: np.ndarray | float) -> np.ndarray:
    """A constant array times a value for each sample (…, C)."""
    return constant[..., None] * values


def _turned(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rotations (3, 3, C) times one fixed vector (3,)."""
    return R[:, 0] * x[0] + R[:, 1] * x[1] + R[:, 2] * x[2]
