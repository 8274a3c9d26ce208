"""Rigid motions as 4×4 matrices, rotations as quaternions, twists and wrenches as 6-vectors (Section III.B).

Every function takes any number of leading dimensions. Twists are `[v; ω]`, wrenches `[F; τ]`.
"""

import warnings

import numpy as np
from scipy.spatial.transform import Rotation


def hat(x: np.ndarray) -> np.ndarray:
    """Matrix form of a vector or a twist (Section III.B.1).

    For a 3-vector, `hat(x) @ y == cross(x, y)`. For a twist, `hat(x)` is the velocity matrix `Ṫ T⁻¹` of the spatial
    twist x, and `T⁻¹ Ṫ` of the body twist x.

    Args:
        x: Vectors (…, 3) or twists (…, 6).

    Returns:
        Matrices (…, 3, 3) or (…, 4, 4).
    """
    x = np.asarray(x)
    if x.shape[-1] == 6:
        out = np.zeros((*x.shape[:-1], 4, 4), x.dtype)
        out[..., :3, :3] = hat(x[..., 3:])
        out[..., :3, 3] = x[..., :3]
        return out
    out = np.zeros((*x.shape[:-1], 3, 3), x.dtype)
    out[..., 2, 1], out[..., 1, 2] = x[..., 0], -x[..., 0]
    out[..., 0, 2], out[..., 2, 0] = x[..., 1], -x[..., 1]
    out[..., 1, 0], out[..., 0, 1] = x[..., 2], -x[..., 2]
    return out


