"""Robust fit of the postures of a trial to its markers, with the markers' noise and outlying markers.

All frames are fitted by least squares first, each from the one before. The noise is estimated from the median of the
residuals, which outliers hardly change. Frames with residuals far beyond it are fitted again with weights

    min(1, (K σ / |r|)²)        after        min(1, K σ / |r|)

so that the influence of a marker decreases with its distance, and that of a mislabelled one vanishes.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np
from scipy import special
from scipy.linalg import lapack

from ident.errors import InputError
from sim.markers.marked_model import MarkedModel

SETTLED = 1e-7
"""Step in rad or m at which the fit has converged; the next step would be far smaller."""

LEAST = 1e-8
"""Least damping, m²/rad², which keeps normal equations solvable, and gives undetermined coordinates a large, finite
variance."""


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
    kinematics: Kinematics, qpos: np.ndarray, measured: np.ndarray, weights: np.ndarray, rounds: int = 100
) -> Posture:
    """Posture that fits best, from an initial guess.

    Args:
        kinematics: Kinematics of the model.
        qpos: Initial guess (nq,).
        measured: Positions, NaN where a marker is missing, m (M, 3).
        weights: Weights of squared distances, zero for missing markers (M,).
        rounds: Largest number of steps; most are needed if a posture is far from the initial guess.
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
            if cost <= now.cost or size < SETTLED:
                break
            damping *= 10
        damping = max(damping / 10, LEAST)
        gain = now.cost - cost
        if gain >= 0:
            now = Posture(trial, measured - kinematics.positions(trial), cost)
        # With such a gain the remaining error is a hundred-thousandth of a standard deviation.
        if size < SETTLED or 0 <= gain <= 1e-10 * cost:
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
    """Best fit of a frame, from the reference configuration and seven random ones; arguments as for `fitted`.

    Of 25 postures of the humanoid over the whole ranges of its joints one start missed 13, two missed 3, eight none.
    """
    rng, kinematics = np.random.default_rng(0), Kinematics(marked)
    begins = [marked.rest, *(_at_random(marked, rng) for _ in range(7))]
    aligned = (_aligned(marked, kinematics, begin, measured, weights) for begin in begins)
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
    """Random coordinates, with hinges and slides in half their ranges, and balls turned by some 0.5 rad (nq,)."""
    model, qpos = marked.model, marked.rest.copy()
    for j in sorted({int(model.dof_jntid[d]) for d in marked.dofs}):
        first, size = int(model.jnt_qposadr[j]), marked.dofs_of(j)
        if size == 1:
            low, high = model.jnt_range[j] if model.jnt_limited[j] else qpos[first] + np.array([-1.0, 1.0])
            qpos[first] = (low + high) / 2 + 0.5 * (high - low) * rng.uniform(-0.5, 0.5)
        elif size == 3:
            mujoco.mju_quatIntegrate(qpos[first : first + 4], rng.normal(scale=0.5, size=3), 1.0)
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


FAR = 4.0
"""K: distance from the fit, in standard deviations of a coordinate, beyond which markers lose weight; one in 900 good
markers does."""

OUTLYING = 0.25
"""Weight below which a marker counts as outlying; its distance is then twice `FAR`."""

LOOSE = 100.0
"""Standard deviation of a coordinate, in rad or m per metre of noise, from which it counts as undetermined: six degrees
for a millimetre of noise."""


