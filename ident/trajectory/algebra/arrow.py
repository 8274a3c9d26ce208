"""Normal equations of a trajectory and of θ: block tridiagonal in time, with a border.

    [A  B ] [δc]   [b]           A = L Lᵀ block tridiagonal
    [Bᵀ D ] [δθ] = [d]           (D - Bᵀ A⁻¹ B) δθ = d - Bᵀ A⁻¹ b,     δc = A⁻¹ b - A⁻¹ B δθ

Each row depends on a window of seven spline functions, so that A and B are sums over windows.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import NamedTuple

import numpy as np

from ident.trajectory.algebra.block_tridiagonal import WINDOW, BlockTridiagonal, Factor
from ident.trajectory.algebra.spline import LOCAL, Spline


class Eliminated(NamedTuple):
    """Normal equations of θ with the trajectory eliminated.

    Attributes:
        schur: Precision of θ, `D - Bᵀ A⁻¹ B` (p, p).
        gradient: Right side, `d - Bᵀ A⁻¹ b` (p,).
        step: Step of the coefficients at fixed θ, `A⁻¹ b` (size n,).
        by_theta: Decrease of that step by a step of θ, `A⁻¹ B` (size n, p).
        factor: Cholesky factor of A.
    """

    schur: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    by_theta: np.ndarray
    factor: Factor


@dataclass(frozen=True, eq=False)
class Posterior:
    """Covariance of each window's coefficients and of θ: `A⁻¹ + W Σ Wᵀ`, `-W Σ` and Σ with `W = A⁻¹ B`.

    Attributes:
        inverse: Blocks of `A⁻¹` for every window (S, 7 n, 7 n).
        followed: Rows of `W √Σ` for every window (S, 7 n, q).
        root: A root of the covariance of θ, `√Σ √Σᵀ = Σ` (p, q).
    """

    inverse: np.ndarray
    followed: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, eliminated: Eliminated, root: np.ndarray, intervals: int, coordinates: int) -> "Posterior":
        """Posterior of normal equations, from a root of the covariance of θ (p, q)."""
        n, width = coordinates, WINDOW * coordinates
        # The first interval's window begins with a function that does not exist.
        followed = np.vstack([np.zeros((n, root.shape[1])), eliminated.by_theta @ root])
        windows = np.lib.stride_tricks.sliding_window_view(followed, width, axis=0)[: intervals * n : n]
        return cls(eliminated.factor.inverse_windows(intervals), transposed(windows), root)

    @cached_property
    def by_coordinate(self) -> np.ndarray:
        """Covariance of the seven coefficients of every coordinate (S, n, 7, 7)."""
        S, width, _ = self.inverse.shape
        n = width // WINDOW
        followed = self.followed.reshape(S, WINDOW, n, -1).swapaxes(1, 2)
        own = np.einsum("sujvj->sjuv", self.inverse.reshape(S, WINDOW, n, WINDOW, n))
        return own + followed @ transposed(followed)

    def followed_of(self, coordinate: int) -> np.ndarray:
        """Rows of `W √Σ` of one coordinate for every window (S, 7, q)."""
        n = self.inverse.shape[1] // WINDOW
        return self.followed[:, coordinate::n]


class Arrow:
    """Normal equations to which rows are added.

    Attributes:
        spline: Spline space of the trajectory, of S intervals.
    """

    def __init__(self, spline: Spline, coordinates: int, parameters: int) -> None:
        intervals, n, p = spline.intervals, coordinates, parameters
        self.spline = spline
        self._normal = np.zeros((intervals, WINDOW, n, WINDOW, n))
        self._border = np.zeros((intervals, WINDOW, n, p))
        self._right = np.zeros((intervals, WINDOW, n))
        self._corner, self._below = np.zeros((p, p)), np.zeros(p)

    def add(self, some: slice, J: np.ndarray, T: np.ndarray, right: np.ndarray) -> None:
        """Adds rows that depend on all coordinates and all of θ.

        Args:
            some: The k intervals of the rows.
            J: Derivatives by the functions of their windows (k, r, 7 n).
            T: Derivatives by θ (k, r, p).
            right: Right sides (k, r).
        """
        Jt = transposed(J)
        for total, by in ((self._normal, J), (self._border, T), (self._right, right[..., None])):
            own = total[some]
            own += (Jt @ by).reshape(own.shape)
        T = stacked(T)
        self._corner += T.T @ T
        self._below += T.T @ right.ravel()

    def add_products(self, some: slice, rows: np.ndarray, weighed: np.ndarray, right: np.ndarray, width: int) -> None:
        """Adds rows X with a matrix of weights W, as `Xᵀ W X` and `Xᵀ W y`.

        Args:
            some: The k intervals of the rows.
            rows: X, derivatives by the functions of their windows and by θ (k, r, 7 n + p).
            weighed: W X (k, r, 7 n + p).
            right: W y (k, r).
            width: 7 n.
        """
        J, T = rows[..., :width], stacked(rows[..., width:])
        by_functions = transposed(J) @ weighed
        parts = by_functions[..., :width], by_functions[..., width:], transposed(J) @ right[..., None]
        for total, by in zip((self._normal, self._border, self._right), parts, strict=True):
            own = total[some]
            own += by.reshape(own.shape)
        self._corner += T.T @ stacked(weighed[..., width:])
        self._below += T.T @ right.ravel()

    def add_separate(self, J: np.ndarray, T: np.ndarray, right: np.ndarray, columns: Mapping[int, int]) -> None:
        """Adds rows of streams that depend on one coordinate each, in order, and some of them on one entry of θ.

        Args:
            J: Derivatives by the functions of the coordinate's window (S, m, n, 7).
            T: Derivatives by the entry of θ (S, m, n).
            right: Right sides (S, m, n).
            columns: Index of the entry in θ by coordinate.
        """
        for j in range(J.shape[2]):
            own, y = J[:, :, j], right[:, :, j]
            Jt = transposed(own)
            self._normal[:, :, j, :, j] += Jt @ own
            self._right[:, :, j] += (Jt @ y[..., None])[..., 0]
            if j in columns:
                at, t = columns[j], T[:, :, j]
                self._border[:, :, j, at] += (Jt @ t[..., None])[..., 0]
                self._corner[at, at] += (t**2).sum()
                self._below[at] += (t * y).sum()

    def add_penalty(self, jerk: np.ndarray, coefficients: np.ndarray) -> None:
        """Adds the prior `Σ_j λ_j ∫ x⃛_j² dt` with λ (n,) at coefficients (size, n)."""
        P = self.spline.penalty
        for j, weight in enumerate(jerk):
            self._normal[:, 1:, j, 1:, j] += weight * P
        self._right[:, 1:] -= jerk * (P @ self.spline.windows(coefficients))

    def eliminated(self) -> Eliminated:
        """Normal equations of θ with the trajectory eliminated.

        Raises:
            numpy.linalg.LinAlgError: Rows and prior together do not determine the trajectory.
        """
        intervals, _, n = self._right.shape
        factor = BlockTridiagonal.of_windows(self._normal.reshape(intervals, WINDOW * n, WINDOW * n)).factored()
        blocks = len(factor.diagonal)
        B, b = _summed(self._border, blocks), _summed(self._right[..., None], blocks)
        W = factor.solve(B)
        by_theta = stacked(W)
        schur = self._corner - stacked(B).T @ by_theta
        # The first function and those that pad the last block belong to no window.
        own = slice(n, n + self.spline.size * n)
        return Eliminated(
            schur=(schur + schur.T) / 2,
            gradient=self._below - by_theta.T @ b.ravel(),
            step=factor.solve(b).ravel()[own],
            by_theta=by_theta[own],
            factor=factor,
        )


def transposed(x: np.ndarray) -> np.ndarray:
    """Matrices transposed (…, a, b) -> (…, b, a)."""
    return np.swapaxes(x, -1, -2)


def stacked(x: np.ndarray) -> np.ndarray:
    """Rows of any shape stacked (…, p) -> (N, p)."""
    return x.reshape(prod(x.shape[:-1]), x.shape[-1])


def _summed(windows: np.ndarray, blocks: int) -> np.ndarray:
    """Sums over overlapping windows (S, 7, n, p), in blocks (K, 6 n, p)."""
    intervals, _, n, p = windows.shape
    out = np.zeros((blocks * LOCAL, n, p))
    for k in range(WINDOW):
        out[k : k + intervals] += windows[:, k]
    return out.reshape(blocks, LOCAL * n, p)
