"""Independent columns of a regressor, from left to right, and coefficients of the others; exact or within rounding."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg

from ident.errors import InputError
from ident.tolerances import ROUNDING, ZERO_COLUMN

SMALL_COLUMN = 1e-5
"""Columns with a norm below this fraction of the largest are divided by that fraction, not scaled to unit length."""

COEFFICIENTS = 1e5, 1e3
"""Largest coefficients between unit-norm columns. The first bound loses no column to rounding. The second is used if
the first independent columns need larger coefficients, as along chains of many joints in general position, or if the
first times the rounding of the dependencies is too large."""


class UnitColumns(NamedTuple):
    """Columns of a regressor of unit length (or zero), with rows rotated into at most P.

    Attributes:
        unit: The columns (…, P).
        norms: Their original norms (P,).
        singular_values: Singular values of the unit columns.
    """

    unit: np.ndarray
    norms: np.ndarray
    singular_values: np.ndarray


def unit_columns(Y: np.ndarray) -> UnitColumns:
    """Unit columns of a regressor (…, P).

    Raises:
        InputError: It is not finite, or all zero.
    """
    columns = Y.reshape(-1, Y.shape[-1])
    if not np.isfinite(columns).all() or not columns.any():
        raise InputError(f"A regressor needs finite numbers that are not all zero, got shape {Y.shape}.")
    # The rotation of the rows by the QR decomposition preserves dependencies between columns.
    triangle = linalg.qr(columns, mode="r")[0][: columns.shape[1]]
    norms = np.linalg.norm(triangle, axis=0)
    # Small columns stay small: scaled to unit length their rounding errors would add to the rank.
    bounded = np.maximum(norms, SMALL_COLUMN * norms.max())
    unit = np.where(norms > ZERO_COLUMN * norms.max(), triangle / bounded, 0)
    return UnitColumns(unit, bounded, np.linalg.svd(unit, compute_uv=False))


def numerical_rank(singular_values: np.ndarray, rounding: float = ROUNDING) -> int:
    """Number of singular values above rounding, a fraction of the largest."""
    return int(np.sum(singular_values > rounding * singular_values.max(initial=0)))


def first_independent(unit: np.ndarray, rank: int, rounding: float) -> tuple[list[int], list[int]]:
    """Indices of the first `rank` independent unit (or zero) columns, left to right, and of those passed over.

    The columns that a pivoted QR selects are exchanged one by one: column j for a kept one further right on which it
    depends. Without a bound on the coefficients the result is the first independent columns.

    Args:
        unit: The columns (…, P).
        rank: Their rank r.
        rounding: Largest singular value that is taken for zero.
    """
    triangle, order = linalg.qr(unit, mode="r", pivoting=True)
    others = order[rank:]
    made = linalg.solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:])
    bounds = COEFFICIENTS if COEFFICIENTS[0] * rounding < ROUNDING else COEFFICIENTS[1:]
    for largest in bounds:
        kept, passed = _exchanged(order[:rank], others, made.copy(), largest, last=largest == bounds[-1])
        if not passed:
            break
    return sorted(kept), passed


def _exchanged(
    start: np.ndarray, others: np.ndarray, made: np.ndarray, largest: float, *, last: bool
) -> tuple[list[int], list[int]]:
    """Kept columns after exchanges to the left, and columns passed over because coefficients would be too large.

    Args:
        start: Indices of the kept columns (r,).
        others: Indices of the other columns (P - r,).
        made: Their coefficients in terms of the kept ones (r, P - r); overwritten.
        largest: Bound on the coefficients.
        last: False to stop at the first column passed over.
    """
    kept, passed, place = start.copy(), list[int](), {int(k): c for c, k in enumerate(others)}
    sizes = abs(made).max(axis=1, initial=0)
    for j in range(len(start) + len(others)):
        if (c := place.get(j)) is None:
            continue
        share = np.where(kept > j, abs(made[:, c]), 0)
        i = int(share.argmax())
        if share[i] <= ROUNDING:
            continue
        if _exchange(made, sizes, i, c, largest):
            del place[j]
            place[int(kept[i])], kept[i] = c, j
        else:
            passed.append(j)
            if not last:
                break
    return kept.tolist(), passed


def _exchange(made: np.ndarray, sizes: np.ndarray, i: int, c: int, largest: float) -> bool:
    """Exchanges kept column i for the other column c, unless a coefficient would exceed a bound.

    Args:
        made: Coefficients of the other columns (r, P - r); changed.
        sizes: Upper limits of each row (r,); changed.
        i: Row of the kept column.
        c: Column of the other one.
        largest: The bound.

    Returns:
        True if they were exchanged.
    """
    shares, pivot = made[:, c].copy(), made[i, c]
    row = made[i] / pivot
    row[c] = 1 / pivot
    shares[i], size = 0, abs(row).max()
    limits = sizes + abs(shares) * max(size, 1)
    limits[i] = size
    # Only rows that might exceed the bound are computed before it is known that none does.
    doubtful = np.flatnonzero(limits > largest)
    made[:, c] = 0
    after = made[doubtful] - np.outer(shares[doubtful], row)
    limits[doubtful] = abs(after).max(axis=1)
    if max(size, limits.max()) > largest:
        shares[i] = pivot
        made[:, c] = shares
        return False
    linalg.blas.dger(-1, row, shares, a=made.T, overwrite_a=True)
    made[i], sizes[:] = row, limits
    return True


def coefficients(kept: np.ndarray, dependent: np.ndarray) -> np.ndarray:
    """Coefficients of unit columns in terms of the kept ones, zero where they are only rounding errors."""
    # QR takes a quarter of the time of `lstsq`, whose singular values independent columns do not need.
    made = linalg.lapack.dgels(kept, dependent)[1][: kept.shape[1]]
    short = np.where(abs(made) < ROUNDING, 0, made)
    rounding = np.linalg.norm(dependent - kept @ short, axis=0) < ZERO_COLUMN
    return np.where(rounding, short, made)


def basis(kept: Sequence[str], names: tuple[str, ...], unit: np.ndarray, first: list[int]) -> list[int]:
    """Indices of pinned names, which must be as good a basis as the first independent columns."""
    unknown = [name for name in kept if name not in names]
    if unknown:
        raise InputError(f"No parameter is named {', '.join(unknown)}; the names are {', '.join(names)}.")
    chosen = [names.index(name) for name in kept]
    rank = numerical_rank(np.linalg.svd(unit[:, chosen], compute_uv=False))
    if not rank == len(chosen) == len(first):
        raise InputError(
            f"The pinned base parameters {', '.join(kept)} are no basis: {len(chosen)} names of rank {rank}, where "
            f"the regressor has rank {len(first)}; its first independent columns are "
            f"{', '.join(names[k] for k in first)}."
        )
    return chosen


def reduced_rows(rows: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Reduced row echelon form and its pivots, by Gaussian elimination without rounding.

    The numbers may be of any type with exact arithmetic and an exact test for zero: integers as fractions, or rational
    functions of a mechanism's lengths.

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
