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
from scipy import linalg

from ident.mechanism.body import BASE
from ident.parameters.independent_columns import (
    COEFFICIENTS,
    DEPENDENT,
    NEGLIGIBLE,
    bounded_norms,
    coefficients,
    first_independent,
    numerical_rank,
)
from ident.parameters.structure import Structure

CLEAR = 1e-6, 1e-12
"""Singular values, relative to the largest, above which they count and below which they are zero beyond doubt."""

FEW = 30
"""Rows up to which all singular values are computed."""


@dataclass(frozen=True, eq=False)
class BodyGroup:
    """Bodies with parameters that share rows, mostly one alone, and the kernel of these rows.

    All columns have unit norm in the matrix of the structure.

    Attributes:
        columns: Indices of the bodies' parameters (k,).
        below: Indices of the parameters of the next body towards the base, (10,), or (0,) if there is none.
        shift: That body's composite due to those of the group (10, k), or (0, k).
        rows: Rows on the composites (m, k).
        kept: Indices, among the columns, of the first independent ones (r,).
        others: Indices of the other columns (k - r,).
        made: Coefficients of the other columns (r, k - r).
        inverse: Pseudo-inverse of the rows (k, m).
        clear: False if the rank is in doubt.
        passed: True if a column that is nearly dependent was passed over.
    """

    columns: np.ndarray
    below: np.ndarray
    shift: np.ndarray
    rows: np.ndarray
    kept: list[int]
    others: list[int]
    made: np.ndarray
    inverse: np.ndarray
    clear: bool
    passed: bool

    @property
    def kernel(self) -> np.ndarray:
        """Combinations without effect on the rows, one for each of the other columns (k, k - r)."""
        out = np.zeros((len(self.columns), len(self.others)))
        out[self.kept], out[self.others] = -self.made, np.eye(len(self.others))
        return out


def groups(structure: Structure) -> tuple[list[BodyGroup], np.ndarray]:
    """Groups of bodies, in the order of their first bodies, and the norms of all columns (P,)."""
    norms, nonzero = bounded_norms(_norms(structure))
    parents, shifts, near = _composites(structure)
    scale, places = 1 / np.where(nonzero, norms, np.inf), np.arange(len(norms)).reshape(-1, 10)
    acting = [(rows, near[i]) for i, rows in structure.rows.items() if len(rows) and near[i]]
    rows_of = _rows_by_bodies(acting, len(parents))
    out = []
    for bodies, rows in rows_of:
        columns, parent = places[bodies].ravel(), parents[bodies[0]]
        below = places[parent] if parent >= 0 else places[:0].ravel()
        shift = np.hstack([shifts[k] for k in bodies])[: len(below)]
        out.append(_group(columns, below, norms[below][:, None] * shift * scale[columns], rows * scale[columns]))
    return out, norms


def _group(columns: np.ndarray, below: np.ndarray, shift: np.ndarray, rows: np.ndarray) -> BodyGroup:
    """A group, with the kernel of its rows."""
    width = len(columns)
    if not rows.any():
        made, inverse = np.zeros((0, width)), np.zeros((width, len(rows)))
        return BodyGroup(columns, below, shift, rows, [], list(range(width)), made, inverse, True, False)
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    rank = numerical_rank(s)
    rounding = float(s[rank]) if rank < len(s) else 0.0
    kept, passed = first_independent(rows, rank, rounding)
    others = [k for k in range(width) if k not in kept]
    made = coefficients(rows[:, kept], rows[:, others])
    inverse = (vt[:rank].T / s[:rank]) @ u[:, :rank].T
    clear = s[rank - 1] > CLEAR[0] * s[0] and rounding <= CLEAR[1] * s[0]
    return BodyGroup(columns, below, shift, rows, kept, others, made, inverse, bool(clear), bool(passed))


def _rows_by_bodies(
    acting: list[tuple[np.ndarray, dict[int, np.ndarray]]], number: int
) -> list[tuple[list[int], np.ndarray]]:
    """Groups of bodies and their rows.

    Args:
        acting: Rows on a composite, and what each body adds to that composite.
        number: Number of bodies with parameters.
    """
    group_of = list(range(number))
    for _, parts in acting:
        joined = {group_of[k] for k in parts}
        group_of = [min(joined) if g in joined else g for g in group_of] if len(joined) > 1 else group_of
    members: dict[int, list[int]] = {}
    for k, group in enumerate(group_of):
        members.setdefault(group, []).append(k)
    rows: dict[int, list[np.ndarray]] = {group: [np.zeros((0, 10 * len(own)))] for group, own in members.items()}
    for K, parts in acting:
        group, none = group_of[next(iter(parts))], np.zeros((10, 10))
        rows[group].append(np.hstack([K @ parts.get(k, none) for k in members[group]]))
    return [(own, np.vstack(rows[group])) for group, own in members.items()]


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
