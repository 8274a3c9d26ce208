"""Noise that is correlated over time, and what it does to a fit."""

from collections.abc import Iterable

import numpy as np
from scipy import linalg

STRETCH = 1.2
"""By how much the noise's correlation time is taken to exceed that of the residuals."""

CHANCE = 2.0
"""Autocorrelation, in standard deviations of that of white noise, up to which a residual passes for white."""

LEAST_LEFT = 0.3
"""Smallest share of the noise's variance that a fit is taken to leave in the residuals."""


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


def sandwiched(
    chunks: Iterable[np.ndarray], pull: np.ndarray, taken: float, before: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The middle of the sandwich, `Σ_nm Y_nᵀ Γ(n - m) Y_m`, with the noise's covariance Γ as `innovations` finds it.

    Args:
        chunks: Columns of the samples, some at a time, columns first (m, C, n); measurements may follow them.
        pull: What each residual adds to the normal equations, for least squares the residual itself (C, N).
        taken: Parameters that a channel's samples determine on average.
        before: What the samples before these left, as it was returned (C, m).

    Returns:
        The middle (m, m), and what these samples leave to those after them (C, m).
    """
    decay, size = innovations(pull, taken)
    middle: np.ndarray | float = 0.0
    first = 0
    for rows in chunks:
        left = np.zeros((len(pull), len(rows))) if before is None else before
        z = [remembered(rows[:, c], rho, y) for c, (rho, y) in enumerate(zip(decay, left, strict=True))]
        before = np.array([each[:, -1] for each in z])
        # Each sample pulls at the parameters by its residual.
        last = first + rows.shape[2]
        pulls = sum(each * u[first:last] for each, u in zip(z, size, strict=True))
        middle, first = middle + pulls @ pulls.T, last
    return np.asarray(middle), np.asarray(before)
