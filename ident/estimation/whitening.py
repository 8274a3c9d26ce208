"""What is new in each sample of streams whose noise is correlated over time and has outliers.

    r_k = ρ r_k-1 + u_k,     z_k = (r_k - ρ r_k-1) / (σ √(1 - ρ²)),     minimised  Σ_k h(z_k)
    h(z) = z²  where |z| ≤ c,  else  2 c |z| - c²,                      a row's weight  min(1, c / |z|)

with a larger σ where something besides the noise is unknown: `σ_k² = σ² + slack_k²`. Such a sample follows no other one
(Huber, Ann. Math. Statist. 35, 1964, doi:10.1214/aoms/1177703732). Samples may be missing; the first one after a gap is
taken by itself. An innovation is the sum of a slow and a fast half, which are uncorrelated and tell of ρ:

    r_k - ρ r_k-1 = (1 - ρ) (r_k + r_k-1) / 2 + (1 + ρ) (r_k - r_k-1) / 2,      variances of z's halves  (1 ∓ ρ) / 2
"""

from typing import NamedTuple

import numpy as np

HUBER = 6.0
"""Innovations beyond so many standard deviations lose weight: outliers do, and what a touch leaves hardly does, which
goes with the motion and would bias the estimate."""


class Sums(NamedTuple):
    """Of innovations, of their slow halves, and of their fast ones.

    Attributes:
        squares: Sums of squares in standard deviations, of innovations clipped; halves lose the weight that outliers
            lose at either sample (3, s).
        number: What these would be on average were the noise not fitted: how many samples, and parts of them (3, s).
    """

    squares: np.ndarray
    number: np.ndarray


class Innovations(NamedTuple):
    """What is new in each sample of s streams.

    Attributes:
        values: Innovations in their standard deviations, zero where a sample is missing (N, s).
        std: Their standard deviations (N, s).
        rho: ρ where a sample follows another one, else zero (N, s).
        residual: Residuals as they are, zero where missing (N, s).
        there: Whether there is a sample (N, s).
        linked: Whether it follows another one (N, s).
        clarity: Share of the noise in the variance of a sample, less than one where there is slack (N, s).
    """

    values: np.ndarray
    std: np.ndarray
    rho: np.ndarray
    residual: np.ndarray
    there: np.ndarray
    linked: np.ndarray
    clarity: np.ndarray

    @property
    def cost(self) -> float:
        """Squares, and what outliers count in place of theirs."""
        size = np.abs(self.values)
        return float(np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2).sum())

    @property
    def weight(self) -> np.ndarray:
        """Weights of the rows, less than one for outliers (N, s)."""
        return HUBER / np.maximum(np.abs(self.values), HUBER)

    @property
    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """What sums and differences with the sample before are multiplied by in slow and fast halves (N, s)."""
        pairs = self.linked * self.weight
        pairs[1:] *= self.weight[:-1]
        return pairs * (1 - self.rho) / (2 * self.std), pairs * (1 + self.rho) / (2 * self.std)

    @property
    def sums(self) -> Sums:
        """What tells of variances."""
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
    """What is new in each sample.

    Args:
        residual: Measured less predicted, NaN where missing (N, s).
        interval: Interval of the trajectory that each sample is in, never decreasing (N,). A sample follows the one
            before it where their windows overlap.
        std: Standard deviations of the noise (s,).
        rho: Its correlation from one sample to the next (s,).
        slack: Standard deviation of what is unknown besides the noise (N, s), by default nothing.
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
