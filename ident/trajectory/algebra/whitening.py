"""Innovations of streams whose noise is correlated over time and has outliers.

    r_k = ρ r_k-1 + u_k,     z_k = (r_k - ρ r_k-1) / (σ √(1 - ρ²)),     minimised  Σ_k h(z_k)
    h(z) = z²  where |z| ≤ c,  else  2 c |z| - c²,                      a row's weight  min(1, c / |z|)

(Huber, Ann. Math. Statist. 35, 1964, doi:10.1214/aoms/1177703732), with larger σ for errors in addition to noise:
`σ_k² = σ² + slack_k²`. A sample with large slack is not linked to its neighbours. Samples may be missing; the first one
after a gap has ρ = 0. An innovation is the sum of a slow and a fast half, which are uncorrelated and determine ρ:

    r_k - ρ r_k-1 = (1 - ρ) (r_k + r_k-1) / 2 + (1 + ρ) (r_k - r_k-1) / 2,      variances of z's halves  (1 ∓ ρ) / 2
"""

from typing import NamedTuple

import numpy as np

HUBER = 6.0
"""Innovation, in standard deviations, beyond which samples lose weight: outliers do, residuals of a touch hardly do,
because they depend on the motion and less weight on them would bias the estimate."""


class Sums(NamedTuple):
    """Sums over innovations, their slow halves and their fast halves.

    Attributes:
        squares: Sums of squares in standard deviations; innovations are clipped, and halves are weighted down for
            outliers at either sample (3, s).
        number: Expected values of these if nothing were fitted: numbers of samples, and parts of them (3, s).
    """

    squares: np.ndarray
    number: np.ndarray


class Innovations(NamedTuple):
    """Innovations of s streams.

    Attributes:
        values: Innovations in their standard deviations, zero where a sample is missing (N, s).
        std: Standard deviations of the innovations (N, s).
        rho: ρ where a sample is linked to the one before, else zero (N, s).
        residual: Residuals, zero where missing (N, s).
        there: Mask of the samples present (N, s).
        linked: Mask of the samples linked to the one before (N, s).
        clarity: Share of the noise in the variance of a sample, less than one where there is slack (N, s).
    """

    values: np.ndarray
    std: np.ndarray
    rho: np.ndarray
    residual: np.ndarray
    there: np.ndarray
    linked: np.ndarray
    clarity: np.ndarray

    def of_streams(self, streams: np.ndarray) -> "Innovations":
        """Innovations of some of the streams."""
        if np.array_equal(streams, np.arange(self.values.shape[1])):
            return self
        return Innovations(*(x[:, streams] for x in self))

    @property
    def cost(self) -> float:
        """Sum of Huber's h over all innovations."""
        size = np.abs(self.values)
        return float(np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2).sum())

    @property
    def weight(self) -> np.ndarray:
        """Weights of the rows, less than one for outliers (N, s)."""
        return HUBER / np.maximum(np.abs(self.values), HUBER)

    @property
    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """Factors on sums and on differences with the preceding sample in slow and fast halves (N, s)."""
        pairs = self.linked * self.weight
        pairs[1:] *= self.weight[:-1]
        return pairs * (1 - self.rho) / (2 * self.std), pairs * (1 + self.rho) / (2 * self.std)

    @property
    def sums(self) -> Sums:
        """Sums of squares, and their expected values, from which variances are estimated."""
        slow, fast = self.halves
        before, whole = np.zeros_like(self.residual), (slow + fast) * self.std**2
        before[1:] = self.residual[:-1]
        clipped = np.minimum(np.abs(self.values), HUBER)
        squares = np.square([clipped, slow * (self.residual + before), fast * (self.residual - before)])
        squares[0] *= self.clarity
        number = np.stack([self.there * self.clarity, slow * whole, fast * whole])
        return Sums(squares.sum(axis=1), number.sum(axis=1))


def innovations(
    residual: np.ndarray, interval: np.ndarray, std: np.ndarray, rho: np.ndarray, slack: np.ndarray | None = None
) -> Innovations:
    """Innovations of residuals.

    Args:
        residual: Measured less predicted, NaN where missing (N, s).
        interval: Interval of the trajectory of each sample, never decreasing (N,). Consecutive samples are linked if
            they are in the same or adjacent intervals.
        std: Standard deviations of the noise (s,).
        rho: Correlation of the noise from one sample to the next (s,).
        slack: Standard deviation of the error in addition to noise (N, s), by default none.
    """
    there = np.isfinite(residual)
    residual = np.where(there, residual, 0.0)
    linked = np.zeros_like(there)
    linked[1:] = there[1:] & there[:-1] & (np.diff(interval) <= 1)[:, None]
    if slack is not None:
        loose = slack > std
        linked[1:] &= ~(loose[1:] | loose[:-1])
    own = np.where(linked, rho, 0.0)
    new = residual.copy()
    new[1:] -= own[1:] * residual[:-1]
    std = std * np.sqrt(1 - own**2)
    whole = std if slack is None else np.hypot(std, slack)
    return Innovations(there * new / whole, whole, own, residual, there, linked, (std / whole) ** 2)