@dataclass(frozen=True, eq=False)
class Postures:
    """Fitted postures of all frames.

    Attributes:
        marked: Model and markers.
        qpos: Coordinates (N, nq).
        residuals: Measured less fitted positions, NaN where a marker is missing, m (N, M, 3).
        robust: Factor on each marker's weight, below 1 for distant markers, 0 where one is missing (N, M).
        sigma: Standard deviation of a coordinate of a marker of weight 1, m; NaN if there are too few markers.
        spread: Covariance of the degrees of freedom for sigma = 1 m (N, n, n).
    """

    marked: MarkedModel
    qpos: np.ndarray
    residuals: np.ndarray
    robust: np.ndarray
    sigma: float
    spread: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the degrees of freedom, `σ² (JᵀWJ)⁻¹` (N, n, n)."""
        return self.sigma**2 * self.spread

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the degrees of freedom, rad or m (N, n)."""
        return self.sigma * np.sqrt(np.diagonal(self.spread, axis1=1, axis2=2))

    @property
    def determined(self) -> np.ndarray:
        """Mask of the degrees of freedom that the markers determine (N, n)."""
        return np.diagonal(self.spread, axis1=1, axis2=2) < LOOSE**2

    @property
    def undetermined(self) -> list[str]:
        """Names of the degrees of freedom that the markers determine in no frame."""
        return [self.marked.dof_names[d] for d in np.flatnonzero(~self.determined.any(axis=0))]

    @property
    def distances(self) -> np.ndarray:
        """Distances of the markers from the fit, NaN where one is missing, m (N, M)."""
        return np.linalg.norm(self.residuals, axis=2)

    @property
    def outlying(self) -> np.ndarray:
        """Mask of the markers that are present, but far from the fit (N, M)."""
        return np.isfinite(self.distances) & (self.robust < OUTLYING)


def fit_trial(marked: MarkedModel, measured: np.ndarray, guess: np.ndarray | None = None) -> Postures:
    """Fits the postures of all frames robustly.

    Args:
        marked: Model and markers.
        measured: Positions in the model's world, NaN where a marker is missing, m (N, M, 3).
        guess: Initial guess of the coordinates (N, nq), if there is one.
    """
    kinematics, visible = Kinematics(marked), np.isfinite(measured).all(axis=2)
    weights = visible * marked.weights
    postures = plain_fits(marked, measured, guess)
    robust = visible.astype(float)
    # The noise follows from the weights, and they from it.
    for _ in range(2):
        sigma = _middle_noise(postures, weights, len(marked.dofs))
        for k in range(len(measured)):
            if _far(postures[k], weights[k], sigma).any():
                own = postures[k], robust[k]
                # Markers that are mislabelled in the frame before usually are in this one too.
                start = (postures[k - 1], robust[k - 1]) if k and (robust[k - 1] < visible[k - 1]).any() else own
                refitted = partial(_refitted, kinematics, measured=measured[k], weights=weights[k], sigma=sigma)
                fit = refitted(*start)
                if start is not own and _loss(fit[0], weights[k], sigma) > _loss(own[0], weights[k], sigma):
                    fit = refitted(*own)
                postures[k], robust[k] = fit
    return _with_spread(marked, kinematics, postures, weights, robust)


def check_fit(postures: Postures) -> None:
    """Refuses a poor fit.

    Raises:
        InputError: The markers' noise is above 0.1 m, so that model and markers do not match.
    """
    if postures.sigma > 0.1:
        raise InputError(
            f"The markers are {postures.sigma:.2g} m from where the model can have them: check their unit, the axis "
            "that points up, and whether model and labels are those of the trial."
        )


def plain_fits(marked: MarkedModel, measured: np.ndarray, guess: np.ndarray | None = None) -> list[Posture]:
    """Postures of all frames by least squares with all markers; arguments as for `fit_trial`."""
    kinematics, weights = Kinematics(marked), np.isfinite(measured).all(axis=2) * marked.weights
    if guess is None:
        return _followed(marked, kinematics, measured, weights)
    return [fitted(kinematics, *each) for each in zip(guess, measured, weights, strict=True)]


def _followed(marked: MarkedModel, kinematics: Kinematics, measured: np.ndarray, weights: np.ndarray) -> list[Posture]:
    """Postures by least squares, frame by frame from the one with the most markers to the end and to the beginning."""
    first = int((weights > 0).sum(axis=1).argmax())
    begin = first_posture(marked, measured[first], weights[first])
    out = {first: begin}
    for frames in (range(first + 1, len(measured)), range(first - 1, -1, -1)):
        qpos = begin.qpos
        for k in frames:
            out[k] = fitted(kinematics, qpos, measured[k], weights[k])
            qpos = out[k].qpos
    return [out[k] for k in range(len(measured))]


