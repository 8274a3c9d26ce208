"""Regrouping of large mechanisms body by body along the tree, instead of with one dense matrix.

With the composite bodies `z_k = φ_k + Σ_c E_c z_c` as variables, c the bodies next to k, the rows of a `Structure` act
on one body each: `K_k z_k = 0`. So combinations without effect are, for each vector n of the kernel of K_k,

    φ_k = n,    φ_p = -E_k n    on the next body p towards the base,    φ = 0    on all others.

A body's parameters that depend on those before them are those that do so in K_k alone, and what n shifts to p is
regrouped there, from the leaves to the base (as by Gautier and Khalil, IEEE Trans. Robotics and Automation 6, 1990).
Bodies next to a massless link with rows of its own share these rows: they are eliminated as one group.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.parameters.independent_columns import COEFFICIENTS, DEPENDENT, NEGLIGIBLE
from ident.parameters.structure import Structure
from ident.parameters.tree_groups import CLEAR, BodyGroup, groups

FEW = 30
"""Rows up to which all singular values are computed."""


@dataclass(frozen=True, eq=False)
class Elimination:
    """Unit-norm columns of a structure's matrix, eliminated along its tree.

    Attributes:
        parts: Groups of bodies.
        norms: Norms of the columns (P,).
        kept: Indices of the first independent columns (r,).
        others: Indices of the other columns (P - r,).
    """

    parts: Sequence[BodyGroup]
    norms: np.ndarray
    kept: np.ndarray
    others: np.ndarray

    @cached_property
    def clear(self) -> bool:
        """True if the rank is beyond doubt."""
        # The largest singular value is below the square root of the number of columns.
        least = CLEAR[0] * np.sqrt(len(self.norms))
        return len(self.kept) > 0 and all(part.clear for part in self.parts) and self.least > least

    @cached_property
    def least(self) -> float:
        """Smallest singular value of the columns that is not zero."""
        return least_singular_value(self.parts, len(self.norms))

    @cached_property
    def coefficients(self) -> np.ndarray | None:
        """Coefficients of the other columns in terms of the first independent ones (r, P - r).

        None if they are so large that other columns may have to be kept, which only the whole matrix shows.
        """
        if any(part.passed for part in self.parts):
            return None
        made = _coefficients(self.parts, self.others, len(self.norms))[self.kept]
        if not abs(made).max(initial=0) <= min(COEFFICIENTS):
            return None
        return _without_rounding(made, self.parts, self.kept)


def elimination(structure: Structure) -> Elimination:
    """A structure eliminated along its tree."""
    parts, norms = groups(structure)
    kept, others = (np.sort(np.concatenate([g.columns[getattr(g, key)] for g in parts])) for key in ("kept", "others"))
    return Elimination(parts, norms, kept, others)


def _coefficients(parts: Sequence[BodyGroup], others: np.ndarray, size: int) -> np.ndarray:
    """Coefficients of the other columns in terms of the first independent ones, zero for themselves (P, P - r)."""
    out = np.zeros((size, len(others)))
    place = dict(zip(others.tolist(), range(len(others)), strict=True))
    beyond: dict[int, list[int]] = {}
    with np.errstate(over="ignore", invalid="ignore"):
        for part in reversed(parts):
            kept, dependent = part.columns[part.kept], part.columns[part.others]
            own = [place[k] for k in dependent.tolist()]
            out[dependent, own] = 1
            moved = [*own, *(k for body in set(part.columns // 10) for k in beyond.get(int(body), []))]
            shares = out[np.ix_(dependent, moved)]
            out[np.ix_(kept, moved)] += part.made @ shares
            out[np.ix_(part.below, moved)] += part.shift @ part.kernel @ shares
            out[np.ix_(dependent, moved)] = 0
            if len(part.below):
                beyond.setdefault(int(part.below[0]) // 10, []).extend(moved)
    return out


def _without_rounding(made: np.ndarray, parts: Sequence[BodyGroup], kept: np.ndarray) -> np.ndarray:
    """Coefficients (r, P - r), zero where they are only rounding errors, as in `independent_columns.coefficients`."""
    small = (abs(made) < DEPENDENT) & (made != 0)
    some = np.flatnonzero(small.any(axis=0))
    left_out = np.zeros((sum(made.shape), len(some)))
    left_out[kept] = np.where(small, made, 0)[:, some]
    for part in reversed(parts):
        left_out[part.below] += part.shift @ left_out[part.columns]
    effect = np.sqrt(sum(((part.rows @ left_out[part.columns]) ** 2).sum(axis=0) for part in parts))
    out = made.copy()
    out[:, some] = np.where(small[:, some] & (effect < NEGLIGIBLE), 0, made[:, some])
    return out


def least_singular_value(parts: Sequence[BodyGroup], size: int) -> float:
    """Smallest singular value of the unit-norm columns that is not zero: 1 / ‖A⁺‖ for the columns A.

    A⁺ solves for the composites, then for φ, and subtracts what has no effect.
    """
    # Few mechanisms are so large that sparse solvers are worth their import.
    from scipy import sparse
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    columns = np.concatenate([group.columns for group in parts])
    order = sparse.csr_array((np.ones(size), (columns, np.arange(size))), shape=(size, size))
    at = [np.meshgrid(group.below, group.columns, indexing="ij") for group in parts]
    places = tuple(np.concatenate([pair[k].ravel() for pair in at]) for k in (0, 1))
    shifts = sparse.csr_array((np.concatenate([g.shift.ravel() for g in parts]), places), shape=(size, size))
    own = sparse.eye_array(size, format="csr") - shifts
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
