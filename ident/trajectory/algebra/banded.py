"""Symmetric matrices that are banded in time: Cholesky factor, solutions, and the inverse near the diagonal.

    A = Uᵀ U:     solved from block to block of a few functions, U_k their own block, C_k those that follow beside it
    Σ = A⁻¹:      Σ_k,rest = -G_k Σ_rest,rest,     Σ_kk = (U_kᵀ U_k)⁻¹ + G_k Σ_rest,rest G_kᵀ,     G_k = U_k⁻¹ C_k

The second is the recursion of Takahashi, Fagan and Chen (1973); see Erisman and Tinney, Commun. ACM 18 (1975),
doi:10.1145/360680.360704. Rows that are local in time give such matrices: they depend on windows of spline functions,
of n coordinates each. Time and memory are linear in the number of functions.

BLAS and LAPACK are column-major and numpy is row-major: they are given transposes, which need no copy.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import blas, lapack

from ident.trajectory.algebra.spline import LOCAL

WINDOW = LOCAL + 1
"""Spline functions that one sample and the one before it depend on."""

WIDE = 36
"""Least rows of a block that is solved at once, of six functions at most: smaller ones take longer to call than to
compute, larger ones compute with zeros."""


class Banded:
    """A symmetric matrix to which windows are added.

    Attributes:
        rows: Products of each function and of those that follow within a window (functions, n, w, n).
    """

    def __init__(self, functions: int, coordinates: int, width: int) -> None:
        """Begins with zeros; windows are of `width` functions."""
        self.rows = np.zeros((functions, coordinates, width, coordinates))

    def add(self, first: int, windows: np.ndarray, coordinates: np.ndarray) -> None:
        """Adds products of some coordinates (k, w, c, w, c), of windows that begin at adjacent functions."""
        k, width = windows.shape[:2]
        for u in range(width):
            total = self.rows[first + u : first + u + k]
            for own, at in runs(coordinates):
                for others, at_others in runs(coordinates):
                    total[:, at, : width - u, at_others] += windows[:, u, own, u:, others]

    def add_separate(self, first: int, windows: np.ndarray) -> None:
        """Adds products within every coordinate (k, v, v, n), or (1, v, v, n) for as many windows as there are."""
        own, size = np.einsum("kjwj->kwj", self.rows), windows.shape[1]
        k = len(own) - first - size + 1
        for u in range(size):
            own[first + u : first + u + k, : size - u] += windows[:, u, u:]

    def factored(self) -> "Factor":
        """The Cholesky factor; functions in no window get ones on the diagonal.

        Raises:
            numpy.linalg.LinAlgError: The matrix is not positive definite.
        """
        functions, n, width, _ = self.rows.shape
        reach, rows = width * n, self.rows.reshape(functions, n, -1)
        band = np.zeros((functions, n, reach))
        for i in range(n):
            band[:, i, : reach - i] = rows[:, i, i:]
        band[:, :, 0][band[:, :, 0] == 0] = 1
        factor, failed = lapack.dpbtrf(band.reshape(-1, reach).T, lower=1, overwrite_ab=1)
        if failed:
            raise np.linalg.LinAlgError("The matrix is not positive definite.")
        return Factor(factor.T.reshape(band.shape))


@dataclass(frozen=True, eq=False)
class Factor:
    """A Cholesky factor.

    Attributes:
        band: Entries of each row of U from the diagonal on (functions, n, w n).
    """

    band: np.ndarray

    def _blocks(self, together: int) -> tuple[np.ndarray, np.ndarray]:
        """Blocks U_k of some functions (K, b, b), the last one filled with ones, and C_k beside them (K, b, m)."""
        functions, n, reach = self.band.shape
        count, size = -(-functions // together), together * n
        upper = np.zeros((count, size, size - n + reach))
        upper[-1, range(size), range(size)] = 1
        for u in range(together):
            own = self.band[u::together]
            for i in range(n):
                upper[: len(own), u * n + i, u * n + i : u * n + reach] = own[:, i, : reach - i]
        return upper[:, :, :size].copy(), upper[:, :, size:].copy()

    @cached_property
    def _solving(self) -> tuple[np.ndarray, np.ndarray]:
        """Blocks by which equations are solved."""
        return self._blocks(min(max(-(-WIDE // self.band.shape[1]), 1), LOCAL))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """`A⁻¹ right` for right sides (functions n, p)."""
        return self.solve_upper(self.solve_lower(right))

    def solve_lower(self, right: np.ndarray) -> np.ndarray:
        """`U⁻ᵀ right` for right sides (functions n, p)."""
        x, b = self._extended(right), self._solving[0].shape[1]
        for k, (own, beside) in enumerate(zip(*self._solving, strict=True)):
            here = x[k * b : (k + 1) * b]
            here[:] = blas.dtrsm(1, own.T, here.T, side=1, lower=1, trans_a=1).T
            x[(k + 1) * b : (k + 1) * b + beside.shape[1]] -= beside.T @ here
        return x[: len(right)]

    def solve_upper(self, right: np.ndarray) -> np.ndarray:
        """`U⁻¹ right` for right sides (functions n, p)."""
        x, (blocks, others) = self._extended(right), self._solving
        b, m = others.shape[1:]
        for k in reversed(range(len(blocks))):
            rest = x[k * b : (k + 1) * b] - others[k] @ x[(k + 1) * b : (k + 1) * b + m]
            x[k * b : (k + 1) * b] = blas.dtrsm(1, blocks[k].T, rest.T, side=1, lower=1, overwrite_b=1).T
        return x[: len(right)]

    def _extended(self, right: np.ndarray) -> np.ndarray:
        """Right sides with zeros for all that the last block has beside it."""
        blocks, b, m = self._solving[1].shape
        out = np.zeros((blocks * b + m, right.shape[1]))
        out[: len(right)] = right
        return out

    def inverse_windows(self, number: int) -> np.ndarray:
        """Blocks of the inverse for windows of seven functions (number, 7 n, 7 n), zero where the band is narrower.

        The recursion is over six functions: over fewer it loses all digits where the matrix is ill-conditioned, as with
        coordinates at rest.
        """
        blocks, others = self._blocks(LOCAL)
        (count, b, m), n = others.shape, self.band.shape[1]
        windows, whole = np.zeros((number, WINDOW * n, WINDOW * n)), np.zeros((b + m, b + m))
        first = WINDOW - 1 - m // n
        inside = slice(first * n, None)
        for k in reversed(range(count)):
            # Products with an inverse are faster than triangular solutions where coordinates are few.
            own = lapack.dtrtri(blocks[k].T, lower=1)[0].T
            negative = blas.dtrmm(-1, own.T, others[k].T, side=1, lower=1).T
            whole[b:, b:] = whole[:m, :m]
            across = np.matmul(negative, whole[b:, b:], out=whole[:b, b:])
            whole[b:, :b] = across.T
            np.add(own @ own.T, across @ negative.T, out=whole[:b, :b])
            for u in range(b // n):
                if 0 <= (at := k * (b // n) + u - first) < number:
                    windows[at, inside, inside] = whole[u * n : u * n + m + n, u * n : u * n + m + n]
        return windows


def runs(indices: np.ndarray) -> list[tuple[slice, slice]]:
    """Runs of adjacent ones among ascending indices: their positions, and the indices."""
    if len(indices) and indices[-1] - indices[0] < len(indices):
        return [(slice(0, len(indices)), slice(int(indices[0]), int(indices[-1]) + 1))]
    ends = [0, *(np.flatnonzero(np.diff(indices) > 1) + 1).tolist(), len(indices)]
    first = indices.tolist()
    return [(slice(a, b), slice(first[a], first[b - 1] + 1)) for a, b in pairwise(ends) if b > a]