def _middle_noise(postures: list[Posture], weights: np.ndarray, n: int) -> float:
    """Standard deviation of a coordinate from the median of the squared distances, at least that of rounding, m."""
    squared = weights * np.array([(p.residual**2).sum(axis=1) for p in postures])
    free = max(1 - n / (3 * max((weights > 0).sum(axis=1).mean(), 1.0)), 0.1)
    used = squared[weights > 0]
    return max(float(np.sqrt(np.median(used) / (special.chdtri(3, 0.5) * free))) if used.size else 0.0, 1e-9)


def _far(posture: Posture, weights: np.ndarray, sigma: float) -> np.ndarray:
    """Distance of each marker in units of `FAR` standard deviations, 0 if that is below one (M,)."""
    squared = np.where(weights > 0, weights * (posture.residual**2).sum(axis=1), 0.0)
    far = np.sqrt(squared) / (FAR * sigma)
    return np.where(far > 1, far, 0.0)


def _loss(posture: Posture, weights: np.ndarray, sigma: float) -> float:
    """Loss function that is minimised by weights that decrease with the squared distance."""
    far = np.maximum(_far(posture, weights, sigma), 1.0)
    squared = np.where(weights > 0, weights * (posture.residual**2).sum(axis=1), 0.0)
    return float((np.where(far > 1, (FAR * sigma) ** 2 * (1 + 2 * np.log(far)), squared)).sum())


def _refitted(
    kinematics: Kinematics,
    posture: Posture,
    factor: np.ndarray,
    measured: np.ndarray,
    weights: np.ndarray,
    sigma: float,
) -> tuple[Posture, np.ndarray]:
    """Robust fit of a frame, and the factors of its weights (M,).

    It starts with the given posture and factors; if these are all 1, first with weights that decrease more slowly. Two
    steps between 15 reweightings at most settle the weights to half a hundredth.
    """
    between = 2
    posture = fitted(kinematics, posture.qpos, measured, weights * factor, between)
    for power in (1, 2) if (factor == (weights > 0)).all() else (2,):
        for _ in range(15):
            before, far = factor, _far(posture, weights, sigma)
            factor = (weights > 0) * np.maximum(far, 1.0) ** -power
            posture = fitted(kinematics, posture.qpos, measured, weights * factor, between)
            if np.abs(factor - before).max() < 5e-3:
                break
    return fitted(kinematics, posture.qpos, measured, weights * factor), factor


def _with_spread(
    marked: MarkedModel, kinematics: Kinematics, postures: list[Posture], weights: np.ndarray, robust: np.ndarray
) -> Postures:
    """Postures with their covariances, and the noise from residuals over degrees of freedom."""
    n, total, free = len(marked.dofs), 0.0, 0.0
    spread = np.empty((len(postures), n, n))
    for k, (posture, w) in enumerate(zip(postures, weights * robust, strict=True)):
        kinematics.positions(posture.qpos)
        used = w > 0
        residual = posture.residual[used]
        normal, _ = normal_equations(kinematics.jacobian()[used], w[used, None], residual)
        spread[k] = np.linalg.inv(normal + LEAST * np.eye(n))
        # Outlying markers do not count for the noise.
        kept = robust[k] >= OUTLYING
        total += float((w[kept, None] * posture.residual[kept] ** 2).sum())
        free += 3 * float(kept.sum()) - (n - LEAST * float(np.trace(spread[k])))
    sigma = float(np.sqrt(total / free)) if free > 0.5 else np.nan
    residuals = np.array([posture.residual for posture in postures])
    return Postures(marked, np.array([p.qpos for p in postures]), residuals, robust, sigma, spread)
