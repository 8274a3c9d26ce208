"""Least squares in one pass: what is kept of samples that have been seen, and how it adds.

Of every channel the Gram matrix of its rows `[Y_b | Γ]` is kept, in coordinates in which they are far from dependent:
`Z = [Y_b | Γ] P⁻¹`. A column that sticks out of the span of those before it stays as it is; from the others, and from
Γ, what those before them say is subtracted, as a QR decomposition of a few samples tells it. So the condition number is
not squared, and the sum is as accurate as a Householder QR of all rows. Where later samples excite what the first ones
did not, P is renewed by a QR of all that is known stacked on the chunk.

Columns that only few channels see come first (`Equations.order`), so that for the other channels the triangle P begins
behind them: forces do not see inertias.
"""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.linalg import lapack

from ident.errors import InputError
from ident.estimation.chunks import Chunk, chunks, inverse_of
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples

PROBE = 64
"""Samples that the first coordinates are made of, at least as many as columns."""

FLOOR = 1e-7
"""Columns of the coordinates stick out of the span of others by this fraction at least, whether excited or not."""

ROUNDING = 1e-13
"""Part of a column's size that rounding may leave of it where the columns before it say all of it."""

LAPACK_BLOCK = 32
"""Columns that LAPACK takes together if it has room for them."""

APART, TOO_CLOSE = 0.1, 0.01
"""Part of a column's squares that sticks out of the span of those before it: at least, for it to stay as it is among
the coordinates, and below which coordinates are renewed."""


@dataclass(frozen=True, eq=False)
class Accumulator:
    """What least squares needs of the samples seen so far; accumulators of different samples add in any order.

    All fields are numbers and arrays: `np.savez(file, **vars(a))` keeps one, `Accumulator(**np.load(file))` reads it.

    Attributes:
        names: Names of the r columns.
        factor: P, unit upper triangular if its columns are taken in their order (r + 1, r + 1).
        order: That order, the measurements last (r + 1,).
        grams: Gram matrix of the rows `[Y_b | Γ] P⁻¹` of each channel (C, r + 1, r + 1).
        samples: Number of samples.
        chunks: Number of chunks they came in.
        factored: How many of them went through a QR decomposition.
        weighted: Whether the rows are weighted, as by a covariance.
    """

    names: tuple[str, ...]
    factor: np.ndarray
    order: np.ndarray
    grams: np.ndarray
    samples: int
    chunks: int
    factored: int
    weighted: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(map(str, self.names)))
        for key, kind in (("samples", int), ("chunks", int), ("factored", int), ("weighted", bool)):
            object.__setattr__(self, key, kind(getattr(self, key)))

    @property
    def gram(self) -> np.ndarray:
        """Gram matrix of all rows in the coordinates of P (r + 1, r + 1)."""
        return self.grams.sum(axis=0)

    @property
    def root(self) -> np.ndarray:
        """A square matrix T that has the Gram matrix of all rows `[Y_b | Γ]`, `Tᵀ T` (r + 1, r + 1)."""
        return square_root(self.gram) @ self.factor

    def __add__(self, other: "Accumulator") -> "Accumulator":
        """All samples of both.

        Raises:
            InputError: They are not of the same base parameters, or only one is weighted.
        """
        if (self.names, self.weighted) != (other.names, other.weighted):
            raise InputError(
                "Accumulators add that have the same base parameters and weighting, got "
                f"{', '.join(self.names)} (weighted: {self.weighted}) and {', '.join(other.names)} ({other.weighted})."
            )
        a, b, factored = self, other, self.factored + other.factored
        if not np.array_equal(a.factor, b.factor):
            common = _factor(np.vstack([a.root, b.root])[:, a.order], a.order)
            a, b = a._in(common, a.order), b._in(common, a.order)
        samples, chunks = a.samples + b.samples, a.chunks + b.chunks
        return Accumulator(a.names, a.factor, a.order, a.grams + b.grams, samples, chunks, factored, a.weighted)

    def _in(self, factor: np.ndarray, order: np.ndarray) -> "Accumulator":
        """The same in other coordinates, whose factor is triangular in an order."""
        # Solved for, not multiplied with an inverse: coordinates of a joint at rest are far from orthogonal.
        change = lapack.dtrtrs(factor[:, order], self.factor[:, order].T, trans=1)[0].T
        return replace(self, factor=factor, order=order, grams=change.T @ self.grams @ change)

    def with_chunk(self, chunk: Chunk) -> "Accumulator":
        """With another chunk of samples."""
        samples, count = self.samples + chunk.samples, self.chunks + 1
        grams = self.grams + chunk.grams(self.factor[:, self.order])
        if _is_apart(grams.sum(axis=0), self.factor[:, self.order]):
            return replace(self, grams=grams, samples=samples, chunks=count)
        rows = np.vstack([self.root[:, self.order], _stacked(chunk.rows(1))])
        renewed = self._in(_factor(rows, self.order), self.order)
        grams = renewed.grams + chunk.grams(renewed.factor[:, self.order])
        return replace(renewed, grams=grams, samples=samples, chunks=count, factored=self.factored + 1)


