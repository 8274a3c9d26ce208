"""Symmetric block-tridiagonal matrices: Cholesky factor, solutions, and the blocks of the inverse near the diagonal.

    A = L Lᵀ:     L_kk L_kkᵀ = A_kk - C_k-1 C_k-1ᵀ,     C_k = A_k+1,k L_kk⁻ᵀ
    Σ = A⁻¹:      Σ_k+1,k = -Σ_k+1,k+1 G_kᵀ,            Σ_kk = (L_kk L_kkᵀ)⁻¹ + G_k Σ_k+1,k+1 G_kᵀ,    G_k = L_kk⁻ᵀ C_kᵀ

The second is the recursion of Takahashi, Fagan and Chen (1973); see Erisman and Tinney, Commun. ACM 18 (1975),
doi:10.1145/360680.360704. Rows that are local in time give such matrices: a window of seven spline functions, of n
coordinates each, lies in two blocks of six. Time and memory are linear in the number of blocks.

BLAS and LAPACK are column-major and numpy is row-major: they are given transposes, which need no copy.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack

from ident.trajectory.algebra.spline import LOCAL

WINDOW = LOCAL + 1
"""Spline functions that one sample and the one before it depend on."""


@dataclass(frozen=True, eq=False)
class BlockTridiagonal:
    """A symmetric matrix.

    Attributes:
        diagonal: Blocks A_kk (K, b, b).
        below: Blocks A_k+1,k (K - 1, b, b).
    """

    diagonal: np.ndarray
    below: np.ndarray

    @classmethod
    def of_windows(cls, windows: np.ndarray) -> "BlockTridiagonal":
        """Sum of matrices over windows of seven functions, each one function later than the one before.

        Functions in no window get ones on the diagonal.

        Args:
            windows: Matrix of each window (S, 7 n, 7 n).
        """
        n = windows.shape[1] // WINDOW
        blocks, size = -(-(len(windows) + LOCAL) // LOCAL), LOCAL * n
        pairs = np.zeros((blocks, 2 * size, 2 * size))
        for offset in range(LOCAL):
            own, inside = windows[offset::LOCAL], slice(offset * n, (offset + WINDOW) * n)
            pairs[: len(own), inside, inside] += own
        diagonal = pairs[:, :size, :size].copy()
        diagonal[1:] += pairs[:-1, size:, size:]
        untouched = np.einsum("kii->ki", diagonal) == 0
        np.einsum("kii->ki", diagonal)[untouched] = 1
        return cls(diagonal, pairs[:-1, size:, :size])

    def factored(self) -> "Factor":
        """The Cholesky factor.

        Raises:
            numpy.linalg.LinAlgError: The matrix is not positive definite.
        """
        factor, coupling = np.empty_like(self.diagonal), np.empty_like(self.below)
        for k, block in enumerate(self.diagonal):
            if k:
                block = block - coupling[k - 1] @ coupling[k - 1].T
            upper, failed = lapack.dpotrf(block.T)
            if failed:
                raise np.linalg.LinAlgError("The matrix is not positive definite.")
            factor[k] = upper.T
            if k < len(self.below):
                coupling[k] = blas.dtrsm(1, upper, self.below[k].T, trans_a=1).T
        return Factor(factor, coupling)


@dataclass(frozen=True, eq=False)
class Factor:
    """A Cholesky factor.

    Attributes:
        diagonal: Lower triangular blocks L_kk (K, b, b).
        below: Blocks C_k (K - 1, b, b).
    """

    diagonal: np.ndarray
    below: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """`A⁻¹ right` for right sides (K, b, p)."""
        return self.solve_transposed(self.solve_lower(right))

    def solve_lower(self, right: np.ndarray) -> np.ndarray:
        """`L⁻¹ right` for right sides (K, b, p)."""
        x = np.empty(right.shape)
        for k, L in enumerate(self.diagonal):
            rest = right[k] - self.below[k - 1] @ x[k - 1] if k else right[k]
            x[k] = blas.dtrsm(1, L.T, rest.T, side=1, overwrite_b=k > 0).T
        return x

    def solve_transposed(self, right: np.ndarray) -> np.ndarray:
        """`L⁻ᵀ right` for right sides (K, b, p)."""
        x = np.empty(right.shape)
        for k in reversed(range(len(x))):
            rest = right[k] - self.below[k].T @ x[k + 1] if k < len(self.below) else right[k]
            x[k] = blas.dtrsm(1, self.diagonal[k].T, rest.T, side=1, trans_a=1, overwrite_b=k < len(self.below)).T
        return x

    def inverse_windows(self, number: int) -> np.ndarray:
        """Blocks of the inverse for the windows of `BlockTridiagonal.of_windows` (number, 7 n, 7 n).

        The recursion is over blocks: one over single functions took half the time, but was wrong for 30 joints.
        """
        blocks, size = self.diagonal.shape[:2]
        pairs, above = np.zeros((blocks, 2 * size, 2 * size)), np.tri(size, k=-1, dtype=bool).T
        below = None
        for k in reversed(range(blocks)):
            own = lapack.dpotri(self.diagonal[k].T)[0].T
            np.copyto(own, own.T, where=above)
            if below is not None:
                G = blas.dtrsm(1, self.diagonal[k].T, self.below[k].T)
                beside = G @ below
                own += beside @ G.T
                pairs[k, size:, size:], pairs[k, :size, size:], pairs[k, size:, :size] = below, -beside, -beside.T
            pairs[k, :size, :size] = below = own
        n = size // LOCAL
        windows = np.empty((number, WINDOW * n, WINDOW * n))
        for offset in range(LOCAL):
            inside = slice(offset * n, (offset + WINDOW) * n)
            windows[offset::LOCAL] = pairs[: len(windows[offset::LOCAL]), inside, inside]
        return windows
