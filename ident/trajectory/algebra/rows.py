"""Rows of a least-squares problem over a window of spline functions and θ, whitened like innovations.

    z_k - s_k (x_k - ρ x_k-1) · δ,        x = [∂y/∂c, ∂y/∂θ],     s = √weight / std

The leverage of each sample follows from quadratic forms `q_kl = x_k Cov x_lᵀ` with the covariance of coefficients and
θ: for innovations `s² (q_kk - 2 ρ q_k,k-1 + ρ² q_k-1,k-1)`, for their halves with factor f
`f² (q_kk ± 2 q_k,k-1 + q_k-1,k-1)`. Its sum is the degrees of freedom that the fit absorbs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.trajectory.algebra.arrow import Arrow, Posterior
from ident.trajectory.algebra.block_tridiagonal import WINDOW
from ident.trajectory.algebra.intervals import Intervals
from ident.trajectory.algebra.whitening import Innovations

TOGETHER = 2**20
"""Bytes of rows processed together, so that they stay in the cache."""


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors that whiten rows like innovations, grouped by interval.

    Attributes:
        right: Innovations in standard deviations, weighted (S, m, s).
        scale: Factor on rows (S, m, s).
        rho: Part of the preceding rows that is subtracted (S, m, s).
        slow: Factor on sums in slow halves (S, m, s).
        fast: Factor on differences in fast halves (S, m, s).
        clarity: Share of the noise in the variance of each sample (S, m, s).
    """

    right: np.ndarray
    scale: np.ndarray
    rho: np.ndarray
    slow: np.ndarray
    fast: np.ndarray
    clarity: np.ndarray

    @classmethod
    def of(cls, new: Innovations, intervals: Intervals) -> "Factors":
        """Factors of innovations."""
        root = np.sqrt(new.weight)
        every = new.values * root, new.there * root / new.std, new.rho, *new.halves, new.clarity
        return cls(*(intervals.dealt(x) for x in every))

    @cached_property
    def coloured(self) -> np.ndarray:
        """Mask of the streams with ρ above zero (s,)."""
        return np.asarray(self.rho.any(axis=(0, 1)))

    @cached_property
    def white(self) -> bool:
        """True if no stream has ρ above zero, so that preceding samples are not needed."""
        return not self.coloured.any()

    def whitened(self, rows: np.ndarray, before: np.ndarray, some: slice = slice(None)) -> np.ndarray:
        """Whitened rows of some intervals (k, m, s, …), from rows and those of the preceding samples."""
        each = (some, ..., *[None] * (rows.ndim - 3))
        if not self.white:
            rows = rows - self.rho[each] * before
        return self.scale[each] * rows

    def taken(self, own: np.ndarray, across: np.ndarray, before: np.ndarray, some: slice = slice(None)) -> np.ndarray:
        """Absorbed degrees of freedom of innovations and halves (3, s), zero for halves of streams without ρ.

        Args:
            own: q_kk (k, m, s); `across` q_k,k-1 and `before` q_k-1,k-1.
            some: Intervals.
        """
        scale, rho, slow, fast = (x[some] for x in (self.scale, self.rho, self.slow, self.fast))
        weights = self.clarity[some] * scale**2
        if self.white:
            nothing = np.zeros(own.shape[-1])
            return np.stack([_summed(weights, own), nothing, nothing])
        both = own + before
        shares = np.stack(
            [
                _summed(weights, own - 2 * rho * across + rho**2 * before),
                _summed(slow**2, both + 2 * across),
                _summed(fast**2, both - 2 * across),
            ]
        )
        shares[1:, ~self.coloured] = 0
        return shares


