"""Smallest singular value of a structure's unit-norm columns, by sparse matrices along its tree."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from ident.parameters.tree_groups import BodyGroup

FEW = 30
"""Rows up to which all singular values are computed."""


def least_singular_value(parts: Sequence[BodyGroup], size: int) -> float:
    """Smallest singular value of the unit-norm columns that is not zero: 1 / ‖A⁺‖ for the columns A.

    A⁺ solves for the composites, then for φ, and subtracts what has no effect.
    """
    columns = np.concatenate([group.columns for group in parts])
    order = sparse.csr_array((np.ones(size), (columns, np.arange(size))), shape=(size, size))
    own = sparse.eye_array(size, format="csr") - _shifts(parts, size)
    solved = (own @ order @ sparse.block_diag([group.inverse for group in parts], format="csr")).tocsr()
    kernel = (own @ order @ sparse.block_diag([group.kernel for group in parts], format="csr")).tocsr()
    gram = splu((kernel.T @ kernel).tocsc()) if kernel.shape[1] else None

    def squared(x: np.ndarray) -> np.ndarray:
        y = solved @ x
        return solved.T @ (y if gram is None else y - kernel @ gram.solve(kernel.T @ y))

    rows = solved.shape[1]
    if rows <= FEW:
        return float(np.linalg.eigvalsh(squared(np.eye(rows)))[-1] ** -0.5)
    start = np.random.default_rng(0).normal(size=rows)
    operator = LinearOperator((rows, rows), matvec=squared, dtype=float)
    return float(eigsh(operator, k=1, v0=start, return_eigenvectors=False)[0] ** -0.5)


def _shifts(parts: Sequence[BodyGroup], size: int) -> sparse.csr_array:
    """Composites due to those of the next bodies (P, P)."""
    at = [np.meshgrid(group.below, group.columns, indexing="ij") for group in parts]
    rows, columns = (np.concatenate([pair[k].ravel() for pair in at]) for k in (0, 1))
    return sparse.csr_array((np.concatenate([g.shift.ravel() for g in parts]), (rows, columns)), shape=(size, size))
