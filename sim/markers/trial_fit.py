"""Robust fit of the postures of a trial, with the markers' noise and outlying markers.

All frames are fitted by least squares first, each from the one before. The noise is estimated from the median of the
residuals, which outliers hardly change. Frames with residuals far beyond it are fitted again with weights

    min(1, (K σ / |r|)²)        after        min(1, K σ / |r|)

so that the influence of a marker decreases with its distance, and that of a mislabelled one vanishes.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import special

from ident.errors import InputError
from sim.markers.frame_fit import Kinematics, Posture, first_posture, fitted, normal_equations
from sim.markers.marked_model import MarkedModel

FAR = 4.0
"""K: distance from the fit, in standard deviations of a coordinate, beyond which markers lose weight; one in 900 good
markers does."""

OUTLYING = 0.25
"""Weight below which a marker counts as outlying; its distance is then twice `FAR`."""

REWEIGHTED, ROUNDS_BETWEEN, SETTLED_WEIGHTS = 15, 2, 5e-3
"""Largest number of reweightings of a frame, steps in between, and change of weights at which they have converged."""

SCALES = 2
"""Number of alternations between estimating the noise and the weights."""

EXACT = 1e-9
"""Least noise of positions from rounding, m."""

POOR = 0.1
"""Noise above which model and markers do not match, m."""

LEAST_INFORMATION = 1e-8
"""Information added to the curvature, m²/rad², so that undetermined coordinates have a large, finite variance."""

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
    for _ in range(SCALES):
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
        InputError: The markers' noise is above `POOR`.
    """
    if postures.sigma > POOR:
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
    """Standard deviation of a coordinate from the median of the squared distances, m."""
    squared = weights * np.array([(p.residual**2).sum(axis=1) for p in postures])
    free = max(1 - n / (3 * max((weights > 0).sum(axis=1).mean(), 1.0)), 0.1)
    used = squared[weights > 0]
    return max(float(np.sqrt(np.median(used) / (special.chdtri(3, 0.5) * free))) if used.size else 0.0, EXACT)


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

    It starts with the given posture and factors; if these are all 1, first with weights that decrease more slowly.
    """
    posture = fitted(kinematics, posture.qpos, measured, weights * factor, ROUNDS_BETWEEN)
    for power in (1, 2) if (factor == (weights > 0)).all() else (2,):
        for _ in range(REWEIGHTED):
            before, far = factor, _far(posture, weights, sigma)
            factor = (weights > 0) * np.maximum(far, 1.0) ** -power
            posture = fitted(kinematics, posture.qpos, measured, weights * factor, ROUNDS_BETWEEN)
            if np.abs(factor - before).max() < SETTLED_WEIGHTS:
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
        spread[k] = np.linalg.inv(normal + LEAST_INFORMATION * np.eye(n))
        # Outlying markers do not count for the noise.
        kept = robust[k] >= OUTLYING
        total += float((w[kept, None] * posture.residual[kept] ** 2).sum())
        free += 3 * float(kept.sum()) - (n - LEAST_INFORMATION * float(np.trace(spread[k])))
    sigma = float(np.sqrt(total / free)) if free > 0.5 else np.nan
    residuals = np.array([posture.residual for posture in postures])
    return Postures(marked, np.array([p.qpos for p in postures]), residuals, robust, sigma, spread)
