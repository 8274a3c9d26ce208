"""The ten inertial parameters φ of a rigid body: order, names, and conversions to other parameters."""

import re
from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np

from ident.errors import InputError
from ident.geometry.se3 import hat

PARAMETERS = ("m", "mrx", "mry", "mrz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Order of φ (Section II), the one place where it is defined. First moments `mrx = m·r_x` in kg m; inertia in kg m²
about the *body-frame origin*, in body axes, with `Ixy = -∫xy dm`."""


PINOCCHIO = (0, 1, 2, 3, 4, 7, 5, 8, 9, 6)
"""Indices in `PARAMETERS` of Pinocchio's parameters `m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz` of a body."""


def parameter_names(bodies: int) -> tuple[str, ...]:
    """Names of the stacked φ of several bodies as in the paper's tables: `m1, m1rx1, …, Iyz1, m2, …`.

    Args:
        bodies: Number of bodies b.

    Returns:
        10 b names; bodies are counted from 1.
    """
    return tuple(
        f"m{i}{name[1:]}{i}" if name.startswith("mr") else f"{name}{i}"
        for i in range(1, bodies + 1)
        for name in PARAMETERS
    )


def body_index(name: str) -> int | None:
    """Index of the body that one of `parameter_names` belongs to, None for any other name.

    >>> body_index("m2rz2")
    1
    """
    match = re.fullmatch(r"(?:m|m(\d+)r[xyz](?=\1$)|I[xyz]{2})([1-9]\d*)", name)
    return None if match is None else int(match[2]) - 1


def body_of_parameter(name: str, bodies: Sequence[str]) -> str | None:
    """Name of the body that one of `parameter_names` belongs to, None for any other name.

    >>> body_of_parameter("m2rz2", ("base", "shank"))
    'shank'
    """
    k = body_index(name)
    return bodies[k] if k is not None and k < len(bodies) else None


def with_bodies(names: Iterable[str], bodies: Sequence[str]) -> str:
    """Comma-separated names of parameters, with the name of the body after consecutive ones of that body.

    >>> with_bodies(["m1", "m2rz2", "Ixx2"], ("base", "shank"))
    'm1 of base, m2rz2, Ixx2 of shank'
    """
    grouped = groupby(names, lambda name: body_of_parameter(name, bodies))
    return ", ".join(", ".join(own) + (f" of {body}" if body else "") for body, own in grouped)


def symmetric(entries: np.ndarray) -> np.ndarray:
    """Symmetric matrices (…, 3, 3) from the entries `xx, yy, zz, xy, xz, yz` (…, 6)."""
    xx, yy, zz, xy, xz, yz = np.moveaxis(np.asarray(entries), -1, 0)
    rows = [np.stack(row, -1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))]
    return np.stack(rows, -2)


def entries(matrix: np.ndarray) -> np.ndarray:
    """Entries `xx, yy, zz, xy, xz, yz` of symmetric matrices: the inverse of `symmetric`, (…, 3, 3) -> (…, 6)."""
    return matrix[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def parameters_from_com(mass: float, com: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """φ from mass, centre of mass and inertia about the centre of mass (Eq. 10: `I' = I_c - m r̂²`).

    >>> parameters_from_com(2.0, [0, 0, 0.5], np.diag([0.1, 0.1, 0.01]))[:5]
    array([2. , 0. , 0. , 1. , 0.6])

    Args:
        mass: Mass in kg.
        com: Centre of mass r in the body frame, m (3,).
        inertia: Inertia I_c about the centre of mass, in body axes, kg m² (3, 3).

    Returns:
        φ in the order of `PARAMETERS` (10,).
    """
    r = hat(np.asarray(com, float))
    at_origin = np.asarray(inertia, float) - mass * r @ r
    return np.concatenate([[mass], mass * np.asarray(com, float), entries(at_origin)])


def com_from_parameters(phi: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it: the inverse of `parameters_from_com`.

    Args:
        phi: φ of one body (10,).

    Returns:
        Mass in kg, centre of mass in m (3,), inertia about the centre of mass in kg m² (3, 3).

    Raises:
        InputError: The mass is zero, so that no centre of mass exists.
    """
    phi = np.asarray(phi, float)
    if phi[0] == 0:
        raise InputError("A body of zero mass has no centre of mass.")
    com = phi[1:4] / phi[0]
    return float(phi[0]), com, symmetric(phi[4:]) + phi[0] * hat(com) @ hat(com)


def with_centers(phi: np.ndarray) -> np.ndarray:
    """Stacked φ with centres of mass in place of first moments, zero for massless bodies (10 b,) -> (b, 10)."""
    out = np.array(phi, float).reshape(-1, 10)
    out[:, 1:4] /= np.where(out[:, :1] == 0, np.inf, out[:, :1])
    return out


def pseudo_inertia(phi: np.ndarray) -> np.ndarray:
    """Pseudo-inertia `J = ∫ [x; 1] [x; 1]ᵀ dm = [[Σ, mr], [mrᵀ, m]]` with `Σ = tr(I)/2 - I`.

    A body is physical exactly when J is positive definite (Wensing, Kim and Slotine, RA-L 2018).

    Args:
        phi: φ of one or many bodies (…, 10).

    Returns:
        Symmetric matrices (…, 4, 4).
    """
    phi = np.asarray(phi, float)
    inertia = symmetric(phi[..., 4:])
    trace = np.trace(inertia, axis1=-2, axis2=-1)[..., None, None]
    J = np.empty((*phi.shape[:-1], 4, 4))
    J[..., :3, :3] = trace / 2 * np.eye(3) - inertia
    J[..., :3, 3] = J[..., 3, :3] = phi[..., 1:4]
    J[..., 3, 3] = phi[..., 0]
    return J


def parameters_from_pseudo_inertia(J: np.ndarray) -> np.ndarray:
    """φ of a pseudo-inertia: the inverse of `pseudo_inertia`, (…, 4, 4) -> (…, 10)."""
    J = np.asarray(J)
    second = J[..., :3, :3]
    inertia = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3, dtype=int) - second
    return np.concatenate([J[..., 3:, 3], J[..., :3, 3], entries(inertia)], axis=-1)


def parameter_transform(T_ab: np.ndarray) -> np.ndarray:
    """Matrix X with `φ_a = X φ_b`, which transforms φ of a body from frame b to frame a (10, 10).

    The pseudo-inertia transforms as `J_a = T_ab J_b T_abᵀ`.
    """
    return parameters_from_pseudo_inertia(T_ab @ pseudo_inertia(np.eye(10)) @ np.swapaxes(T_ab, -1, -2)).T