def applied(matrix: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Matrices (…, m, n) times vectors (…, n)."""
    return (matrix @ x[..., None])[..., 0]


def exp(xi: np.ndarray, theta: np.ndarray | float = 1.0) -> np.ndarray:
    """Pose reached by moving along a joint twist: `expm(hat(xi) * theta)`.

    Rodrigues' formula for a twist whose ω is of unit length (a screw) or zero (a translation). As the angle is a
    separate argument, no small-angle branch is needed.

    Args:
        xi: Twist `[v; ω]`, |ω| = 1 or ω = 0 (…, 6).
        theta: Joint coordinate in rad, or m for a translation, broadcast against the twist (…).

    Returns:
        Poses (…, 4, 4).
    """
    xi, theta = np.asarray(xi), np.asarray(theta)[..., None, None]
    w = hat(xi[..., 3:])
    ww = w @ w
    one = np.eye(3, dtype=int)
    sin, versine = np.sin(theta), 1 - np.cos(theta)
    rotation, v = one + sin * w + versine * ww, xi[..., :3, None]
    return pose(rotation, (theta * v + versine * (w @ v) + (theta - sin) * (ww @ v))[..., 0])


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices of quaternions `w, x, y, z` of any nonzero length, (…, 4) -> (…, 3, 3)."""
    quaternion = np.asarray(quaternion)
    real, u = quaternion[..., :1, None], hat(quaternion[..., 1:])
    square = np.sum(quaternion * quaternion, axis=-1, keepdims=True)[..., None]
    return np.eye(3, dtype=int) + 2 * (real * u + u @ u) / square


def pose(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Poses (…, 4, 4) of rotation matrices (…, 3, 3) and positions (…, 3)."""
    out = np.zeros((*rotation.shape[:-2], 4, 4), np.result_type(rotation, translation))
    out[..., :3, :3] = rotation
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1
    return out


def inverse(T: np.ndarray) -> np.ndarray:
    """Inverse pose: `inverse(T) @ T == 1`, without solving.

    Args:
        T: Poses (…, 4, 4).

    Returns:
        Poses (…, 4, 4).
    """
    transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    return pose(transposed, -(transposed @ T[..., :3, 3:])[..., 0])


def Ad(T: np.ndarray) -> np.ndarray:
    """Adjoint of a pose: `hat(Ad(T) @ V) == T @ hat(V) @ inverse(T)`.

    `Ad(T_ab)` transforms a twist from frame b to frame a (Eq. 6).

    Args:
        T: Poses (…, 4, 4).

    Returns:
        Matrices `[[R, p̂R], [0, R]]` (…, 6, 6).
    """
    R = T[..., :3, :3]
    out = np.zeros((*T.shape[:-2], 6, 6), T.dtype)
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., :3, 3:] = hat(T[..., :3, 3]) @ R
    return out


def ad(V: np.ndarray) -> np.ndarray:
    """Lie bracket with a twist: `hat(ad(V) @ W) == hat(V) @ hat(W) - hat(W) @ hat(V)`.

    A constant twist, written as W in a frame that moves with V, changes at the rate `-ad(V) @ W`: the derivative of
    Eq. 6.

    Args:
        V: Twists (…, 6).

    Returns:
        Matrices `[[ω̂, v̂], [0, ω̂]]` (…, 6, 6).
    """
    V = np.asarray(V)
    out = np.zeros((*V.shape[:-1], 6, 6), V.dtype)
    out[..., :3, :3] = out[..., 3:, 3:] = hat(V[..., 3:])
    out[..., :3, 3:] = hat(V[..., :3])
    return out


def coAd(T: np.ndarray) -> np.ndarray:
    """Coadjoint of a pose: `(coAd(T) @ F) · (Ad(T) @ V) == F · V`, power is the same in both frames.

    `coAd(T_ab) = Ad(T_ab⁻¹)ᵀ` transforms a wrench from frame b to frame a, as in Eqs. 15-18.

    Args:
        T: Poses (…, 4, 4).

    Returns:
        Matrices `[[R, 0], [p̂R, R]]` (…, 6, 6).
    """
    return np.swapaxes(Ad(inverse(T)), -1, -2)


def roll_pitch_yaw(R: np.ndarray) -> tuple[float, ...]:
    """Roll, pitch and yaw of a rotation (3, 3), degrees, as in URDF; without yaw at a pitch of 90°."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tuple(Rotation.from_matrix(R).as_euler("xyz", degrees=True).tolist())


def small_rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix of a small rotation vector, exact up to third order (3, 3); the identity for zero."""
    return rotation(np.concatenate([[1.0], vector / 2]))


def continuous_quaternions(rotations: np.ndarray) -> np.ndarray:
    """Quaternions `w, x, y, z` of rotations (N, 3, 3), with signs that do not jump between samples (N, 4)."""
    return without_jumps(Rotation.from_matrix(rotations).as_quat(scalar_first=True))


def without_jumps(quaternion: np.ndarray) -> np.ndarray:
    """Quaternions with signs chosen so that they do not jump between samples; those with NaN are unchanged (N, 4)."""
    out = np.array(quaternion, float)
    there = np.isfinite(out).all(axis=1)
    some = out[there]
    turned = (some[1:] * some[:-1]).sum(axis=1) < 0
    out[there] = some * np.where(np.cumsum([False, *turned]) % 2, -1.0, 1.0)[: len(some), None]
    return out


def turning(quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration in the body's frame from a quaternion of any length and its derivatives.

    With s = |s| q, `ω = 2 vec(s* ṡ) / |s|²`, and `α = 2 vec(s* s̈) / |s|² - 2 ω (s · ṡ) / |s|²`.

    Args:
        quaternion: s, ṡ, s̈, each `w, x, y, z` (3, …, 4).

    Returns:
        ω and α (…, 3).
    """
    s, ds, dds = quaternion
    size = np.sum(s * s, axis=-1, keepdims=True)

    def twice_vector(x: np.ndarray) -> np.ndarray:
        return (x[..., 1:] * s[..., :1] - s[..., 1:] * x[..., :1] - np.cross(s[..., 1:], x[..., 1:])) * 2 / size

    velocity = twice_vector(ds)
    return velocity, twice_vector(dds) - velocity * (2 * np.sum(s * ds, axis=-1, keepdims=True) / size)
