"""Normal equations of a trajectory and of θ: blocks along time, and a border.

    [A  B ] [δc]   [b]           A = L Lᵀ block tridiagonal
    [Bᵀ D ] [δθ] = [d]           (D - Bᵀ A⁻¹ B) δθ = d - Bᵀ A⁻¹ b,     δc = A⁻¹ b - A⁻¹ B δθ

Rows see a window of seven spline functions each, so that A and B are sums over windows.
"""

from math import prod
from typing import NamedTuple

import numpy as np

from ident.estimation.block_tridiagonal import WINDOW, BlockTridiagonal
from ident.estimation.spline import LOCAL, Spline
from ident.estimation.whitening import Rows


class Eliminated(NamedTuple):
    """Normal equations, the trajectory eliminated.

    Attributes:
        schur: Precision of θ, `D - Bᵀ A⁻¹ B` (p, p).
        gradient: Its right side, `d - Bᵀ A⁻¹ b` (p,).
        step: Step of the coefficients at fixed θ, `A⁻¹ b` (size n,).
        by_theta: How it changes with a step of θ, `A⁻¹ B` (size n, p).
        inverse: What every window sees of `A⁻¹` (S, 7, n, 7, n).
        windows: What every window sees of `A⁻¹ B` (S, 7, n, p).
    """

    schur: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    by_theta: np.ndarray
    inverse: np.ndarray
    windows: np.ndarray


class Arrow:
    """Normal equations that rows are added to.

    Attributes:
        spline: The space of the trajectory, of S intervals.
    """

    def __init__(self, spline: Spline, coordinates: int, parameters: int) -> None:
        intervals, n, p = spline.intervals, coordinates, parameters
        self.spline = spline
        self._normal = np.zeros((intervals, WINDOW, n, WINDOW, n))
        self._border = np.zeros((intervals, WINDOW, n, p))
        self._right = np.zeros((intervals, WINDOW, n))
        self._corner, self._below = np.zeros((p, p)), np.zeros(p)

    def add(self, rows: Rows) -> None:
        """Adds rows that see all coordinates; r is p."""
        J, T, e = (_joined(x) for x in (rows.windows, rows.border, rows.right[..., None]))
        Jt = transposed(J)
        self._normal += (Jt @ J).reshape(self._normal.shape)
        self._border += (Jt @ T).reshape(self._border.shape)
        self._right += (Jt @ e).reshape(self._right.shape)
        self._add_corner(rows)

    def add_separate(self, rows: Rows) -> None:
        """Adds rows whose streams see one coordinate each, in their order."""
        for j in range(self._right.shape[2]):
            J, T, e = rows.windows[:, :, j], rows.border[:, :, j], rows.right[:, :, j, None]
            Jt = transposed(J)
            self._normal[:, :, j, :, j] += Jt @ J
            self._border[:, :, j, rows.columns] += Jt @ T
            self._right[:, :, j] += (Jt @ e)[..., 0]
        self._add_corner(rows)

    def _add_corner(self, rows: Rows) -> None:
        T = stacked(rows.border)
        self._corner[np.ix_(rows.columns, rows.columns)] += T.T @ T
        self._below[rows.columns] += T.T @ rows.right.ravel()

    def add_penalty(self, jerk: np.ndarray, coefficients: np.ndarray) -> None:
        """Adds the prior `Σ_j λ_j ∫ x⃛_j² dt` with λ (n,) at coefficients (size, n)."""
        P = self.spline.penalty
        for j, weight in enumerate(jerk):
            self._normal[:, 1:, j, 1:, j] += weight * P
        self._right[:, 1:] -= jerk * (P @ self.spline.windows(coefficients))

    def eliminated(self) -> Eliminated:
        """The trajectory eliminated.

        Raises:
            numpy.linalg.LinAlgError: Rows and prior together do not determine it.
        """
        intervals, _, n = self._right.shape
        factor = BlockTridiagonal.of_windows(self._normal.reshape(intervals, WINDOW * n, WINDOW * n)).factored()
        blocks = len(factor.diagonal)
        B, b = _summed(self._border, blocks), _summed(self._right[..., None], blocks)
        W = factor.solve(B)
        by_theta = stacked(W)
        schur = self._corner - stacked(B).T @ by_theta
        # Functions that no window sees are the first of all, and those that fill the last block.
        own = slice(n, n + self.spline.size * n)
        seen = np.lib.stride_tricks.sliding_window_view(by_theta, WINDOW * n, axis=0)[: intervals * n : n]
        return Eliminated(
            schur=(schur + schur.T) / 2,
            gradient=self._below - by_theta.T @ b.ravel(),
            step=factor.solve(b).ravel()[own],
            by_theta=by_theta[own],
            inverse=factor.inverse_windows(intervals).reshape(self._normal.shape),
            windows=transposed(seen).reshape(self._border.shape),
        )


def transposed(x: np.ndarray) -> np.ndarray:
    """Matrices transposed (…, a, b) -> (…, b, a)."""
    return np.swapaxes(x, -1, -2)


def stacked(x: np.ndarray) -> np.ndarray:
    """Rows of any shape below each other (…, p) -> (N, p)."""
    return x.reshape(prod(x.shape[:-1]), x.shape[-1])


def _joined(x: np.ndarray) -> np.ndarray:
    """Rows of all streams of an interval, one after the other (S, m, s, …) -> (S, m s, …)."""
    return x.reshape(x.shape[0], x.shape[1] * x.shape[2], *x.shape[3:])


def _summed(windows: np.ndarray, blocks: int) -> np.ndarray:
    """Sums over overlapping windows (S, 7, n, p), in blocks (K, 6 n, p)."""
    intervals, _, n, p = windows.shape
    out = np.zeros((blocks * LOCAL, n, p))
    for k in range(WINDOW):
        out[k : k + intervals] += windows[:, k]
    return out.reshape(blocks, LOCAL * n, p)
