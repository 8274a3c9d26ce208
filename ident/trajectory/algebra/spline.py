"""Uniform B-splines of degree five for trajectories, and the penalty that is their prior.

    x(t) = Σ_i c_i B((t - t_0) / h - i),        prior  λ ∫ x⃛² dt:  the jerk is white noise of variance 1/λ

On every interval of length h the same six polynomials overlap, so that values follow from one 6×6 matrix.
"""

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import lapack

DEGREE = 5

LOCAL = DEGREE + 1
"""Number of basis functions that overlap at any time."""

ORDER = 3
"""Order of the derivative that is white noise in the prior; polynomials of lower degree are not penalised."""

DIFFERENCES = np.array([-1.0, 3.0, -3.0, 1.0])
"""Factors of third differences."""


def _polynomials() -> np.ndarray:
    """Coefficients of the powers of u in [0, 1] of the overlapping functions, first function first (6, 6).

    `B(t) = Σ_j (-1)^j C(6, j) (t - j)₊⁵ / 5!`, expanded in powers of u with t = u + 5 - k for function k. This avoids
    scipy's splines, which import its optimisers and take as long to import as numpy.
    """
    out = np.zeros((LOCAL, LOCAL))
    for k in range(LOCAL):
        for power in range(LOCAL):
            terms = ((-1) ** j * comb(LOCAL, j) * (DEGREE - k - j) ** (DEGREE - power) for j in range(LOCAL - k))
            out[k, power] = comb(DEGREE, power) * sum(terms) / factorial(DEGREE)
    return out


POLYNOMIALS = _polynomials()


class Local(NamedTuple):
    """Basis functions at some times.

    Attributes:
        interval: Interval of each time, also the index of its first function (N,).
        basis: Values of the six functions and of their first three derivatives, s⁻ᵈ (4, N, 6).
    """

    interval: np.ndarray
    basis: np.ndarray

    def combined(self, coefficients: np.ndarray) -> np.ndarray:
        """Values and first three derivatives (4, N, n) of splines with coefficients (size, n)."""
        window = coefficients[self.interval[:, None] + np.arange(LOCAL)]
        return (self.basis.swapaxes(0, 1) @ window).swapaxes(0, 1)


