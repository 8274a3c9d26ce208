"""First posture of a trial, without an initial guess: the best of fits from starts over the joints' ranges."""

import mujoco
import numpy as np

from sim.markers.frame_fit import Posture, fitted
from sim.markers.kinematics import Kinematics
from sim.markers.marked_model import MarkedModel

STARTS = 8
"""Number of starts: the reference configuration, and random ones."""

WIDTH = 0.5
"""Width of the random starts: share of a joint's range, or angle in rad if it has none."""


def first_posture(marked: MarkedModel, measured: np.ndarray, weights: np.ndarray) -> Posture:
    """Best fit of a frame; arguments as for `frame_fit.fitted`."""
    rng, kinematics = np.random.default_rng(0), Kinematics(marked)
    starts = [marked.rest, *(_at_random(marked, rng) for _ in range(STARTS - 1))]
    aligned = (_aligned(marked, kinematics, start, measured, weights) for start in starts)
    best = min((fitted(kinematics, start, measured, weights) for start in aligned), key=lambda p: p.cost)
    return best._replace(qpos=_unwound(marked, best.qpos))


def _unwound(marked: MarkedModel, qpos: np.ndarray) -> np.ndarray:
    """Coordinates with limited hinges moved by whole turns to within half a turn of the middle of their range."""
    model, out = marked.model, qpos.copy()
    leading = {following.leader[0] for following in marked.followers}
    for j in {int(model.dof_jntid[d]) for d in marked.dofs}:
        first = int(model.jnt_qposadr[j])
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE and model.jnt_limited[j] and first not in leading:
            out[first] -= 2 * np.pi * np.round((out[first] - model.jnt_range[j].mean()) / (2 * np.pi))
    return out


def _at_random(marked: MarkedModel, rng: np.random.Generator) -> np.ndarray:
    """Random coordinates, with hinges, slides and balls around the middle of their ranges (nq,)."""
    model, qpos = marked.model, marked.rest.copy()
    for j in sorted({int(model.dof_jntid[d]) for d in marked.dofs}):
        first, size = int(model.jnt_qposadr[j]), marked.dofs_of(j)
        if size == 1:
            low, high = model.jnt_range[j] if model.jnt_limited[j] else qpos[first] + np.array([-1.0, 1.0])
            qpos[first] = (low + high) / 2 + WIDTH * (high - low) * rng.uniform(-0.5, 0.5)
        elif size == 3:
            mujoco.mju_quatIntegrate(qpos[first : first + 4], rng.normal(scale=WIDTH, size=3), 1.0)
    return qpos


def _aligned(
    marked: MarkedModel, kinematics: Kinematics, qpos: np.ndarray, measured: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Coordinates with every free body placed so that the markers on it and its descendants fit best (nq,)."""
    model, out, positions = marked.model, qpos.copy(), kinematics.positions(qpos)
    roots = model.body_rootid[model.site_bodyid[marked.sites]]
    for j in {int(model.dof_jntid[d]) for d in marked.dofs}:
        own = (roots == model.jnt_bodyid[j]) & (weights > 0)
        if marked.dofs_of(j) == 6 and own.any():
            first = int(model.jnt_qposadr[j])
            R, t = superposed(positions[own], measured[own])
            turn = np.zeros(4)
            mujoco.mju_mat2Quat(turn, R.ravel())
            out[first : first + 3] = R @ qpos[first : first + 3] + t
            mujoco.mju_mulQuat(out[first + 3 : first + 7], turn, qpos[first + 3 : first + 7])
    return out


def superposed(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation that bring points a (M, 3) closest to points b, by least squares.

    Source: Kabsch, Acta Cryst. A32:922, 1976, doi:10.1107/S0567739476001873.
    """
    middle = a.mean(axis=0), b.mean(axis=0)
    U, _, Vt = np.linalg.svd((b - middle[1]).T @ (a - middle[0]))
    R = U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return R, middle[1] - R @ middle[0]
