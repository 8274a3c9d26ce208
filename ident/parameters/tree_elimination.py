"""Regrouping of large mechanisms body by body along the tree, instead of with one dense matrix.

With the composite bodies `z_k = φ_k + Σ_c E_c z_c` as variables, c the bodies next to k, `φ = (1 - S) z` with a sparse
S of all E_c. The rows of a `Structure` act on one body each: `A = R (1 - S)⁻¹` with blocks K_k in R. So combinations
without effect are, for each vector n of the kernel of K_k,

    φ_k = n,    φ_p = -E_k n    on the next body p towards the base,    φ = 0    on all others.

A body's parameters that depend on those before them are those that do so in K_k alone, and what n shifts to p is
regrouped there (as by Gautier and Khalil, IEEE Trans. Robotics and Automation 6, 1990). Bodies next to a massless link
with rows of its own share these rows: they are eliminated as one group.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu

from ident.mechanism.body import BASE
from ident.parameters import independent_columns
from ident.parameters.structure import Structure

CLEAR = 1e-6, 1e-12
"""Singular values, relative to the largest, above which they count and below which they are zero beyond doubt."""

FEW = 30
"""Rows up to which all singular values are computed."""


@dataclass(frozen=True, eq=False)
class Elimination:
    """Unit-norm columns A of a structure's matrix, eliminated along its tree.

    Attributes:
        norms: Norms of the columns (P,).
        kept: Indices of the first independent columns (r,).
        others: Indices of the other columns (P - r,).
        rows: Rows R on the composites (m, P).
        inverse: Their pseudo-inverse (P, m).
        kernel: Composites without effect on them, one for each of the other columns (P, P - r).
        steps: `1 - S`, φ from the composites (P, P).
        distinct: True if the rank of every group is beyond doubt.
        passed: True if a column that is nearly dependent was passed over.
    """

    norms: np.ndarray
    kept: np.ndarray
    others: np.ndarray
    rows: sparse.csr_array
    inverse: sparse.csr_array
    kernel: sparse.csr_array
    steps: sparse.csr_array
    distinct: bool
    passed: bool

    @cached_property
    def clear(self) -> bool:
        """True if the rank is beyond doubt."""
        # The largest singular value is below the square root of the number of columns.
        return len(self.kept) > 0 and self.distinct and self.gap[0] > CLEAR[0] * np.sqrt(len(self.norms))

    @cached_property
    def gap(self) -> tuple[float, float]:
        """Smallest singular value of A that counts, `1 / ‖A⁺‖`, and the largest taken for zero.

        A⁺ solves for the composites, then for φ, and subtracts what has no effect.
        """
        solved, kernel = (self.steps @ x for x in (self.inverse, self.kernel))
        gram = splu((kernel.T @ kernel).tocsc()) if kernel.shape[1] else None

        def squared(x: np.ndarray) -> np.ndarray:
            y = solved @ x
            return solved.T @ (y if gram is None else y - kernel @ gram.solve(kernel.T @ y))

        rows = solved.shape[1]
        if rows <= FEW:
            return float(np.linalg.eigvalsh(squared(np.eye(rows)))[-1] ** -0.5), 0.0
        start = np.random.default_rng(0).normal(size=rows)
        operator = LinearOperator((rows, rows), matvec=squared, dtype=float)
        return float(eigsh(operator, k=1, v0=start, return_eigenvectors=False)[0] ** -0.5), 0.0

    @cached_property
    def coefficients(self) -> np.ndarray | None:
        """Coefficients of the other columns in terms of the first independent ones (r, P - r).

        None if they are so large that other columns may have to be kept, which only the whole matrix shows.
        """
        if self.passed:
            return None
        without_effect = self.steps @ self.kernel
        kept, others = without_effect[self.kept].toarray(), without_effect[self.others]
        with np.errstate(over="ignore", invalid="ignore"):
            made = -_triangular(others.T).solve(kept.T).T
        if not abs(made).max(initial=0) <= min(independent_columns.COEFFICIENTS):
            return None
        return self._without_rounding(made)

    def _without_rounding(self, made: np.ndarray) -> np.ndarray:
        """Coefficients (r, P - r), zero where they are rounding errors, as in `independent_columns.coefficients`."""
        small = (abs(made) < independent_columns.DEPENDENT) & (made != 0)
        some = np.flatnonzero(small.any(axis=0))
        left_out = np.zeros((len(self.norms), len(some)))
        left_out[self.kept] = np.where(small, made, 0)[:, some]
        effect = np.linalg.norm(self.rows @ _triangular(self.steps).solve(left_out), axis=0)
        out = made.copy()
        out[:, some] = np.where(small[:, some] & (effect < independent_columns.NEGLIGIBLE), 0, made[:, some])
        return out


def _triangular(matrix: sparse.csr_array) -> SuperLU:
    """Factors of a matrix that is triangular, with ones on its diagonal."""
    return splu(matrix.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)


def elimination(structure: Structure) -> Elimination:
    """A structure eliminated along its tree."""
    norms, nonzero = independent_columns.bounded_norms(_norms(structure))
    unit, places = 1 / np.where(nonzero, norms, np.inf), np.arange(len(norms)).reshape(-1, 10)
    below, shifts, near = _composites(structure)
    columns, parts = list[np.ndarray](), list[_Group]()
    for bodies, rows in _rows_by_bodies(structure, near):
        columns.append(places[bodies].ravel())
        parts.append(_Group.of(rows * unit[columns[-1]]))
    has_next = np.array([k >= 0 for k in below])
    blocks = np.array(shifts)[has_next].swapaxes(1, 2), np.array(below)[has_next], np.cumsum([0, *has_next])
    shift = sparse.diags_array(norms) @ sparse.bsr_array(blocks, shape=2 * norms.shape).T @ sparse.diags_array(unit)
    order = np.argsort(np.concatenate(columns))
    rows, inverse, kernel = (
        sparse.block_diag(x, format="csr") for x in zip(*(part[:3] for part in parts), strict=True)
    )
    kept = np.concatenate([own[part.kept] for own, part in zip(columns, parts, strict=True)])
    others = np.concatenate([np.delete(own, part.kept) for own, part in zip(columns, parts, strict=True)])
    return Elimination(
        norms=norms,
        kept=np.sort(kept),
        others=np.sort(others),
        rows=rows[:, order],
        inverse=inverse[order],
        kernel=kernel[order][:, np.argsort(others)],
        steps=sparse.eye_array(len(norms), format="csr") - shift.tocsr(),
        distinct=all(part.distinct for part in parts),
        passed=any(part.passed for part in parts),
    )


class _Group(NamedTuple):
    """Rows on the k columns of a group of bodies, and what follows from them.

    Attributes:
        rows: The rows (m, k).
        inverse: Their pseudo-inverse (k, m).
        kernel: Combinations without effect, one for each of the other columns (k, k - r).
        kept: Indices of the first independent columns (r,).
        distinct: False if the rank is in doubt.
        passed: True if a column that is nearly dependent was passed over.
    """

    rows: np.ndarray
    inverse: np.ndarray
    kernel: np.ndarray
    kept: list[int]
    distinct: bool
    passed: bool

    @classmethod
    def of(cls, rows: np.ndarray) -> "_Group":
        width = rows.shape[1]
        if not rows.any():
            return cls(rows, np.zeros((width, len(rows))), np.eye(width), [], True, False)
        u, s, vt = np.linalg.svd(rows, full_matrices=False)
        rank = independent_columns.numerical_rank(s)
        rounding = float(s[rank]) if rank < len(s) else 0.0
        kept, passed = independent_columns.first_independent(rows, rank, rounding)
        others = [k for k in range(width) if k not in kept]
        kernel = np.zeros((width, len(others)))
        kernel[kept], kernel[others] = (
            -independent_columns.coefficients(rows[:, kept], rows[:, others]),
            np.eye(len(others)),
        )
        distinct = s[rank - 1] > CLEAR[0] * s[0] and rounding <= CLEAR[1] * s[0]
        return cls(rows, (vt[:rank].T / s[:rank]) @ u[:, :rank].T, kernel, kept, bool(distinct), bool(passed))


def _rows_by_bodies(
    structure: Structure, near: dict[int, dict[int, np.ndarray]]
) -> Iterator[tuple[list[int], np.ndarray]]:
    """Groups of bodies that share rows, and these rows; `near` as by `_composites`."""
    acting = [(rows, near[i]) for i, rows in structure.rows.items() if len(rows) and near[i]]
    number, none = len(structure.tree.inertial), np.zeros((10, 10))
    pairs = np.array([(next(iter(parts)), k) for _, parts in acting for k in parts]).reshape(-1, 2).T
    _, group = connected_components(sparse.coo_array((np.ones(pairs.shape[1]), pairs), shape=(number, number)))
    own = [list[tuple[np.ndarray, dict[int, np.ndarray]]]() for _ in range(number)]
    for rows, parts in acting:
        own[group[next(iter(parts))]].append((rows, parts))
    for k in range(max(group) + 1):
        bodies = np.flatnonzero(group == k).tolist()
        stacked = [np.hstack([K @ parts.get(i, none) for i in bodies]) for K, parts in own[k]]
        yield bodies, np.vstack([np.zeros((0, 10 * len(bodies))), *stacked])


def _composites(structure: Structure) -> tuple[list[int], list[np.ndarray], dict[int, dict[int, np.ndarray]]]:
    """Composites in terms of those of the next bodies with parameters.

    Returns:
        For each body with parameters, its next one towards the base, -1 for none, and that one's composite due to its
        own (10, 10), zero for none; and for {0} and every body of the tree what each body with parameters next to it,
        or it itself, adds to its composite, by their indices.
    """
    tree = structure.tree
    index = {i: k for k, i in enumerate(tree.inertial)}
    parents, shifts = [BASE] * len(index), [np.zeros((10, 10))] * len(index)
    near: dict[int, dict[int, np.ndarray]] = {i: {} for i in range(BASE, len(tree.bodies))}
    near |= {i: {k: np.eye(10)} for i, k in index.items()}
    for i in reversed(range(len(tree.bodies))):
        below = tree.bodies[i].parent
        for k, part in near[i].items():
            if below in index:
                parents[k], shifts[k] = index[below], structure.transfers[i] @ part
            else:
                near[below][k] = structure.transfers[i] @ part
    return parents, shifts, near


def _norms(structure: Structure) -> np.ndarray:
    """Norms of the columns of the structure's matrix (P,), from a triangular factor of the rows on each composite."""
    tree = structure.tree
    factors = {BASE: structure.rows[BASE]}
    for i, body in enumerate(tree.bodies):
        rows = np.vstack([structure.rows[i], factors[body.parent] @ structure.transfers[i]])
        factors[i] = linalg.qr(rows, mode="r")[0][:10] if len(rows) > 10 else rows
    return np.concatenate([np.linalg.norm(factors[i], axis=0) for i in tree.inertial])
