"""Least squares in one pass: what is kept of samples that have been seen, and how it adds.

Of every wrench component the Gram matrix of its rows `[Y_b | Γ]` is kept, in coordinates in which they are nearly
orthonormal: `Z = [Y_b | Γ] P⁻¹`, with the triangular factor P of a QR decomposition of a few samples. So the condition
number is not squared, and the sum is as accurate as a Householder QR of all rows. Where later samples excite what the
first ones did not, P is renewed by a QR of all that is known stacked on the chunk.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.linalg import lapack

from ident.errors import InputError
from ident.estimation.samples import Samples, check_samples, whitened
from ident.mechanism.mechanism import checked_gravity
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import CHUNK, program_inputs, regressor_program
from ident.parameters.base_parameters import BaseParameters

PROBE = 64
"""Samples that the first coordinates are made of, at least as many as columns."""

FLOOR = 1e-7
"""Columns of the coordinates stick out of the span of others by this fraction at least, whether excited or not."""

SMALL = 16
"""Columns below which a general matrix product is faster than a symmetric one."""

SPREAD = 100.0
"""How far from orthogonal columns may become in their coordinates before these are renewed."""


@dataclass(frozen=True, eq=False)
class Accumulator:
    """What least squares needs of the samples seen so far; accumulators of different samples add in any order.

    All fields are numbers and arrays: `np.savez(file, **vars(a))` keeps one, `Accumulator(**np.load(file))` reads it.

    Attributes:
        names: Names of the r base parameters.
        factor: P, upper triangular (r + 1, r + 1).
        grams: Gram matrix of the rows `[Y_b | Γ] P⁻¹` of each wrench component (6, r + 1, r + 1).
        samples: Number of samples.
        chunks: Number of chunks they came in.
        factored: How many of them went through a QR decomposition.
        weighted: Whether the rows are whitened by a covariance.
    """

    names: tuple[str, ...]
    factor: np.ndarray
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
            common = _factor(np.vstack([square_root(a.gram) @ a.factor, square_root(b.gram) @ b.factor]))
            a, b = a._in(common), b._in(common)
        samples, chunks = a.samples + b.samples, a.chunks + b.chunks
        return Accumulator(a.names, a.factor, a.grams + b.grams, samples, chunks, factored, a.weighted)

    def _in(self, factor: np.ndarray) -> "Accumulator":
        """The same in other coordinates."""
        # Solved for, not multiplied with an inverse: coordinates of a joint at rest are far from orthogonal.
        change = lapack.dtrtrs(factor, self.factor.T, trans=1)[0].T
        return replace(self, factor=factor, grams=change.T @ self.grams @ change)

    def with_rows(self, rows: np.ndarray) -> "Accumulator":
        """With the rows of another chunk, columns `[Y_b | Γ]` first (r + 1, 6, C)."""
        number = {"samples": self.samples + rows.shape[2], "chunks": self.chunks + 1}
        grams = self.grams + _grams(rows, self.factor)
        if _is_orthogonal(grams.sum(axis=0)):
            return replace(self, grams=grams, **number)
        known = square_root(self.gram) @ self.factor
        renewed = self._in(_factor(np.vstack([known, rows.reshape(len(rows), -1).T])))
        grams = renewed.grams + _grams(rows, renewed.factor)
        return replace(renewed, grams=grams, factored=self.factored + 1, **number)


def _first_factor(rows: np.ndarray) -> np.ndarray:
    """Coordinates P for rows like those of a first chunk (r + 1, 6, C)."""
    step = max(1, rows.shape[2] // max(PROBE, len(rows)))
    return _factor(rows[:, :, ::step].reshape(len(rows), -1).T)


def square_root(gram: np.ndarray) -> np.ndarray:
    """A square matrix T with `Tᵀ T = gram`, also of a singular one."""
    scale = np.sqrt(np.maximum(np.diag(gram), 0))
    scale = np.where(scale > 0, scale, 1)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    return np.sqrt(np.maximum(values, 0))[:, None] * vectors.T * scale


def accumulate(
    tree: Tree,
    samples: Samples,
    *,
    gravity: np.ndarray,
    parameters: BaseParameters,
    start: Accumulator | None = None,
    factor: np.ndarray | None = None,
) -> Accumulator:
    """Adds samples to an accumulator, chunk by chunk.

    Args:
        tree: The mechanism of b bodies.
        samples: Joint states and total wrench.
        gravity: Acceleration of gravity as `base_wrench_regressor` takes it, m/s² (3,).
        parameters: Regrouping of the mechanism's 10 b parameters.
        start: What is known from other samples.
        factor: Coordinates to start from, so that accumulators of several workers add without a change of them.

    Returns:
        The accumulator of all samples.

    Raises:
        InputError: Samples do not fit the mechanism, or a covariance is not positive definite.
    """
    check_samples(samples, tree)
    weighted = samples.covariance is not None
    if start is not None and (start.names, start.weighted) != (parameters.names, weighted):
        raise InputError("Samples are added to an accumulator of the same base parameters and weighting only.")
    found = start
    for rows in chunk_rows(tree, samples, gravity=gravity, parameters=parameters):
        if found is None:
            own = _first_factor(rows) if factor is None else factor
            found = Accumulator(parameters.names, own, np.zeros((6, *own.shape)), 0, 0, 0, weighted)
        found = found.with_rows(rows)
    return cast(Accumulator, found)


def chunk_rows(
    tree: Tree, samples: Samples, *, gravity: np.ndarray, parameters: BaseParameters
) -> Iterator[np.ndarray]:
    """The rows `[Y_b | Γ]` of samples, chunk by chunk in the same memory, whitened where there is a covariance.

    Args:
        tree: The mechanism; arguments as for `accumulate`.
        samples: Samples that fit it.
        gravity: Acceleration of gravity, m/s² (3,).
        parameters: Regrouping of the mechanism's 10 b parameters.

    Yields:
        Columns first (r + 1, 6, C).

    Raises:
        InputError: The regrouping is another mechanism's, or a covariance is not positive definite.
    """
    if len(parameters.parameters) != 10 * len(tree.inertial):
        raise InputError(
            f"A regrouping of {len(parameters.parameters)} parameters does not fit {len(tree.inertial)} bodies."
        )
    down = checked_gravity(gravity).astype(float)
    program = regressor_program(tree, down, parameters.kept, moving=samples.base is not None, torques=False)
    block = np.zeros((parameters.rank + 1, 6, min(CHUNK, len(samples))))
    flat = block.reshape(len(block) * 6, -1)
    program.fill(flat)
    for first in range(0, len(samples), CHUNK):
        chunk = samples.part(slice(first, first + CHUNK))
        motion = Motion(chunk.q, chunk.dq, chunk.ddq, chunk.base).checked(tree)
        program.run(program_inputs(motion, down), flat[:, : len(chunk)])
        rows = block[:, :, : len(chunk)]
        rows[-1] = chunk.wrench.T
        yield rows if chunk.covariance is None else whitened(rows, chunk.covariance)


def _grams(rows: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Gram matrices of each component's rows in the coordinates of a factor (6, r + 1, r + 1)."""
    to_coordinates = inverse_of(factor).T
    grams = np.empty((6, len(rows), len(rows)))
    for gram, component in zip(grams, np.moveaxis(rows, 1, 0), strict=True):
        Z = to_coordinates @ component
        # Times itself numpy takes it to BLAS's symmetric product, which is slower than the general one if it is small.
        np.matmul(Z, (Z.copy() if len(Z) < SMALL else Z).T, out=gram)
    return grams


def _factor(rows: np.ndarray) -> np.ndarray:
    """Triangular factor of rows (m, k), regular whatever they are (k, k)."""
    size = rows.shape[1]
    triangle = triangle_of(np.vstack([rows, np.zeros((max(size - len(rows), 0), size))]))
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
    return np.asarray(np.linalg.qr(rows, mode="r"))


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Inverse of a regular upper triangular matrix."""
    return lapack.dtrtri(factor)[0]


def _is_orthogonal(gram: np.ndarray) -> bool:
    """Whether every column sticks out of the span of those before it by a fair part."""
    try:
        triangle = np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        return False
    return bool((np.diag(triangle) ** 2 * SPREAD > np.diag(gram)).all())