def _first_factor(chunk: Chunk, order: np.ndarray) -> np.ndarray:
    """Coordinates P for rows like those of a first chunk."""
    return _factor(_stacked(chunk.rows(max(1, chunk.samples // max(PROBE, len(order))))), order)


def _stacked(rows: np.ndarray) -> np.ndarray:
    """Rows (m, r + 1) of columns (r + 1, C, n)."""
    return rows.reshape(len(rows), -1).T


def square_root(gram: np.ndarray) -> np.ndarray:
    """A square matrix T with `Tᵀ T = gram`, also of a singular one."""
    scale = np.sqrt(np.maximum(np.diag(gram), 0))
    unit = np.where(scale > 0, scale, 1)
    values, vectors = np.linalg.eigh(gram / np.outer(unit, unit))
    return np.sqrt(np.maximum(values, 0))[:, None] * vectors.T * scale


def accumulate(
    equations: Equations,
    samples: Samples,
    *,
    start: Accumulator | None = None,
    factor: np.ndarray | None = None,
    factors: np.ndarray | None = None,
) -> Accumulator:
    """Adds samples to an accumulator, chunk by chunk.

    Args:
        equations: What is fitted.
        samples: Motion and measured channels.
        start: What is known from other samples.
        factor: Coordinates to start from, so that accumulators of several workers add without a change of them.
        factors: What each row is multiplied by, to weight it (N, C).

    Returns:
        The accumulator of all samples.

    Raises:
        InputError: Samples do not fit the equations, or a covariance is not positive definite.
    """
    return accumulate_checked(equations, equations.checked(samples), start=start, factor=factor, factors=factors)


def accumulate_checked(
    equations: Equations,
    samples: Samples,
    *,
    start: Accumulator | None = None,
    factor: np.ndarray | None = None,
    factors: np.ndarray | None = None,
) -> Accumulator:
    """`accumulate` for samples that are known to fit, as `pieces` gives them: few are summed as fast as checked."""
    weighted = samples.covariance is not None or factors is not None
    if start is not None and (start.names, start.weighted) != (equations.names, weighted):
        raise InputError("Samples are added to an accumulator of the same base parameters and weighting only.")
    total = start
    for chunk in chunks(equations, samples, factors):
        if total is None:
            order, _ = equations.order(samples)
            own = _first_factor(chunk, order) if factor is None else factor
            grams = np.zeros((len(equations.channels), *own.shape))
            total = Accumulator(equations.names, own, order, grams, 0, 0, 0, weighted)
        total = total.with_chunk(chunk)
    return cast(Accumulator, total)


def _factor(rows: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Coordinates P for rows of columns in an order (m, k), triangular with its columns in that order (k, k)."""
    triangle = _regular_triangle(rows)
    squares = triangle.diagonal() ** 2
    stays = squares >= APART * (triangle**2).sum(axis=0)
    stays[-1] = False  # What columns leave of Γ is to be accurate in each channel, however well that fits.
    # Times the diagonal, a column of the inverse is what has to be subtracted from that of the rows.
    inverse = np.where(stays, np.eye(len(order)), inverse_of(triangle) * triangle.diagonal())
    out = np.empty_like(triangle)
    out[:, order] = inverse_of(inverse)
    return out


def _regular_triangle(rows: np.ndarray) -> np.ndarray:
    """Triangular factor of rows (m, k), regular whatever they are (k, k)."""
    size = rows.shape[1]
    enough = rows if len(rows) >= size else np.vstack([rows, np.zeros((size - len(rows), size))])
    triangle = triangle_of(enough)
    norms = np.linalg.norm(triangle, axis=0)
    # A column that is nothing but an earlier floor is measured against the others.
    floor = FLOOR * np.maximum(norms, FLOOR * norms.max() or 1)
    weak = abs(np.diag(triangle)) <= floor
    if not weak.any():
        return triangle
    triangle = np.where(np.diag(weak), 0, triangle)
    return triangle_of(np.vstack([triangle, np.diag(np.where(weak, floor, 0))]))


def triangle_of(rows: np.ndarray) -> np.ndarray:
    """Triangular factor of a QR decomposition."""
    factored = lapack.dgeqrf(rows, lwork=LAPACK_BLOCK * rows.shape[1])[0]
    return np.asarray(np.triu(factored[: rows.shape[1]]))


def _is_apart(gram: np.ndarray, factor: np.ndarray) -> bool:
    """Whether every column that is more than rounding sticks out of the span of those before it by a fair part.

    Args:
        gram: Gram matrix in coordinates (k, k).
        factor: These coordinates, triangular (k, k).
    """
    rounding = ROUNDING**2 * (factor * (gram @ factor)).sum(axis=0)
    shown = gram + np.diag(np.where(rounding > 0, rounding, 1))
    triangle, failed = lapack.dpotrf(shown)
    return not failed and bool((triangle.diagonal() ** 2 > TOO_CLOSE * shown.diagonal()).all())
