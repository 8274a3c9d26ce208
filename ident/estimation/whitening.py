"""Rows of a least-squares problem from streams whose noise is correlated over time and has outliers.

    r_k = ρ r_k-1 + u_k,     z_k = (r_k - ρ r_k-1) / (σ √(1 - ρ²)),     minimised  Σ_k h(z_k)
    h(z) = z²  where |z| ≤ c,  else  2 c |z| - c²,                      a row's weight  min(1, c / |z|)

(Huber, Ann. Math. Statist. 35, 1964, doi:10.1214/aoms/1177703732). Samples may be missing; the first one after a gap is
taken by itself. An innovation is the sum of a slow and a fast half, which are uncorrelated and tell of ρ:

    r_k - ρ r_k-1 = (1 - ρ) (r_k + r_k-1) / 2 + (1 + ρ) (r_k - r_k-1) / 2,      variances of z's halves  (1 ∓ ρ) / 2
"""

from typing import NamedTuple

import numpy as np

HUBER = 6.0
"""Innovations beyond so many standard deviations lose weight: outliers do, and what a touch leaves hardly does, which
goes with the motion and would bias the estimate."""


class Innovations(NamedTuple):
    """What is new in each sample of s streams.

    Attributes:
        values: Innovations in their standard deviations, zero where a sample is missing (N, s).
        std: Their standard deviations (N, s).
        rho: ρ where a sample follows another one, else zero (N, s).
        residual: Residuals as they are, zero where missing (N, s).
        there: Whether there is a sample (N, s).
        linked: Whether it follows another one (N, s).
    """

    values: np.ndarray
    std: np.ndarray
    rho: np.ndarray
    residual: np.ndarray
    there: np.ndarray
    linked: np.ndarray

    @property
    def cost(self) -> float:
        """Squares, and what outliers count in place of theirs."""
        size = np.abs(self.values)
        return float(np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2).sum())

    @property
    def weight(self) -> np.ndarray:
        """Weights of the rows, less than one for outliers (N, s)."""
        return HUBER / np.maximum(np.abs(self.values), HUBER)


class Half(NamedTuple):
    """Rows of one of the halves of innovations.

    Attributes:
        windows: Derivatives by the spline functions of a window (S, m, h, w).
        border: Derivatives by some of θ (S, m, h, r).
    """

    windows: np.ndarray
    border: np.ndarray


class Rows(NamedTuple):
    """Whitened rows `right - windows @ δc - border @ δθ[columns]`, dealt out to intervals of time.

    Every interval has room for m samples of the s streams; where it has fewer, rows are zero.

    Attributes:
        windows: Derivatives by the spline functions of a window, of one or of all coordinates (S, m, s, w).
        border: Derivatives by some of θ (S, m, s, r).
        right: Innovations in standard deviations (S, m, s).
        columns: Which of θ those are (r,).
        squares: Sums of squared innovations, clipped, over what clipping leaves of normal ones; and of their slow and
            of their fast halves, which lose the weight that outliers lose at either sample (3, s).
        number: What these would be on average were the noise not fitted: how many samples, and parts of them (3, s).
        coloured: Which streams have ρ above zero (h,).
        halves: Rows of the slow and of the fast halves of these.
    """

    windows: np.ndarray
    border: np.ndarray
    right: np.ndarray
    columns: np.ndarray
    squares: np.ndarray
    number: np.ndarray
    coloured: np.ndarray
    halves: tuple[Half, Half]


def innovations(residual: np.ndarray, interval: np.ndarray, std: np.ndarray, rho: np.ndarray) -> Innovations:
    """What is new in each sample.

    Args:
        residual: Measured less predicted, NaN where missing (N, s).
        interval: Interval of the trajectory that each sample is in, never decreasing (N,). A sample follows the one
            before it where their windows overlap.
        std: Standard deviations of the noise (s,).
        rho: Its correlation from one sample to the next (s,).
    """
    there = np.isfinite(residual)
    residual = np.where(there, residual, 0.0)
    linked = np.zeros_like(there)
    linked[1:] = there[1:] & there[:-1] & (np.diff(interval) <= 1)[:, None]
    own = np.where(linked, rho, 0.0)
    new = residual.copy()
    new[1:] -= own[1:] * residual[:-1]
    std = std * np.sqrt(1 - own**2)
    return Innovations(there * new / std, std, own, residual, there, linked)