@dataclass(frozen=True, eq=False)
class ChannelRows:
    """Rows of channels, which depend on all coordinates and all of θ.

    Attributes:
        intervals: Grouping of samples by interval.
        basis: Values of the functions of each interval, and of their first two derivatives (S, m, 6, 3).
        by_states: Derivatives of the channels by coordinates and their derivatives (S, m, C, 3, n).
        by_theta: Derivatives by θ (S, m, C, p).
        factors: Factors that whiten them.
    """

    intervals: Intervals
    basis: np.ndarray
    by_states: np.ndarray
    by_theta: np.ndarray
    factors: Factors

    def add_to(self, arrow: Arrow) -> None:
        """Adds the rows to normal equations."""
        for some, fresh in self._blocks():
            J, T = self._windows(some), self.by_theta[some]
            J_before, T_before = self._before(J, some, self._moved), self._before(T, some)
            own = slice(some.start + fresh, some.stop)
            whitened = (self.factors.whitened(x[fresh:], y[fresh:], own) for x, y in ((J, J_before), (T, T_before)))
            arrow.add(own, *(_joined(x) for x in (*whitened, self.factors.right[own])))

    def taken(self, posterior: Posterior) -> np.ndarray:
        """Absorbed degrees of freedom of innovations and of their halves (3, C)."""
        shares = np.zeros((3, self.by_theta.shape[2]))
        for some, fresh in self._blocks():
            J = self._windows(some)
            K = _through(J, posterior.inverse[some])
            # Effect of θ, the change of the trajectory with it included.
            F = self.by_theta[some] @ posterior.root - _through(J, posterior.followed[some])
            quadratic = _dot(K, J) + _dot(F, F)
            across = np.zeros_like(quadratic)
            if not self.factors.white:
                J_before, F_before = self._before(J, some, self._moved), self._before(F, some)
                across = _dot(K, J_before) + _dot(F, F_before)
            before = self._before(quadratic, some)
            own = slice(some.start + fresh, some.stop)
            shares += self.factors.taken(quadratic[fresh:], across[fresh:], before[fresh:], own)
        return shares

    def _blocks(self) -> Iterator[tuple[slice, int]]:
        """Yields blocks of intervals and the number of extra ones at their start, one if ρ needs preceding samples."""
        _, m, C, _, n = self.by_states.shape
        size = max(1, TOGETHER // max(8 * m * C * WINDOW * n, 1))
        for start in range(0, self.intervals.number, size):
            first = max(start - (not self.factors.white), 0)
            yield slice(first, min(start + size, self.intervals.number)), start - first

    @property
    def _moved(self) -> int:
        return self.by_states.shape[-1]

    def _before(self, rows: np.ndarray, some: slice, moved: int = 0) -> np.ndarray:
        """Rows of the preceding samples, zeros without ρ."""
        if self.factors.white:
            return np.broadcast_to(0.0, rows.shape)
        return self.intervals.before(rows, some.start, moved=moved)

    def _windows(self, some: slice) -> np.ndarray:
        """Derivatives by the functions from the one before the interval's first (k, m, C, 7 n)."""
        by_states = self.by_states[some]
        k, m, C, _, n = by_states.shape
        out = np.zeros((k, m, C, WINDOW, n))
        out[:, :, :, 1:] = self.basis[some, :, None] @ by_states
        return out.reshape(k, m, C, WINDOW * n)


@dataclass(frozen=True, eq=False)
class StateRows:
    """Rows of measured coordinates, or of a derivative of them, which depend on one coordinate each and its zero.

    Attributes:
        intervals: Grouping of samples by interval.
        windows: Functions from the one before the interval's first, at samples and at preceding ones (S, m, 7).
        zeros: Columns of θ with the coordinates' zeros, by coordinate.
        factors: Factors that whiten them.
    """

    intervals: Intervals
    windows: tuple[np.ndarray, np.ndarray]
    zeros: Mapping[int, int]
    factors: Factors

    def add_to(self, arrow: Arrow) -> None:
        """Adds the rows to normal equations."""
        J, J_before = (x[:, :, None] for x in self.windows)
        ones = np.ones_like(self.factors.scale)
        T = self.factors.whitened(ones, ones)
        arrow.add_separate(self.factors.whitened(J, J_before), T, self.factors.right, self.zeros)

    def taken(self, posterior: Posterior) -> np.ndarray:
        """Absorbed degrees of freedom of innovations and of their halves (3, n)."""
        J, J_before = (x[:, None] for x in self.windows)
        K = J @ posterior.by_coordinate
        own, across = _dot(K, J), _dot(K, J_before)
        for j, at in self.zeros.items():
            zero = posterior.root[at]
            # The zero's covariance with the coefficients is -W Σ: they move against θ.
            mixed = posterior.followed_of(j) @ zero
            shift, shift_before = (zero @ zero / 2 - x[:, 0] @ mixed[:, :, None] for x in (J, J_before))
            own[:, j] += 2 * shift[..., 0]
            across[:, j] += (shift + shift_before)[..., 0]
        own, across = own.swapaxes(1, 2), across.swapaxes(1, 2)
        return self.factors.taken(own, across, self.intervals.before(own))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of vectors (…, w): (…,)."""
    return np.einsum("...w,...w->...", a, b)


def _summed(weights: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Weighted sums over the samples of all intervals (k, m, s): (s,)."""
    return np.einsum("kms,kms->s", weights, x)


def _joined(x: np.ndarray) -> np.ndarray:
    """Rows of all streams of an interval, one after the other (k, m, s, …) -> (k, m s, …)."""
    return x.reshape(x.shape[0], x.shape[1] * x.shape[2], *x.shape[3:])


def _through(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Rows (k, m, s, w) of each interval times its matrix (k, w, v): (k, m, s, v)."""
    return (_joined(rows) @ matrix).reshape(*rows.shape[:-1], matrix.shape[-1])
