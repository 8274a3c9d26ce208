"""Gaussian elimination without rounding, on arrays of exact numbers (dtype object).

The numbers may be of any type with exact arithmetic and an exact test for zero: integers as fractions, or rational
functions of a mechanism's lengths.
"""

import numpy as np


def reduced_rows(rows: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Reduced row echelon form and its pivots.

    Args:
        rows: Matrix of exact numbers (k, n).

    Returns:
        The r nonzero rows, with ones at the pivots and zeros above and below them (r, n), and the pivots' columns: the
        first columns, from left to right, that do not depend on those before.
    """
    rest = [list(row) for row in rows]
    done: list[list[object]] = []
    pivots: list[int] = []
    for column in range(rows.shape[1]):
        # The sparsest row keeps the others sparse.
        candidates = [row for row in rest if row[column] != 0]
        if not candidates:
            continue
        pivot = min(candidates, key=lambda row: sum(x != 0 for x in row))
        rest = [row for row in rest if row is not pivot]
        pivot = [x / pivot[column] if x != 0 else x for x in pivot]
        rest, done = ([_without(row, pivot, column) for row in group] for group in (rest, done))
        done.append(pivot)
        pivots.append(column)
    out = np.empty((len(done), rows.shape[1]), dtype=object)
    for k, row in enumerate(done):
        out[k] = row
    return out, pivots


def _without(row: list, pivot: list, column: int) -> list:
    """A row less the multiple of the pivot row that makes its entry in a column zero."""
    factor = row[column]
    if factor == 0:
        return row
    return [x - factor * y if y != 0 else x for x, y in zip(row, pivot, strict=True)]
