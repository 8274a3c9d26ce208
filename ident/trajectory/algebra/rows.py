"""Rows of a least-squares problem over a window of spline functions and θ, whitened like innovations.

    z_k - s_k (x_k - ρ x_k-1) · δ,        x = [∂y/∂c, ∂y/∂θ],     s = √weight / std

The leverage of each sample follows from quadratic forms `q_kl = x_k Cov x_lᵀ` with the covariance of coefficients and
θ: for innovations `s² (q_kk - 2 ρ q_k,k-1 + ρ² q_k-1,k-1)`, for their halves with factor f
`f² (q_kk ± 2 q_k,k-1 + q_k-1,k-1)`. Its sum is the degrees of freedom that the fit absorbs.

Where there are many samples, channels are evaluated at a few Gauss nodes of every knot interval instead. Within it the
trajectory is a polynomial, and a channel is a smooth function of it: the polynomial through its values at the nodes
equals it to 1e-8 or better as long as joints turn little, and so do its derivatives by coefficients and θ:

    y_k = Σ_i L_ki y(t_i),     Σ_k s_k² x_k x_kᵀ = Σ_ij X_i M_ij X_jᵀ,     M = Σ_k s_k² L_k L_kᵀ

with Lagrange's polynomials in barycentric form (Berrut and Trefethen, SIAM Review 46, 2004,
doi:10.1137/S0036144502417715).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from ident.trajectory.algebra.arrow import Arrow, Group, Posterior, stacked, transposed
from ident.trajectory.algebra.banded import WINDOW
from ident.trajectory.algebra.spline import Intervals, Sampling, Spline
from ident.trajectory.algebra.whitening import Innovations

TOGETHER = 2**20
"""Bytes of rows processed together, so that they stay in the cache."""

NODES = 14
"""Number of nodes of an interval: with fewer, rounding is exceeded where knots are as far apart as they may be."""

WORTH_IT = 1.5
"""Samples of an interval, over its nodes, from which evaluation at nodes is faster."""

TURNED = 3.0
"""Largest angle by which a body turns within an interval, by all joints together, rad. Channels have sines of twice it:
that of six radians is interpolated to 1e-8, of ten to 2e-5 only."""

_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2

_WEIGHTS = 1 / np.prod(_PLACES[:, None] - _PLACES + np.eye(NODES), axis=1)


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

    def whitened(self, rows: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Whitened rows (S, m, s, …), from rows and those of the preceding samples."""
        each = (..., *[None] * (rows.ndim - 3))
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
    """Rows of channels that depend on some coordinates and some entries of θ.

    Within an interval the samples of a channel are adjacent.

    Attributes:
        at: Spline functions at the samples.
        group: The c channels and their n coordinates and p parameters, numbered within the equations.
        by_states: Derivatives of the channels by these coordinates and their derivatives (S, c, m, 3, n).
        by_theta: Derivatives by these parameters (S, c, m, p).
        factors: Factors that whiten them.
    """

    at: Sampling
    group: Group
    by_states: np.ndarray
    by_theta: np.ndarray
    factors: Factors

    @classmethod
    def of(cls, at: Sampling, group: Group, by_states: np.ndarray, by_theta: np.ndarray, new: Innovations) -> Self:
        """Rows of a group of channels.

        Args:
            at: Spline functions at the samples.
            group: The group.
            by_states: Derivatives of its channels by its coordinates and their derivatives (N, c, 3, n).
            by_theta: Derivatives by its parameters (N, c, p).
            new: Innovations of its channels.
        """
        dealt = at.intervals.dealt_by_stream
        return cls(at, group, dealt(by_states), dealt(by_theta), Factors.of(new, at.intervals))

    def add_to(self, arrow: Arrow) -> None:
        """Adds the rows to normal equations."""
        right = self.factors.right.swapaxes(1, 2)
        for some, fresh in self._blocks():
            own = slice(some.start + fresh, some.stop)
            J = self._whitened(self._windows(some), some, moved=len(self.group.coordinates))[fresh:]
            T = self._whitened(self.by_theta[some], some)[fresh:]
            rows = _joined(J), _joined(T)
            arrow.add(own, rows, rows, _joined(right[own]), self.group)

    def taken(self, posterior: Posterior) -> np.ndarray:
        """Absorbed degrees of freedom of innovations and of their halves (3, c)."""
        shares, moved = np.zeros((3, len(self.group.channels))), len(self.group.coordinates)
        first, root = _nonzero(posterior.root[self.group.columns])
        for some, fresh in self._blocks():
            J = self._windows(some)
            inverse, followed = posterior.of_coordinates(some, self.group.coordinates)
            K, F = _through(J, inverse), _through(J, followed)
            # Effect of θ, the change of the trajectory with it included.
            F[..., first:] -= (stacked(self.by_theta[some]) @ root).reshape(*F.shape[:-1], -1)
            quadratic = _dot(K, J) + _dot(F, F)
            across = self._across(K, J, some, moved) + self._across(F, F, some)
            own = slice(some.start + fresh, some.stop)
            quadratic, across = (x.swapaxes(1, 2) for x in (quadratic, across))
            before = self.at.intervals.before(quadratic, some.start)
            shares += self.factors.taken(quadratic[fresh:], across[fresh:], before[fresh:], own)
        return shares

    def _blocks(self) -> Iterator[tuple[slice, int]]:
        """Yields blocks of intervals and the number of extra ones at their start, one if ρ needs preceding samples."""
        _, C, m, _, n = self.by_states.shape
        size = max(1, TOGETHER // max(8 * m * C * WINDOW * n, 1))
        for start in range(0, self.at.intervals.number, size):
            first = max(start - (not self.factors.white), 0)
            yield slice(first, min(start + size, self.at.intervals.number)), start - first

    @cached_property
    def _scale(self) -> np.ndarray:
        """Factor on rows (S, c, m, 1)."""
        return np.ascontiguousarray(self.factors.scale.swapaxes(1, 2))[..., None]

    @cached_property
    def _of_before(self) -> np.ndarray:
        """Factor on the preceding rows (S, c, m, 1)."""
        return self._scale * self.factors.rho.swapaxes(1, 2)[..., None]

    def _windows(self, some: slice) -> np.ndarray:
        """Derivatives by the functions from the one before the interval's first (k, c, m, 7 n)."""
        by_states = self.by_states[some]
        k, c, m, _, n = by_states.shape
        out = np.empty((k, c, m, WINDOW, n))
        out[..., 0, :] = 0
        np.matmul(self.at.dealt[some, None], by_states, out=out[..., 1:, :])
        return out.reshape(k, c, m, WINDOW * n)

    def _whitened(self, rows: np.ndarray, some: slice, moved: int = 0) -> np.ndarray:
        """Whitened rows of some intervals (k, c, m, w), the first sample of the first interval excepted.

        Args:
            rows: The rows.
            some: The intervals.
            moved: Number of columns by which windows move from one interval to the next.
        """
        out = self._scale[some] * rows
        if not self.factors.white:
            weight = self._of_before[some]
            out[:, :, 1:] -= weight[:, :, 1:] * rows[:, :, :-1]
            last = self.at.intervals.last(rows, some.start)[..., moved:]
            out[1:, :, 0, : last.shape[-1]] -= weight[1:, :, 0] * last
        return out

    def _across(self, a: np.ndarray, b: np.ndarray, some: slice, moved: int = 0) -> np.ndarray:
        """Products of rows a and the preceding rows b of some intervals (k, c, m, w): (k, c, m), zeros without ρ.

        Args:
            a: The rows.
            b: The rows of which the preceding ones are taken.
            some: The intervals.
            moved: Number of columns by which windows move from one interval to the next.
        """
        out = np.zeros(a.shape[:3])
        if not self.factors.white:
            out[:, :, 1:] = _dot(a[:, :, 1:], b[:, :, :-1])
            last = self.at.intervals.last(b, some.start)[..., moved:]
            out[1:, :, 0] = _dot(a[1:, :, 0, : last.shape[-1]], last)
        return out


@dataclass(frozen=True, eq=False)
class StateRows:
    """Rows of measured coordinates, which depend on one coordinate each and its zero.

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


def _nonzero(root: np.ndarray) -> tuple[int, np.ndarray]:
    """First column of a matrix that is not zero, and the matrix from there on: roots are triangular."""
    first = int(root.any(axis=0).argmax()) if root.size else 0
    return first, root[:, first:]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of vectors (…, w): (…,)."""
    return np.einsum("...w,...w->...", a, b)


def _summed(weights: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Weighted sums over the samples of all intervals (k, m, s): (s,)."""
    return np.einsum("kms,kms->s", weights, x)


def _joined(x: np.ndarray) -> np.ndarray:
    """Rows of all streams of an interval, one after the other (k, s, m, …) -> (k, s m, …)."""
    return x.reshape(x.shape[0], x.shape[1] * x.shape[2], *x.shape[3:])


def _through(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Rows (k, s, m, w) of each interval times its matrix (k, w, v): (k, s, m, v)."""
    return (_joined(rows) @ matrix).reshape(*rows.shape[:-1], matrix.shape[-1])


def lagrange(u: np.ndarray) -> np.ndarray:
    """Values of the nodes' polynomials at places in an interval, zero at its start and one at its end (N, NODES)."""
    off = u[:, None] - _PLACES
    hit = np.abs(off) < 1e-14
    terms = _WEIGHTS / np.where(hit, 1.0, off)
    out = terms / terms.sum(axis=1, keepdims=True)
    at = hit.any(axis=1)
    out[at] = hit[at]
    return out


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of the intervals of a spline space, and the polynomials through them at the times of samples.

    Attributes:
        at: Spline functions at the samples.
    """

    at: Sampling

    @property
    def spline(self) -> Spline:
        """The spline space."""
        return self.at.spline

    @cached_property
    def sampling(self) -> Sampling:
        """Spline functions at the nodes."""
        return Sampling(self.spline, self.time)

    @cached_property
    def time(self) -> np.ndarray:
        """Times of the nodes, s (S NODES,)."""
        places = np.arange(self.spline.intervals)[:, None] + _PLACES
        return self.spline.start + (places * self.spline.step).ravel()

    @property
    def basis(self) -> np.ndarray:
        """Values of the functions of an interval at its nodes, and of their first two derivatives (NODES, 6, 3)."""
        return self.sampling.local.basis[:3, :NODES].transpose(1, 2, 0)

    @cached_property
    def polynomials(self) -> np.ndarray:
        """The nodes' polynomials at the samples, grouped by interval (S, m, NODES)."""
        u = (self.at.time - self.spline.start) / self.spline.step - self.at.local.interval
        return self.at.intervals.dealt(lagrange(u))

    def interpolated(self, values: np.ndarray) -> np.ndarray:
        """Values at the samples (N, …) from those at the nodes (S NODES, …)."""
        by_interval = self.polynomials @ values.reshape(self.spline.intervals, NODES, -1)
        return self.at.intervals.gathered(by_interval).reshape(-1, *values.shape[1:])


@dataclass(frozen=True, eq=False)
class NodeRows:
    """Rows of channels as `ChannelRows`, with white noise and without slack, whose derivatives are given at nodes.

    Attributes:
        nodes: The nodes.
        group: The c channels and their n coordinates and p parameters, numbered within the equations.
        by_states: Derivatives of the channels by coordinates and their derivatives at the nodes (S, NODES, c, 3, n).
        by_theta: Derivatives by θ at the nodes (S, NODES, c, p).
        factors: Factors that whiten the samples' rows.
    """

    nodes: Nodes
    group: Group
    by_states: np.ndarray
    by_theta: np.ndarray
    factors: Factors

    @classmethod
    def of(cls, nodes: Nodes, group: Group, by_states: np.ndarray, by_theta: np.ndarray, new: Innovations) -> Self:
        """Rows of a group of channels, as `ChannelRows.of`, from derivatives at the nodes."""
        by_states, by_theta = (x.reshape(-1, NODES, *x.shape[1:]) for x in (by_states, by_theta))
        return cls(nodes, group, by_states, by_theta, Factors.of(new, nodes.at.intervals))

    def add_to(self, arrow: Arrow) -> None:
        """Adds the rows to normal equations."""
        products, right = self._products
        width = WINDOW * self.by_states.shape[-1]
        for some in self._blocks():
            rows = self._rows(some)
            J, T, weighed_J, weighed_T = (
                x.reshape(len(x), -1, x.shape[-1])
                for own in (rows, products[some] @ rows)
                for x in (own[..., :width], own[..., width:])
            )
            arrow.add(some, (J, T), (weighed_J, weighed_T), right[some], self.group)

    def taken(self, posterior: Posterior) -> np.ndarray:
        """Absorbed degrees of freedom of innovations, and zeros for their halves (3, c)."""
        products, _ = self._products
        shares, root = np.zeros((3, self.by_theta.shape[2])), posterior.root[self.group.columns]
        for some in self._blocks():
            J, T = np.split(self._rows(some), [WINDOW * self.by_states.shape[-1]], axis=-1)
            k, C, nodes, width = J.shape
            flat = J.reshape(k, C * nodes, width)
            inverse, followed = posterior.of_coordinates(some, self.group.coordinates)
            # Effect of θ, the change of the trajectory with it included.
            F = (T @ root).reshape(k, C * nodes, -1) - flat @ followed
            F, K = (x.reshape(k, C, nodes, -1) for x in (F, flat @ inverse))
            covariance = K @ transposed(J) + F @ transposed(F)
            shares[0] += np.einsum("kcij,kcij->c", products[some], covariance)
        return shares

    def _blocks(self) -> Iterator[slice]:
        """Yields blocks of intervals."""
        S, nodes, C, _, n = self.by_states.shape
        size = max(1, TOGETHER // (8 * nodes * C * WINDOW * n))
        return (slice(start, min(start + size, S)) for start in range(0, S, size))

    def _rows(self, some: slice) -> np.ndarray:
        """Derivatives by the functions from the one before the interval's first, and by θ (k, C, NODES, 7 n + p)."""
        by_states, by_theta = self.by_states[some], self.by_theta[some]
        k, nodes, C, _, n = by_states.shape
        out = np.empty((k, C, nodes, WINDOW * n + by_theta.shape[-1]))
        out[..., :n] = 0
        by_functions = self.nodes.basis @ by_states.swapaxes(1, 2)
        out[..., n : WINDOW * n] = by_functions.reshape(k, C, nodes, -1)
        out[..., WINDOW * n :] = by_theta.swapaxes(1, 2)
        return out

    @cached_property
    def _products(self) -> tuple[np.ndarray, np.ndarray]:
        """Products of the weighted polynomials (S, C, NODES, NODES), and of these and the innovations (S, C NODES)."""
        L, scale, right = self.nodes.polynomials, self.factors.scale, self.factors.right
        weighted = [scale[:, :, c, None] * L for c in range(scale.shape[2])]
        products = np.stack([transposed(own) @ own for own in weighted], axis=1)
        return products, (transposed(L) @ (scale * right)).swapaxes(1, 2).reshape(len(L), -1)
