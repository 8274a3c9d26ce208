"""Weighted, outlier-proof least squares with honest standard deviations, for recordings of the real world."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.errors import ExcitationError, InputError

HUBER = 1.345
"""Residuals beyond so many standard deviations lose weight; 95 % efficient where noise is normal."""

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

INDEPENDENT = 1e-6
"""Unit-norm columns that stick out less than this of the span of others depend on them."""

STRETCH = 1.2
"""By how much the noise's correlation time is taken to exceed that of the residuals."""

CHANCE = 2.0
"""Autocorrelation, in standard deviations of that of white noise, up to which a residual passes for white."""

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
        InputError: There are fewer samples than columns, values are not finite, or columns depend on one another.
    """
    if columns.ndim != 3 or measured.shape != columns.shape[:2] or len(columns) < columns.shape[2]:
        raise InputError(
            f"A fit needs columns (N, C, k), measured channels (N, C) and N of at least k, "
            f"got {columns.shape} and {measured.shape}."
        )
    if not (np.isfinite(columns).all() and np.isfinite(measured).all()):
        raise InputError("A fit needs finite numbers, got NaN or infinity.")
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
        raise ExcitationError(f"The recording separates {rank} of {columns.shape[2]} parameters.")
    return solution / norms


def sandwich(columns: np.ndarray, pull: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, int]:
    """Covariance of coefficients when residuals are correlated over time.

    The middle of the sandwich, `Σ_nm X_nᵀ Γ(n - m) X_m`, takes each channel's residual for a stationary process as
    `innovations` finds it.

    Args:
        columns: Columns of all channels (N, C, k).
        pull: What each residual adds to the normal equations, for least squares the residual itself (N, C).
        slope: Its derivative by the residual, for least squares one (N, C).

    Returns:
        The covariance (k, k) and the longest correlation time, in samples.
    """
    channels, count = columns.shape[1:]
    bread = np.einsum("nck,nc,ncl->kl", columns, slope, columns)
    decay, size = innovations(pull.T, count / channels)
    middle = np.zeros((count, count))
    for rows, rho, innovation in zip(columns.transpose(1, 2, 0), decay, size, strict=True):
        pulls = remembered(rows, rho, np.zeros(count))
        # After the last sample the process goes on: what is still to come adds up to a stationary one's variance.
        pulls[:, -1] /= np.sqrt(1 - rho**2)
        middle += (innovation**2).mean() * pulls @ pulls.T
    inverse = linalg.pinvh(bread)
    return inverse @ middle @ inverse, round(-1 / np.log(max(decay.max(), 1e-9)))


def innovations(residual: np.ndarray, parameters: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise that is correlated over time, as the autoregressive process `x_n = ρ x_n-1 + u_n` that residuals look like.

    Its autocovariance decays exponentially. The fit has taken part of the noise, and of slow noise most: variance and
    time are raised accordingly.

    Args:
        residual: Residuals of each channel (C, N).
        parameters: Parameters that a channel's samples determine on average.

    Returns:
        ρ of each channel (C,), and the size of u that its residual tells of at each sample (C, N).
    """
    decay = np.array([_decay(x) for x in residual])
    taken = parameters * (1 + decay) / (1 - decay) / residual.shape[1]
    return decay, np.sqrt((1 - decay**2) / np.maximum(1 - taken, LEAST_LEFT))[:, None] * residual


def _decay(x: np.ndarray) -> float:
    """The ρ whose autocorrelation sums up to that of a residual, its time stretched."""
    # Padded to twice its length a spectrum does not wrap around.
    covariance = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * len(x))) ** 2)[: len(x) + 1]
    if covariance[0] == 0:
        return 0.0
    correlation = covariance / covariance[0]
    lag = int(np.argmax(correlation < 1 / np.e))
    # Later lags are mostly chance; an exponential goes on from here.
    here = correlation[lag] if correlation[lag] > CHANCE / np.sqrt(len(x)) else 0.0
    total = correlation[1:lag].sum() + here / (1 - here ** (1 / lag))
    return float((total / (1 + total)) ** (1 / STRETCH))


def remembered(rows: np.ndarray, decay: float, before: np.ndarray) -> np.ndarray:
    """What innovations pull at: `z_n = y_n + ρ z_n-1`, so that `Σ z_n u_n` has the covariance of `Σ y_n x_n`.

    In reversed time x has the same autocovariance, therefore z needs no samples to come.

    Args:
        rows: Columns y of one channel (k, N).
        decay: ρ of its noise.
        before: z at the sample before the first, zero where nothing was (k,).

    Returns:
        z (k, N).
    """
    y, band = rows.T.copy(), np.ones((2, rows.shape[1]))
    y[0] += decay * before
    band[1] = -decay
    return np.asarray(linalg.lapack.dtbtrs(band, y, uplo="L")[0].T)
