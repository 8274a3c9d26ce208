"""Channels evaluated at a few nodes of every knot interval instead of at every sample.

Within an interval the trajectory is a polynomial, and a channel is a smooth function of it. The polynomial through its
values at Gauss nodes equals it to 1e-8 or better as long as joints turn little, and so do its derivatives by
coefficients and θ:

    y_k = Σ_i L_ki y(t_i),     Σ_k s_k² x_k x_kᵀ = Σ_ij X_i M_ij X_jᵀ,     M = Σ_k s_k² L_k L_kᵀ

with Lagrange's polynomials in barycentric form (Berrut and Trefethen, SIAM Review 46, 2004,
doi:10.1137/S0036144502417715).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from ident.trajectory.algebra.arrow import Arrow, Posterior, transposed
from ident.trajectory.algebra.banded import WINDOW
from ident.trajectory.algebra.groups import Group
from ident.trajectory.algebra.rows import TOGETHER, Factors
from ident.trajectory.algebra.sampling import Sampling
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.algebra.whitening import Innovations

NODES = 14
"""Number of nodes of an interval: with fewer, rounding is exceeded where knots are as far apart as they may be."""

WORTH_IT = 1.5
"""Samples of an interval, over its nodes, from which evaluation at nodes is faster."""

TURNED = 3.0
"""Largest angle by which a body turns within an interval, by all joints together, rad. Channels have sines of twice it:
that of six radians is interpolated to 1e-8, of ten to 2e-5 only."""

_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2
_WEIGHTS = 1 / np.prod(_PLACES[:, None] - _PLACES + np.eye(NODES), axis=1)


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