def whitened(
    new: Innovations,
    interval: np.ndarray,
    intervals: int,
    *,
    windows: np.ndarray,
    border: np.ndarray,
    columns: np.ndarray,
) -> Rows:
    """Rows of innovations; outliers lose weight.

    Args:
        new: Innovations (N, s).
        interval: Interval of each sample, never decreasing (N,).
        intervals: Number of intervals S.
        windows: Derivatives of predictions by the functions from the one before the interval's first, of one or of n
            coordinates (N, s, 7, n); overwritten.
        border: Derivatives by some of θ (N, s, r); overwritten.
        columns: Which of θ those are (r,).
    """
    root, (slow, fast) = np.sqrt(new.weight), _halves(new)
    squares, number = _sums(new, slow, fast)

    def dealt(windows: np.ndarray, border: np.ndarray, scale: np.ndarray) -> Half:
        scaled = (scale[..., None, None] * windows).reshape(*scale.shape, windows.shape[2] * windows.shape[3])
        return Half(_dealt(scaled, interval, intervals), _dealt(scale[..., None] * border, interval, intervals))

    coloured = np.flatnonzero(new.rho.any(axis=0))
    J, T = windows[:, coloured], border[:, coloured]
    J_before, T_before, rho = _before(J, interval), _before(T), new.rho[:, coloured, None]
    windows[:, coloured] -= rho[..., None] * J_before
    border[:, coloured] -= rho * T_before
    fitted = dealt(windows, border, new.there * root / new.std)
    return Rows(
        *fitted,
        _dealt(new.values * root, interval, intervals),
        columns,
        squares=squares,
        number=number,
        coloured=coloured,
        halves=(
            dealt(J + J_before, T + T_before, slow[:, coloured]),
            dealt(J - J_before, T - T_before, fast[:, coloured]),
        ),
    )


def _halves(new: Innovations) -> tuple[np.ndarray, np.ndarray]:
    """What sums and differences with the sample before are multiplied by in the two halves of innovations (N, s)."""
    pairs = new.linked * new.weight
    pairs[1:] *= new.weight[:-1]
    return pairs * (1 - new.rho) / (2 * new.std), pairs * (1 + new.rho) / (2 * new.std)


def _sums(new: Innovations, slow: np.ndarray, fast: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squares of innovations and of their halves (3, s), and what these would be on average (3, s)."""
    before, whole = _before(new.residual), (slow + fast) * new.std**2
    halves = slow * (new.residual + before), fast * (new.residual - before)
    clipped = np.minimum(np.abs(new.values), HUBER)
    squares, number = np.square([clipped, *halves]), np.stack([new.there, slow * whole, fast * whole])
    return squares.sum(axis=1), number.sum(axis=1)


def _before(rows: np.ndarray, interval: np.ndarray | None = None) -> np.ndarray:
    """Rows (N, s, …) of the samples before, zero for the first; windows (N, s, 7, n) are written in the samples' own.

    Args:
        rows: Rows of all samples.
        interval: Interval of each sample, if they are windows (N,).
    """
    before = np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])
    if interval is not None:
        # The window of a sample in the interval before begins one function earlier.
        moved = np.diff(interval, prepend=interval[:1]) > 0
        before[moved, :, :-1], before[moved, :, -1] = before[moved, :, 1:], 0
    return before


def _dealt(rows: np.ndarray, interval: np.ndarray, intervals: int) -> np.ndarray:
    """Rows (N, …) by intervals, zeros where an interval has fewer samples (S, m, …)."""
    counts = np.bincount(interval, minlength=intervals)
    place = np.arange(len(interval)) - (np.cumsum(counts) - counts)[interval]
    out = np.zeros((intervals, max(int(counts.max(initial=0)), 1), *rows.shape[1:]))
    out[interval, place] = rows
    return out
