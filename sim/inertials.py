"""Inertias of bodies as MuJoCo has them: principal moments about the centre of mass, in axes of their own."""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np


class Inertial(NamedTuple):
    """Inertia of one body as MuJoCo has it.

    Attributes:
        mass: Mass in kg.
        pos: Centre of mass in the body's frame, m (3,).
        quat: Quaternion `w, x, y, z` of the principal axes (4,).
        moments: Principal moments about the centre of mass, kg m² (3,).
    """

    mass: float
    pos: np.ndarray
    quat: np.ndarray
    moments: np.ndarray


def inertial_of(mass: float, com: np.ndarray, inertia: np.ndarray) -> Inertial:
    """From the inertia about the centre of mass in body axes (3, 3)."""
    moments, axes = np.linalg.eigh(inertia)
    second = moments.sum() / 2 - moments
    if second.min() > -1e-9 * abs(second).max():
        # MuJoCo asks for A + B >= C, which rounding may break.
        moments = np.maximum(second, 0).sum() - np.maximum(second, 0)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    return Inertial(float(mass), com, quat, moments)


def bodies_in_order(root: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """A body and all on it, in the order of the compiled model; `MjSpec.bodies` has another in MuJoCo 3.3."""
    yield root
    for child in root.bodies:
        yield from bodies_in_order(child)


def set_inertials(spec: mujoco.MjSpec, inertials: dict[int, Inertial]) -> None:
    """States the inertias of bodies, given by their ids, explicitly."""
    bodies = list(bodies_in_order(spec.worldbody))
    for b, inertial in inertials.items():
        body = bodies[b]
        body.explicitinertial = True
        body.mass, body.ipos, body.iquat, body.inertia = inertial
        body.fullinertia = [np.nan, 0, 0, 0, 0, 0]
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
