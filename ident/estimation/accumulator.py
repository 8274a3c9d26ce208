"""Accumulated normal equations of least squares in one pass over the samples.

For every channel the Gram matrix of its rows `[Y_b | Γ]` is kept, in well-conditioned coordinates
`Z = [Y_b | Γ] P⁻¹`. A column that is far from the span of those before it is kept unchanged; from the others, and from
Γ, their projection on the columns before them is subtracted, by a QR decomposition of a few samples. So the condition
number is not squared, and the sum is as accurate as a Householder QR of all rows. Where later samples excite
combinations that the first ones did not, P is renewed by a QR of the accumulated factor stacked on the chunk.

Columns that act on few channels come first (`Equations.order`), so that for the other channels the triangle P begins
after them: forces do not depend on inertias.
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
"""Number of samples that determine the first coordinates; never fewer than columns."""

FLOOR = 1e-7
"""Least distance of a column of P from the span of the others, relative to its size, whether excited or not."""

ROUNDING = 1e-13
"""Largest rounding error of a column that depends on those before it, relative to its size."""

LAPACK_BLOCK = 32
"""Block size of LAPACK's QR decomposition, columns."""

APART, TOO_CLOSE = 0.1, 0.01
"""Squared distance of a column from the span of those before it, relative to its square: the least with which it is
kept unchanged in the coordinates, and the value below which the coordinates are renewed."""


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Sufficient statistics of least squares for the samples so far; accumulators of different samples add up.

    The order of addition does not matter. All fields are numbers and arrays: `np.savez(file, **vars(a))` saves one,
    `Accumulator(**np.load(file))` reads it.

    Attributes:
        names: Names of the r columns.
        factor: P, unit upper triangular with its columns in `order` (r + 1, r + 1).
        order: Order of the columns, the measurements last (r + 1,).
        grams: Gram matrix of the rows `[Y_b | Γ] P⁻¹` of each channel (C, r + 1, r + 1).
        samples: Number of samples.
        chunks: Number of chunks.
        factored: Number of chunks that took a QR decomposition.
        weighted: True if the rows are weighted, as by a covariance.
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
        """Square matrix T such that `Tᵀ T` is the Gram matrix of all rows `[Y_b | Γ]` (r + 1, r + 1)."""
        return square_root(self.gram) @ self.factor

    def __add__(self, other: "Accumulator") -> "Accumulator":
        """Accumulator of all samples of both.

        Raises:
            InputError: Their base parameters differ, or only one is weighted.
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
        """Accumulator in other coordinates, with their factor, triangular in an order."""
        # A triangular solve, not a product with the inverse: coordinates of a joint at rest are ill-conditioned.
        change = lapack.dtrtrs(factor[:, order], self.factor[:, order].T, trans=1)[0].T
        return replace(self, factor=factor, order=order, grams=change.T @ self.grams @ change)

    def with_chunk(self, chunk: Chunk) -> "Accumulator":
        """Accumulator with another chunk of samples."""
        samples, count = self.samples + chunk.samples, self.chunks + 1
        grams = self.grams + chunk.grams(self.factor[:, self.order], None)
        if _is_apart(grams.sum(axis=0), self.factor[:, self.order]):
            return replace(self, grams=grams, samples=samples, chunks=count)
        rows = np.vstack([self.root[:, self.order], _stacked(chunk.rows(1))])
        renewed = self._in(_factor(rows, self.order), self.order)
        grams = renewed.grams + chunk.grams(renewed.factor[:, self.order], None)
        return replace(renewed, grams=grams, samples=samples, chunks=count, factored=self.factored + 1)


def _stacked(rows: np.ndarray) -> np.ndarray:
    """Rows (m, r + 1) of columns (r + 1, C, n)."""
    return rows.reshape(len(rows), -1).T


def square_root(gram: np.ndarray) -> np.ndarray:
    """Square matrix T with `Tᵀ T = gram`, which may be singular."""
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
    checked: bool = False,
) -> Accumulator:
    """Adds samples to an accumulator, chunk by chunk.

    Args:
        equations: Equations to fit.
        samples: Motion and measured channels.
        start: Accumulator of other samples.
        factor: Coordinates to start from, so that accumulators of several workers add without a change of coordinates.
        factors: Weight by which each row is multiplied (N, C).
        checked: True for samples from `pieces`: for few samples a check costs as much as the sum.

    Returns:
        The accumulator of all samples.

    Raises:
        InputError: Samples do not fit the equations, or a covariance is not positive definite.
    """
    samples = samples if checked else equations.checked(samples)
    weighted = samples.covariance is not None or factors is not None
    if start is not None and (start.names, start.weighted) != (equations.names, weighted):
        raise InputError("Samples are added to an accumulator of the same base parameters and weighting only.")
    total, (order, _) = start, equations.order(samples)
    for chunk in chunks(equations, samples, factors):
        if total is None:
            if factor is None:
                factor = _factor(_stacked(chunk.rows(max(1, chunk.samples // max(PROBE, len(order))))), order)
            grams = np.zeros((len(equations.channels), *factor.shape))
            total = Accumulator(equations.names, factor, order, grams, 0, 0, 0, weighted)
        total = total.with_chunk(chunk)
    return cast(Accumulator, total)


def _factor(rows: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Coordinates P for rows with columns in an order (m, k), triangular with its columns in that order (k, k)."""
    triangle = _regular_triangle(rows)
    squares = triangle.diagonal() ** 2
    stays = squares >= APART * (triangle**2).sum(axis=0)
    stays[-1] = False  # The residual of Γ must be accurate in each channel, however well it fits.
    # A column of the inverse, times the diagonal, is the combination to subtract from the column of the rows.
    inverse = np.where(stays, np.eye(len(order)), inverse_of(triangle) * triangle.diagonal())
    out = np.empty_like(triangle)
    out[:, order] = inverse_of(inverse)
    return out


def _regular_triangle(rows: np.ndarray) -> np.ndarray:
    """Triangular factor of rows (m, k), regular for any rows (k, k)."""
    size = rows.shape[1]
    enough = rows if len(rows) >= size else np.vstack([rows, np.zeros((size - len(rows), size))])
    triangle = triangle_of(enough)
    norms = np.linalg.norm(triangle, axis=0)
    # A column that holds only an earlier floor is compared with the others.
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
    """True if every column above rounding is far enough from the span of those before it.

    Args:
        gram: Gram matrix in coordinates (k, k).
        factor: These coordinates, triangular (k, k).
    """
    rounding = ROUNDING**2 * (factor * (gram @ factor)).sum(axis=0)
    shown = gram + np.diag(np.where(rounding > 0, rounding, 1))
    triangle, failed = lapack.dpotrf(shown)
    return not failed and bool((triangle.diagonal() ** 2 > TOO_CLOSE * shown.diagonal()).all())
