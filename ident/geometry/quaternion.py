"""Rotations by small vectors, and angular rates of quaternions, for numbers and for signals of a tape."""

import numpy as np
from scipy.spatial.transform import Rotation

from ident.geometry.se3 import rotation


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
