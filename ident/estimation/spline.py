"""Uniform B-splines of degree five: what a trajectory is made of, and the penalty that is its prior.

    x(t) = Σ_i c_i B((t - t_0) / h - i),        prior  λ ∫ x⃛² dt:  the jerk is white noise of variance 1/λ

On every interval of length h the same six polynomials overlap, so that a value takes a product of 6×6 matrices.
"""

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from typing import NamedTuple

import numpy as np

DEGREE = 5
LOCAL = DEGREE + 1
"""Basis functions that overlap at a time."""

ORDER = 3
"""Derivative that the prior takes for white noise; what the penalty cannot see are polynomials below."""


def _polynomials() -> np.ndarray:
    """Coefficients of the powers of u in [0, 1] of the overlapping functions, first function first (6, 6).

    `B(t) = Σ_j (-1)^j C(6, j) (t - j)₊⁵ / 5!`, its powers multiplied out where t = u + 5 - k for function k; as this
    short sum they need no splines of scipy's, which bring its optimisers and take as long to import as numpy.
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
        interval: Interval of each time, which is the index of its first function (N,).
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
    """A spline space over an interval of time.

    Attributes:
        start: First time, s.
        step: Distance h of the knots, s.
        intervals: Number of intervals.
    """

    start: float
    step: float
    intervals: int

    @classmethod
    def over(cls, first: float, last: float, step: float) -> "Spline":
        """Over an interval, with knots no further apart than so many seconds."""
        intervals = max(int(np.ceil((last - first) / step - 1e-9)), 1)
        return cls(first, (last - first) / intervals, intervals)

    @property
    def size(self) -> int:
        """Number of basis functions."""
        return self.intervals + DEGREE

    def local(self, time: np.ndarray) -> Local:
        """Basis functions at times, s (N,); beyond the ends the outermost polynomials go on."""
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
        """Functions whose middle lies between two times."""
        before = LOCAL / 2 - DEGREE
        a, b = ((time - self.start) / self.step - before for time in (first, last))
        return slice(max(int(np.ceil(a)), 0), min(int(np.floor(b)) + 1, self.size))

    def holds(self, time: np.ndarray) -> np.ndarray:
        """Whether times are within the interval (N,)."""
        return (time >= self.start) & (time <= self.start + self.intervals * self.step)

    def evaluate(self, coefficients: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Values and first three derivatives (4, N, n) of splines with coefficients (size, n)."""
        return self.local(time).combined(coefficients)

    def refined(self, coefficients: np.ndarray, other: "Spline") -> np.ndarray:
        """Coefficients in another space of nearly the same splines: `x - h²/4 ẍ` in functions' middles (size, n)."""
        middle = other.start + (np.arange(other.size) + LOCAL / 2 - DEGREE) * other.step
        x = self.evaluate(coefficients, middle)
        return np.asarray(x[0] - other.step**2 / 4 * x[2])

    def windows(self, coefficients: np.ndarray) -> np.ndarray:
        """The six coefficients that every interval sees (intervals, 6, n), of all (size, n)."""
        return coefficients[np.arange(self.intervals)[:, None] + np.arange(LOCAL)]

    @cached_property
    def penalty_root(self) -> np.ndarray:
        """R of one interval with `∫ x⃛² dt = |R c|²` for its six coefficients c (3, 6)."""
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE - ORDER + 1)
        jerk = Spline(0.0, self.step, 1).local((nodes + 1) / 2 * self.step).basis[ORDER]
        return jerk * np.sqrt(weights * self.step / 2)[:, None]

    @cached_property
    def penalty(self) -> np.ndarray:
        """P of one interval with `∫ x⃛² dt = cᵀ P c` (6, 6)."""
        return self.penalty_root.T @ self.penalty_root

    def squared_jerk(self, coefficients: np.ndarray) -> np.ndarray:
        """`∫ x⃛² dt` of splines with coefficients (size, n): (n,)."""
        return ((self.penalty_root @ self.windows(coefficients)) ** 2).sum(axis=(0, 1))

    def penalty_scores(self, rng: np.random.Generator, jerk: np.ndarray, draws: int) -> np.ndarray:
        """Random gradients of penalties `λ_j ∫ x⃛² dt` at motions of their prior, covariance `λ_j P` (size n, draws)."""
        out = np.zeros((self.size, len(jerk), draws))
        u = rng.normal(size=(self.intervals, len(self.penalty_root), len(jerk), draws))
        for k, own in enumerate(np.einsum("ra,srjd->asjd", self.penalty_root, u)):
            out[k : k + self.intervals] += own
        return (out * np.sqrt(jerk)[:, None]).reshape(-1, draws)
