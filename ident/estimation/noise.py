"""Noise that is correlated over time, and its effect on the covariance of a fit."""

from collections.abc import Callable, Iterable

import numpy as np
from scipy.linalg import lapack

STRETCH = 1.2
"""Assumed ratio of the noise's correlation time to that of the residuals."""

CHANCE = 2.0
"""Autocorrelation, in standard deviations of that of white noise, up to which a residual is taken as white."""

LEAST_LEFT = 0.3
"""Least share of the noise's variance that is assumed to remain in the residuals."""


def innovations(residual: np.ndarray, parameters: float) -> tuple[np.ndarray, np.ndarray]:
    """Autoregressive model `x_n = ρ x_n-1 + u_n` of each channel's noise, fitted to its residuals.

    Its autocovariance decays exponentially. The fit absorbs part of the noise, and more of slow noise: variance and
    correlation time are increased accordingly.

    Args:
        residual: Residuals of each channel (C, N).
        parameters: Mean number of parameters determined by a channel's samples.

    Returns:
        ρ of each channel (C,), and the residuals scaled to the size of u (C, N).
    """
    decay = np.array([_decay(x) for x in residual])
    taken = parameters * (1 + decay) / (1 - decay) / residual.shape[1]
    return decay, np.sqrt((1 - decay**2) / np.maximum(1 - taken, LEAST_LEFT))[:, None] * residual


def _decay(x: np.ndarray) -> float:
    """ρ with the same sum of autocorrelations as a residual, its correlation time stretched by `STRETCH`."""
    if not x.any():
        return 0.0
    # Later lags are mostly chance: they are replaced by an exponential.
    covariance = autocovariance(x)
    correlation = covariance / covariance[0]
    lag = int(np.argmax(correlation < 1 / np.e))
    here = correlation[lag] if correlation[lag] > CHANCE / np.sqrt(len(x)) else 0.0
    total = correlation[1:lag].sum() + here / (1 - here ** (1 / lag))
    return float((total / (1 + total)) ** (1 / STRETCH))


def autocovariance(x: np.ndarray) -> np.ndarray:
    """Sums of the products of a signal (N,) with itself 0 to N samples later, the last zero (N + 1,)."""
    # Padded to twice its length a spectrum does not wrap around.
    return np.fft.irfft(np.abs(np.fft.rfft(x, 2 * len(x))) ** 2)[: len(x) + 1]


def remembered(rows: np.ndarray, decay: float, before: np.ndarray) -> np.ndarray:
    """Filtered columns `z_n = y_n + ρ z_n-1`, so that `Σ z_n u_n` has the covariance of `Σ y_n x_n`.

    x has the same autocovariance in reversed time, so z needs no later samples.

    Args:
        rows: Columns y of one channel (k, N).
        decay: ρ of its noise.
        before: z at the sample before the first, zero if there is none (k,).

    Returns:
        z (k, N).
    """
    return autoregressive(rows.T, decay, before).T


def autoregressive(x: np.ndarray, rho: float, before: np.ndarray | float = 0.0) -> np.ndarray:
    """Solution of `y_k = ρ y_k-1 + x_k` along the first axis, as a triangular band: scipy.signal is slow to import.

    Args:
        x: Innovations (N, …), N of at least 1.
        rho: Autocorrelation from one sample to the next.
        before: The sample before the first one (…).
    """
    right = np.array(x.reshape(len(x), -1), order="F")
    right[0] += rho * np.ravel(before)
    band = np.empty((2, len(x)), order="F")
    band.T[:] = 1, -rho
    y, _ = lapack.dtbtrs(band, right, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(y.reshape(x.shape))


class Sandwich:
    """Middle factor of a sandwich covariance, `M = Σ_nm Y_nᵀ Γ(n - m) Y_m`, accumulated part by part.

    The noise's covariance Γ is from `innovations`.
    """

    def __init__(self, columns: int, channels: int) -> None:
        self._middle = np.zeros((columns, columns))
        self._tail = np.zeros(channels)
        self._left = np.zeros((channels, columns))

    def add(self, chunks: Iterable[np.ndarray], pull: np.ndarray, taken: float) -> None:
        """Adds the next part, whose noise may be correlated between channels and of any size in each sample.

        Args:
            chunks: Columns of its samples, some at a time, columns first (m, C, n).
            pull: Contribution of each residual to the normal equations, for least squares the residual itself (C, N).
            taken: Mean number of parameters determined by a channel's samples.
        """
        decay, size = innovations(pull, taken)
        first = 0
        for rows in chunks:
            z = [remembered(rows[:, c], rho, y) for c, (rho, y) in enumerate(zip(decay, self._left, strict=True))]
            self._left = np.array([each[:, -1] for each in z])
            last = first + rows.shape[2]
            # Contribution of each sample to the gradient.
            pulls = sum(each * u[first:last] for each, u in zip(z, size, strict=True))
            self._middle += pulls @ pulls.T
            first = last

    def add_steady(self, grams: Callable[[np.ndarray, np.ndarray], np.ndarray], pull: np.ndarray, taken: float) -> None:
        """Adds the next part, whose noise has constant size and is independent between channels.

        Args:
            grams: Function of each channel's ρ and its last z (C, m), which it overwrites, that returns the Gram
                matrices of the part's `remembered` columns (C, m, m).
            pull: As for `add`, also `taken`.
        """
        decay, size = innovations(pull, taken)
        variance = (size**2).mean(axis=1)
        self._middle += np.tensordot(variance, grams(decay, self._left), axes=1)
        self._tail = variance * decay**2 / (1 - decay**2)

    @property
    def middle(self) -> np.ndarray:
        """M (m, m)."""
        # The process continues after the last sample: later terms complete the variance of a stationary one.
        return self._middle + np.einsum("c,ck,cl->kl", self._tail, self._left, self._left)
