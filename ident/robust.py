"""Weighted, outlier-proof least squares with honest standard deviations, for recordings of the real world."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

HUBER = 1.345
"""Residuals beyond so many standard deviations lose weight; 95 % efficient where noise is normal."""

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

INDEPENDENT = 1e-6
"""Unit-norm columns that stick out less than this of the span of others depend on them."""

STRETCH = 1.2
"""By how much the noise's correlation time is taken to exceed that of the residuals."""

LEAST_LEFT = 0.3
"""Smallest share of the noise's variance that a fit is taken to leave in the residuals."""

ITERATIONS = 50
CONVERGED = 1e-6
"""Change of the fit, in standard deviations of the channels, from which the iteration stops."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Coefficients fitted to the channels of a recording.

    Attributes:
        values: Coefficients of the columns (k,).
        covariance: Their covariance, autocorrelation of the residuals included (k, k).
        scale: Standard deviation of each channel's residual, outliers left aside (C,).
        weights: Weight of every entry, one where its residual is ordinary (N, C).
        residual: Measured minus fitted (N, C).
        memory: Samples over which residuals were taken to be correlated.
    """

    values: np.ndarray
    covariance: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    residual: np.ndarray
    memory: int

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of each coefficient (k,)."""
        return np.sqrt(np.diag(self.covariance))


def robust_fit(columns: np.ndarray, measured: np.ndarray, *, weighted: bool = True) -> RobustFit:
    """Iteratively reweighted least squares of channels with noise of their own (Huber's M-estimator).

    Every channel is weighted by the inverse of its residual's standard deviation, which is estimated along with the
    coefficients, and entries with large residuals lose weight.

    Args:
        columns: Independent columns of all channels (N, C, k).
        measured: Measured channels (N, C).
        weighted: Whether to do so; otherwise ordinary least squares.

    Returns:
        The fit.

    Raises:
        ValueError: There are fewer samples than columns, values are not finite, or columns depend on one another.
    """
    if columns.ndim != 3 or measured.shape != columns.shape[:2] or len(columns) < columns.shape[2]:
        raise ValueError(
            f"A fit needs columns (N, C, k), measured channels (N, C) and N of at least k, "
            f"got {columns.shape} and {measured.shape}."
        )
    if not (np.isfinite(columns).all() and np.isfinite(measured).all()):
        raise ValueError("A fit needs finite numbers, got NaN or infinity.")
    scale, weights = _spread(measured - measured.mean(axis=0)), np.ones_like(measured)
    if not weighted:
        scale = np.ones_like(scale)
    values = np.zeros(columns.shape[2])
    for _ in range(ITERATIONS):
        before = values
        values = _solve(columns, measured, np.sqrt(weights) / scale)
        residual = measured - columns @ values
        if not weighted:
            break
        scale = _spread(residual)
        weights = np.minimum(1, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
        if np.abs(columns @ (values - before)).max(initial=0, where=weights == 1) <= CONVERGED * scale.min():
            break
    # Beyond Huber's bend the pull of a residual no longer grows: such entries do not hold the fit.
    covariance, longest = sandwich(columns, weights * residual / scale**2, (weights == 1) / scale**2)
    return RobustFit(values, covariance, _spread(residual), weights, residual, longest)


def independent(columns: np.ndarray, candidates: np.ndarray) -> list[int]:
    """Indices of the candidates that can be told from the columns and from the candidates before them.

    Args:
        columns: Columns of all channels (N, C, k).
        candidates: Further ones (N, C, m).
    """
    if not candidates.shape[-1]:
        return []
    basis, triangle, _ = linalg.qr(
        columns.reshape(-1, columns.shape[-1]) / _norms(columns), mode="economic", pivoting=True
    )
    basis = basis[:, np.abs(np.diag(triangle)) > 1e-12]
    kept = []
    for k, column in enumerate((candidates.reshape(-1, candidates.shape[-1]) / _norms(candidates)).T):
        # Twice is enough: the second pass takes away what rounding left of the first.
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > INDEPENDENT:
            kept.append(k)
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return kept


def _norms(columns: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(columns, axis=(0, 1))
    return np.where(norms > 0, norms, 1)


def _spread(residual: np.ndarray) -> np.ndarray:
    """Standard deviation of each channel by the median absolute deviation, the usual one where most entries agree."""
    spread = NORMAL_MAD * np.median(np.abs(residual), axis=0)
    usual = residual.std(axis=0)
    floor = max(1e-9 * usual.max(initial=0), 1e-12)
    return np.where(spread > 1e-3 * usual, spread, np.maximum(usual, floor))


def least_squares(rows: np.ndarray, target: np.ndarray, cond: float = 1e-12) -> tuple[np.ndarray, int]:
    """Solution of `rows x = target` and rank, by a QR with pivots: LAPACK's SVD can fail to converge on finite data."""
    solution, _, rank, _ = linalg.lstsq(rows, target, cond=cond, lapack_driver="gelsy")
    return solution, int(rank)


def _solve(columns: np.ndarray, measured: np.ndarray, factors: np.ndarray) -> np.ndarray:
    rows = (columns * factors[..., None]).reshape(-1, columns.shape[2])
    norms = np.linalg.norm(rows, axis=0)
    norms = np.where(norms > 0, norms, 1)
    solution, rank = least_squares(rows / norms, (measured * factors).ravel())
    if rank < columns.shape[2]:
        raise ValueError(f"The recording separates {rank} of {columns.shape[2]} parameters.")
    return solution / norms


def sandwich(columns: np.ndarray, pull: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, int]:
    """Covariance of coefficients when residuals are correlated over time.

    The middle of the sandwich, `Σ_nm X_nᵀ Γ(n - m) X_m`, takes each channel's residual for stationary, with an
    autocovariance that decays exponentially, as fast as that of the fit's own residuals does at first. The fit has
    taken part of the noise, and of slow noise most: variance and time are raised accordingly.

    Args:
        columns: Columns of all channels (N, C, k).
        pull: What each residual adds to the normal equations, for least squares the residual itself (N, C).
        slope: Its derivative by the residual, for least squares one (N, C).

    Returns:
        The covariance (k, k) and the longest correlation time, in samples.
    """
    samples, channels, count = columns.shape
    bread = np.einsum("nck,nc,ncl->kl", columns, slope, columns)
    middle, longest = np.zeros((count, count)), 0.0
    for c in range(channels):
        time, variance = _memory(pull[:, c])
        taken = count / channels * min(2 * time + 1, samples) / samples
        decay = variance / max(1 - taken, LEAST_LEFT) * np.exp(-np.arange(samples) / time)
        middle += columns[:, c].T @ linalg.matmul_toeplitz(decay, columns[:, c])
        longest = max(longest, time)
    inverse = linalg.pinvh(bread)
    return inverse @ middle @ inverse * samples / max(samples - count / channels, 1), round(longest)


def _memory(x: np.ndarray) -> tuple[float, float]:
    """Correlation time of a residual in samples, and its mean square."""
    # Padded to twice its length a spectrum does not wrap around.
    covariance = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * len(x))) ** 2)[: len(x)] / len(x)
    if covariance[0] == 0:
        return 1.0, 0.0
    below = np.flatnonzero(covariance < covariance[0] / np.e)
    lag = below[0] if len(below) else len(x) - 1
    return STRETCH * -lag / np.log(np.clip(covariance[lag] / covariance[0], 1e-4, 0.99)), float(covariance[0])
