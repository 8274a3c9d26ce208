"""Fit of a posture to the markers of one frame: kinematics by MuJoCo, steps of Gauss and Newton, first postures."""

from typing import NamedTuple

import mujoco
import numpy as np
from scipy.linalg import lapack

from sim.markers.marked_model import MarkedModel

ROUNDS = 100
"""Largest number of steps; most are needed if a posture is far from the initial guess."""

SETTLED = 1e-7
"""Step in rad or m at which the fit has converged; the next step would be far smaller."""

GAIN = 1e-10
"""Relative decrease of the cost below which the fit has converged: the remaining error is a hundred-thousandth of a
standard deviation."""

LEAST, MOST = 1e-9, 1e6
"""Range of the damping, m²/rad²: the least keeps normal equations solvable, beyond the most no step lowers the cost."""

STARTS = 8
"""Number of starts: the reference configuration, and random ones. Of 25 postures of the humanoid over the whole ranges
of its joints one start missed 13, two missed 3, and eight none."""

WIDTH = 0.5
"""Width of the random starts: share of a joint's range, or angle in rad if it has none."""


class Kinematics:
    """Positions and Jacobians of the markers of a model, one posture at a time, in preallocated memory."""

    def __init__(self, marked: MarkedModel) -> None:
        self._model, self._data = marked.model, mujoco.MjData(marked.model)
        self._sites, self._dofs, self._followers = marked.sites, marked.dofs, marked.followers
        self._all = np.zeros((len(marked.sites), 3, marked.model.nv))
        self._step = np.zeros(marked.model.nv)

    def positions(self, qpos: np.ndarray) -> np.ndarray:
        """Positions of the markers in the world, m (M, 3)."""
        self._data.qpos = self._followed(qpos)
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.site_xpos[self._sites]

    def jacobian(self) -> np.ndarray:
        """Derivatives of the positions of the last call by the degrees of freedom that move (M, 3, n)."""
        mujoco.mj_comPos(self._model, self._data)
        for k, site in enumerate(self._sites):
            mujoco.mj_jacSite(self._model, self._data, self._all[k], None, site)
        for following in self._followers:
            slope = following.law.slope(self._data.qpos[following.leader[0]])
            self._all[:, :, following.leader[1]] += slope * self._all[:, :, following.own[1]]
        return self._all[:, :, self._dofs]

    def moved(self, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Coordinates after a step of the degrees of freedom that move (nq,)."""
        out = np.array(qpos)
        self._step[self._dofs] = step
        mujoco.mj_integratePos(self._model, out, self._step, 1.0)
        return self._followed(out)

    def _followed(self, qpos: np.ndarray) -> np.ndarray:
        """Coordinates with followers set from their leaders (nq,)."""
        if not self._followers:
            return qpos
        out = np.array(qpos)
        for following in self._followers:
            out[following.own[0]] = following.law.value(out[following.leader[0]])
        return out


class Posture(NamedTuple):
    """A fitted posture.

    Attributes:
        qpos: Coordinates (nq,).
        residual: Measured less fitted positions, NaN where a marker is missing (M, 3).
        cost: Weighted sum of squares, m².
    """

    qpos: np.ndarray
    residual: np.ndarray
    cost: float


def fitted(
    kinematics: Kinematics, qpos: np.ndarray, measured: np.ndarray, weights: np.ndarray, rounds: int = ROUNDS
) -> Posture:
    """Posture that fits best, from an initial guess.

    Args:
        kinematics: Kinematics of the model.
        qpos: Initial guess (nq,).
        measured: Positions, NaN where a marker is missing, m (M, 3).
        weights: Weights of squared distances, zero for missing markers (M,).
        rounds: Largest number of steps.
    """
    visible, damping = np.flatnonzero(weights > 0), LEAST
    w, x = weights[visible, None], measured[visible]
    now = Posture(qpos, measured - kinematics.positions(qpos), 0.0)
    now = now._replace(cost=_cost(w, now.residual[visible]))
    for _ in range(rounds):
        J = kinematics.jacobian()[visible]
        normal, gradient = normal_equations(J, w, now.residual[visible])
        while True:
            step = _step(normal, gradient, damping)
            size = float(np.abs(step).max(initial=0.0))
            trial = kinematics.moved(now.qpos, step)
            residual = x - kinematics.positions(trial)[visible]
            cost = _cost(w, residual)
            if cost <= now.cost or size < SETTLED or damping > MOST:
                break
            damping *= 10
        damping = max(damping / 10, LEAST)
        gain = now.cost - cost
        if gain >= 0:
            now = Posture(trial, measured - kinematics.positions(trial), cost)
        if size < SETTLED or damping > MOST / 10 or 0 <= gain <= GAIN * cost:
            break
    return now


def normal_equations(J: np.ndarray, w: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`JᵀWJ` (n, n) and `JᵀWr` (n,) of markers (M, 3, n), their weights (M, 1) and residuals (M, 3)."""
    rows = J.reshape(-1, J.shape[-1])
    weighted = (np.repeat(w, 3)[:, None] * rows).T
    return weighted @ rows, weighted @ residual.ravel()


def _step(normal: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    damped = normal.copy()
    damped.flat[:: len(normal) + 1] += damping
    _, step, fault = lapack.dposv(damped, gradient)
    return np.linalg.lstsq(damped, gradient, rcond=None)[0] if fault else np.asarray(step)


def _cost(w: np.ndarray, residual: np.ndarray) -> float:
    return float((w * residual**2).sum())


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
