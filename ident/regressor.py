"""The regressor of Eq. 14 in closed form, for many samples at once.

With x_1, x_2, x_3 the columns of R_0i and x_4 = p_0i in the base frame, and J the pseudo-inertia of body i,
d'Alembert's principle summed over the body's mass elements gives

    F = Σ_k J_4k ẍ_k        τ = Σ_jk J_jk x_j × ẍ_k        ẍ_k = α × x_k + ω × (ω × x_k),   ẍ_4 = p̈ - g

which is linear in φ because J is. Inside this module arrays are laid out samples-last, (3, N), so that every line
streams through the cache; `ident.dim` computes the same matrix term by term.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ident.body import BASE, Body
from ident.dim import checked_gravity
from ident.se3 import Ad, hat
from ident.tree import BaseMotion, Tree


class _Motion(NamedTuple):
    """Motion of a frame in base axes, samples-last."""

    R: np.ndarray
    p: np.ndarray
    w: np.ndarray
    dw: np.ndarray
    a: np.ndarray
    """Acceleration of the origin less gravity."""


DRIVE = {"rotor": "Ia", "viscous": "Fv", "coulomb": "Fc"}
"""What takes torque at a joint besides the links: rotor inertia times acceleration (kg m²), viscous friction times
velocity (N m s), Coulomb friction times its sign (N m). The names are those of the columns."""

CHUNK = 2048
"""Samples worked on together: about as many as the temporaries of one body need to stay in the cache."""


def base_wrench_regressor(
    tree: Tree,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
    *,
    gravity: np.ndarray,
    base: BaseMotion | None = None,
) -> np.ndarray:
    """Regressor of the wrench that everything outside exerts on a mechanism: `Γ_0 = Y φ` (Eq. 14).

    On a fixed base that is the wrench of the ground, where nothing else touches the mechanism. On a moving base it is
    the sum of all contact wrenches (Eq. 3).

    Args:
        tree: The mechanism of b bodies with φ, its joints with n velocities.
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        dq: Joint velocities in rad/s or m/s (N, n); `ddq` their rates (N, n).
        gravity: Acceleration of gravity in the base frame, m/s² (3,); in the frame of `base.T` where that is given.
        base: Motion of the base frame (N samples), without it at rest.

    Returns:
        Y (N, 6, 10 b), rows `[F; τ]` in the base frame, columns in the order of `ident.inertia.PARAMETERS`. The array
        is a view of a C-contiguous (10 b, 6, N) block.

    Raises:
        ValueError: The joint arrays do not have these shapes, or a quaternion is zero.
    """
    q, dq, ddq = _states(tree, q, dq, ddq, base)
    down = checked_gravity(gravity).astype(float)
    out = np.zeros((10 * len(tree.inertial), 6, len(q)))
    for start in range(0, len(q), CHUNK):
        part = slice(start, start + CHUNK)
        root = _base_motion(base, down, part, len(q[part]))
        _fill(tree, root, q[part], dq[part], ddq[part], out[:, :, part])
    return out.transpose(2, 1, 0)


def joint_torque_regressor(
    tree: Tree,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
    *,
    gravity: np.ndarray,
    base: BaseMotion | None = None,
    drive: Sequence[str] = (),
) -> np.ndarray:
    """Regressor of the joint torques, `τ_J = Y φ`: Eq. 11's projection `τ_Ji = ξ_iᵀ Γ_i` of the wrench on a link.

    Args:
        tree: The mechanism; arguments as for `base_wrench_regressor`.
        q: Joint coordinates (N, n_q).
        dq: Joint velocities (N, n); `ddq` their rates (N, n).
        gravity: Acceleration of gravity, m/s² (3,).
        base: Motion of the base frame, without it at rest.
        drive: What else takes torque at every joint, out of `DRIVE`, each n columns more.

    Returns:
        Y (N, n, 10 b + n len(drive)), rows in N m, or N for a prismatic joint.

    Raises:
        ValueError: As for `base_wrench_regressor`, or an entry of `drive` is unknown.
    """
    Y = base_wrench_regressor(tree, q, dq, ddq, gravity=gravity, base=base)
    own = _drive_columns(np.asarray(dq, float), np.asarray(ddq, float), drive)
    poses = tree.poses(np.asarray(q, float))
    column = dict(zip(tree.inertial, range(0, Y.shape[2], 10), strict=True))
    rows = []
    for i, body in enumerate(tree.bodies):
        # The body's wrench about the base, times the joint's twist in the base frame: power is the same in any frame.
        screws = np.swapaxes(Ad(poses[:, i]) @ body.motions, -1, -2)
        block = np.zeros((len(Y), screws.shape[1], Y.shape[2]))
        for k in tree.carried(i):
            if body.moves and k in column:
                columns = slice(column[k], column[k] + 10)
                block[:, :, columns] = screws @ Y[:, :, columns]
        rows.append(block)
    return np.concatenate([np.concatenate(rows, axis=1), *own], axis=2)


def drive_names(tree: Tree, drive: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns that `joint_torque_regressor` adds: `Ia(elbow)`, `Fv(elbow)`, `Fc(elbow)`."""
    _check_drive(drive)
    return tuple(f"{DRIVE[kind]}({freedom})" for kind in drive for freedom in tree.freedoms)


