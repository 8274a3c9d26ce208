"""Bodies of a structure with the rows that act on them alone, or groups of bodies where several share rows."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.mechanism.body import BASE
from ident.parameters.independent_columns import bounded_norms, coefficients, first_independent, numerical_rank
from ident.parameters.structure import Structure

CLEAR = 1e-6, 1e-12
"""Singular values, relative to the largest, above which they count and below which they are zero beyond doubt."""


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