@dataclass(frozen=True)
class Spline:
    """Spline space over an interval of time.

    Attributes:
        start: First time, s.
        step: Knot spacing h, s.
        intervals: Number of intervals.
    """

    start: float
    step: float
    intervals: int

    @classmethod
    def over(cls, first: float, last: float, step: float) -> "Spline":
        """Spline space from one time to another with knot spacing of at most `step`, s."""
        intervals = max(int(np.ceil((last - first) / step - 1e-9)), 1)
        return cls(first, (last - first) / intervals, intervals)

    @property
    def size(self) -> int:
        """Number of basis functions."""
        return self.intervals + DEGREE

    def local(self, time: np.ndarray) -> Local:
        """Basis functions at times, s (N,); beyond the ends the outermost polynomials are extrapolated."""
        u = (np.asarray(time) - self.start) / self.step
        interval = np.clip(np.floor(u).astype(int), 0, self.intervals - 1)
        powers = np.vander(u - interval, LOCAL, increasing=True)
        basis, polynomials = [], POLYNOMIALS
        for derivative in range(4):
            orders = polynomials.shape[1]
            basis.append(powers[:, :orders] @ polynomials.T / self.step**derivative)
            polynomials = polynomials[:, 1:] * np.arange(1, orders)
        return Local(interval, np.array(basis))

    def within(self, first: float, last: float) -> slice:
        """Indices of the functions whose middle lies between two times."""
        before = LOCAL / 2 - DEGREE
        a, b = ((time - self.start) / self.step - before for time in (first, last))
        return slice(max(int(np.ceil(a)), 0), min(int(np.floor(b)) + 1, self.size))

    def holds(self, time: np.ndarray) -> np.ndarray:
        """Mask of the times within the interval (N,)."""
        return (time >= self.start) & (time <= self.start + self.intervals * self.step)

    def evaluate(self, coefficients: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Values and first three derivatives (4, N, n) of splines with coefficients (size, n)."""
        return self.local(time).combined(coefficients)

    def refined(self, coefficients: np.ndarray, other: "Spline") -> np.ndarray:
        """Coefficients of nearly the same splines in another space: `x - h²/4 ẍ` at functions' middles (size, n)."""
        middle = other.start + (np.arange(other.size) + LOCAL / 2 - DEGREE) * other.step
        x = self.evaluate(coefficients, middle)
        return np.asarray(x[0] - other.step**2 / 4 * x[2])

    @cached_property
    def penalty_root(self) -> np.ndarray:
        """R of one interval such that `∫ x⃛² dt = |R c|²` for its six coefficients c (3, 6)."""
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE - ORDER + 1)
        jerk = Spline(0.0, self.step, 1).local((nodes + 1) / 2 * self.step).basis[ORDER]
        return jerk * np.sqrt(weights * self.step / 2)[:, None]

    @cached_property
    def penalty(self) -> np.ndarray:
        """P of one interval such that `∫ x⃛² dt = cᵀ P c` (6, 6)."""
        return self.penalty_root.T @ self.penalty_root

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows of R such that `∫ x⃛² dt = |R c|²`, each from its diagonal on (size - 3, 6).

        Third differences of c are the coefficients of the jerk by B-splines of degree two; R is the Cholesky factor of
        their Gram matrix times these differences.
        """
        apart = np.array([np.pad(DIFFERENCES, (k, ORDER - 1 - k)) for k in range(ORDER)])
        own = np.linalg.solve(apart[:, :ORDER].T, self.penalty_root[:, :ORDER].T)
        gram, band = own @ own.T, np.zeros((self.size - ORDER, ORDER))
        for k in range(ORDER):
            band[k : k + self.intervals, : ORDER - k] += gram[k, k:]
        return np.asarray(lapack.dpbtrf(band.T, lower=1)[0].T @ apart)

    @cached_property
    def roots(self) -> sparse.csr_matrix:
        """R as a matrix (size - 3, size)."""
        shape = self.size - ORDER, self.size
        columns = np.minimum(np.arange(shape[0])[:, None] + np.arange(LOCAL), self.size - 1)
        return sparse.csr_matrix((self.rows.ravel(), columns.ravel(), LOCAL * np.arange(shape[0] + 1)), shape)

    def bent(self, coefficients: np.ndarray, jerk: np.ndarray) -> np.ndarray:
        """`√λ R c` of coefficients c (size n, k) with λ (n,), whose squares add up to `Σ_j λ_j ∫ x⃛_j² dt` (m n, k)."""
        scaled = np.zeros((self.size + ORDER - 1, len(jerk), coefficients.shape[-1]))
        np.multiply(coefficients.reshape(self.size, *scaled.shape[1:]), np.sqrt(jerk)[:, None], out=scaled[: self.size])
        # A product for each row takes a fifth of the time of one with the sparse matrix.
        bent = self.rows[:, None] @ sliding(scaled.reshape(len(scaled), -1), LOCAL)
        return bent.reshape(-1, coefficients.shape[-1])

    def penalised(self, coefficients: np.ndarray, jerk: np.ndarray) -> np.ndarray:
        """`λ P c`, half the gradient of that sum, of coefficients c (size n, k)."""
        bent = self.bent(coefficients, jerk)
        out = np.asarray(self.roots.T @ bent.reshape(self.roots.shape[0], -1)).reshape(self.size, len(jerk), -1)
        return (out * np.sqrt(jerk)[:, None]).reshape(coefficients.shape)

    def squared_jerk(self, coefficients: np.ndarray) -> np.ndarray:
        """`∫ x⃛² dt` (n,) of splines with coefficients (size, n)."""
        return np.asarray(((self.roots @ coefficients) ** 2).sum(axis=0))


def sliding(x: np.ndarray, width: int, step: int = 1) -> np.ndarray:
    """Windows of adjacent rows of arrays (…, N, q), one every few rows, without a copy (…, k, width, q)."""
    *shape, number, q = x.shape
    # numpy's `sliding_window_view` takes as long as a product of small matrices.
    strides = *x.strides[:-2], step * x.strides[-2], *x.strides[-2:]
    windows = *shape, (number - width) // step + 1, width, q
    return np.lib.stride_tricks.as_strided(x, windows, strides, writeable=False)


class Intervals:
    """Grouping of samples by interval, m rows for each; unused rows are zero.

    Attributes:
        number: Number of intervals S.
        room: Rows per interval m, the largest number of samples in one.
    """

    def __init__(self, interval: np.ndarray, number: int) -> None:
        """Assigns a row to every sample.

        Args:
            interval: Interval of each sample, never decreasing (N,).
            number: Number of intervals.
        """
        counts = np.bincount(interval, minlength=number)
        self.number, self.room = number, max(int(counts.max(initial=0)), 1)
        self._place = self.room * interval + np.arange(len(interval)) - (np.cumsum(counts) - counts)[interval]
        self._places = np.divmod(self._place, self.room)
        self._last = np.maximum(counts - 1, 0)

    def dealt(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all samples (N, …) grouped by interval (S, m, …)."""
        out = np.zeros((self.number * self.room, *rows.shape[1:]))
        out[self._place] = rows
        return out.reshape(self.number, self.room, *rows.shape[1:])

    def gathered(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all samples (N, …) from those grouped by interval (S, m, …)."""
        return rows.reshape(self.number * self.room, *rows.shape[2:])[self._place]

    def dealt_by_stream(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all samples and streams (N, s, …) grouped by interval and stream (S, s, m, …)."""
        out = np.zeros((self.number, rows.shape[1], self.room, *rows.shape[2:]))
        out.swapaxes(1, 2)[self._places] = rows
        return out

    def before(self, rows: np.ndarray, first: int = 0, *, moved: int = 0) -> np.ndarray:
        """Rows of the preceding samples, zeros for the first.

        Args:
            rows: Rows of some intervals (k, m, …).
            first: Index of the first of these intervals.
            moved: Number of columns by which windows move from one interval to the next.
        """
        out = np.zeros_like(rows)
        out[:, 1:] = rows[:, :-1]
        last = rows[np.arange(len(rows) - 1), self._last[first : first + len(rows) - 1]]
        out[1:, 0, ..., : rows.shape[-1] - moved] = last[..., moved:]
        return out

    def last(self, rows: np.ndarray, first: int = 0) -> np.ndarray:
        """Rows of the last sample of each of some intervals but the last one.

        Args:
            rows: Rows of k intervals (k, c, m, …).
            first: Index of the first of these intervals.

        Returns:
            The rows (k - 1, c, …).
        """
        number = len(rows) - 1
        return rows[np.arange(number), :, self._last[first : first + number]]


@dataclass(frozen=True, eq=False)
class Sampling:
    """Spline functions at some times.

    Attributes:
        spline: Spline space.
        time: Times, s, never decreasing (N,).
    """

    spline: Spline
    time: np.ndarray

    @cached_property
    def local(self) -> Local:
        """Functions that overlap at each time."""
        return self.spline.local(self.time)

    @cached_property
    def intervals(self) -> Intervals:
        """Grouping of the times by interval."""
        return Intervals(self.local.interval, self.spline.intervals)

    @cached_property
    def dealt(self) -> np.ndarray:
        """Values of the functions of each interval, and of their first two derivatives (S, m, 6, 3)."""
        return self.intervals.dealt(self.local.basis[:3].transpose(1, 2, 0))

    @property
    def matrix(self) -> sparse.csr_matrix:
        """Values of all functions at the times (N, size)."""
        places = self.local.interval[:, None] + np.arange(LOCAL)
        start, shape = LOCAL * np.arange(len(self.time) + 1), (len(self.time), self.spline.size)
        return sparse.csr_matrix((self.local.basis[0].ravel(), places.ravel(), start), shape)