def _drive_columns(dq: np.ndarray, ddq: np.ndarray, drive: Sequence[str]) -> list[np.ndarray]:
    """Columns of rotor inertia and friction, one diagonal block (N, n, n) a kind."""
    _check_drive(drive)
    signal = {"rotor": ddq, "viscous": dq, "coulomb": np.sign(dq)}
    return [signal[kind][:, :, None] * np.eye(signal[kind].shape[1]) for kind in drive]


def _check_drive(drive: Sequence[str]) -> None:
    unknown = [drive] if isinstance(drive, str) else [kind for kind in drive if kind not in DRIVE]
    if unknown:
        raise ValueError(f"Drive parameters are a list out of {', '.join(DRIVE)}, got {', '.join(unknown)}.")


def _states(
    tree: Tree, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, base: BaseMotion | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Checked joint arrays."""
    q, dq, ddq = (np.asarray(x, float) for x in (q, dq, ddq))
    tree.body_velocities(dq)
    if q.ndim != 2 or len(q) != len(dq) or dq.shape != ddq.shape:
        columns = sum(body.coordinates for body in tree.bodies)
        raise ValueError(
            f"q, dq and ddq need one number of samples N, shapes (N, {columns}), (N, {len(tree.freedoms)}) and "
            f"(N, {len(tree.freedoms)}), got {q.shape}, {dq.shape} and {ddq.shape}."
        )
    if not all(np.isfinite(x).all() for x in (q, dq, ddq)):
        raise ValueError("Joint states need finite numbers, got NaN or infinity.")
    for body, own in zip(tree.bodies, tree.body_coordinates(q), strict=True):
        if body.is_ball and not own.any(axis=1).all():
            sample = int(np.argmin(own.any(axis=1)))
            raise ValueError(f"Joint '{body.joint}' needs quaternions; that of sample {sample} is zero.")
    if base is not None and base.T.shape != (len(q), 4, 4):
        raise ValueError(f"{len(q)} joint states need as many samples of the base's motion, got {base.T.shape}.")
    return q, dq, ddq


def _base_motion(base: BaseMotion | None, gravity: np.ndarray, part: slice, samples: int) -> _Motion:
    """Motion of the base frame, written in its own axes of each instant."""
    zero = np.zeros((3, samples))
    one = np.broadcast_to(np.eye(3)[..., None], (3, 3, samples))
    if base is None:
        return _Motion(one, zero, zero, zero, zero - gravity[:, None])
    down = (np.swapaxes(base.T[part, :3, :3], 1, 2) @ gravity).T
    v, w, dv, dw = base.V[part, :3].T, base.V[part, 3:].T, base.dV[part, :3].T, base.dV[part, 3:].T
    return _Motion(one, zero, w, dw, dv + _cross(w, v) - down)


def _fill(tree: Tree, root: _Motion, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, out: np.ndarray) -> None:
    """Writes the regressor of one chunk into `out` (10 b, 6, C)."""
    states = tree.body_coordinates(q), tree.body_velocities(dq), tree.body_velocities(ddq)
    motion: list[_Motion] = []
    blocks = iter(out.reshape(-1, 10, *out.shape[1:]))
    for body, q_i, dq_i, ddq_i in zip(tree.bodies, *states, strict=True):
        parent = root if body.parent == BASE else motion[body.parent]
        motion.append(_moved(parent, body, q_i.T, dq_i.T, ddq_i.T))
        if not body.massless:
            _body_columns(motion[-1], next(blocks))


def _moved(parent: _Motion, body: Body, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> _Motion:
    """Motion of a body from its parent's."""
    R_p, p_p, w_p, dw_p, a_p = parent
    R_joint, p_joint = _joint_pose(body, q)
    R = R_p[:, 0, None] * R_joint[0] + R_p[:, 1, None] * R_joint[1] + R_p[:, 2, None] * R_joint[2]
    offset = _turned(R_p, p_joint)
    v, axes = body.motions[:3], body.motions[3:]
    turn, slide = _turned(R, axes @ dq), _turned(R, v @ dq)
    w = w_p + turn
    dw = dw_p + _turned(R, axes @ ddq) + _cross(w_p, turn)
    relative = _turned(R, v @ ddq) + _cross(2 * w_p + turn, slide)
    return _Motion(R, p_p + offset, w, dw, a_p + _second_derivative(offset, w_p, dw_p) + relative)


def _joint_pose(body: Body, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3, C) and position (3, C) of a body in its parent's frame; as `body.joint_pose`, samples-last."""
    R_home, p_home = body.home[:3, :3], body.home[:3, 3]
    if body.is_ball:
        T = np.moveaxis(body.home @ body.joint_pose(q.T), 0, -1)
        return T[:3, :3], T[:3, 3]
    v, K = body.twist[:3], hat(body.twist[3:])
    q = q[0] if body.moves else np.zeros(q.shape[1])
    sin, versine = np.sin(q), 1 - np.cos(q)
    R = _outer(R_home, 1) + _outer(R_home @ K, sin) + _outer(R_home @ K @ K, versine)
    p = _outer(p_home, 1) + _outer(R_home @ v, q) + _outer(R_home @ K @ v, versine)
    return R, p + _outer(R_home @ K @ K @ v, q - sin)


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
    """Rotations (3, 3, C) times vectors (3, C)."""
    return R[:, 0] * x[0] + R[:, 1] * x[1] + R[:, 2] * x[2]
