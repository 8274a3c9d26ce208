"""Accumulated normal equations of least squares in one pass over the samples.

For every channel the Gram matrix of its rows `[Y_b | Γ]` is kept, in well-conditioned coordinates
`Z = [Y_b | Γ] P⁻¹`. A column that is far from the span of those before it is kept unchanged; from the others, and from
Γ, their projection on the columns before them is subtracted, by a QR decomposition of a few samples. So the condition
number is not squared, and the sum is as accurate as a Householder QR of all rows. Where later samples excite
combinations that the first ones did not, P is renewed by a QR of the accumulated factor stacked on the chunk.

Columns that act on few channels come first (`Equations.order`), so that for the other channels the triangle P begins
after them: forces do not depend on inertias.

numpy computes the rows of some thousand samples and passes them to BLAS. Compiled code, if available, does everything
for some hundred samples while they are in the inner caches.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ident.errors import ExcitationError
from ident.estimation.equations import Equations
from ident.estimation.noise import channel_scales, remembered
from ident.estimation.samples import Samples
from ident.files.table import listed
from ident.model import compiled
from ident.model.regressor import CHUNK, program_inputs
from ident.tolerances import CONDITION_LIMIT, ZERO_COLUMN

INPUTS = 2**20
"""Bytes of inputs per call of compiled code, which takes `CHUNK` samples at least."""

Memory = tuple[np.ndarray, np.ndarray] | None
"""ρ of each channel's noise (C,), and its last z (C, r + 1), which is overwritten; see `noise.remembered`."""

PROBE = 64
"""Number of samples that determine the first coordinates; never fewer than columns."""

FLOOR = 1e-7
"""Least distance of a column of P from the span of the others, relative to its size, whether excited or not."""

DEPENDENT = 1e-13
"""Largest rounding error of a column that depends on those before it, relative to its size."""

APART, TOO_CLOSE = 0.1, 0.01
"""Squared distance of a column from the span of those before it, relative to its square: the least with which it is
kept unchanged in the coordinates, and the value below which the coordinates are renewed."""

INDEPENDENT = 1e-6
"""Distance of a unit-norm column from the span of others below which it depends on them."""

MIXED = 1e-3
"""Coefficient of a unit-norm column in another from which the one takes up the other."""

MOSTLY = 0.5
"""Share of a parameter in combinations that the motion does not separate from which it is not determined."""


class Chunk(NamedTuple):
    """Chunk of the samples of equations.

    Attributes:
        samples: Number of samples n.
        rows: Function of k that returns the rows of every k-th sample, columns `[Y_b | Γ]` in order (r + 1, C, n).
        grams: Function of an upper triangular factor, and of the noise's memory or None, that returns Gram matrices of
            the columns, or of the remembered ones, in the factor's coordinates (C, r + 1, r + 1).
    """

    samples: int
    rows: Callable[[int], np.ndarray]
    grams: Callable[[np.ndarray, Memory], np.ndarray]


def chunks(equations: Equations, samples: Samples, factors: np.ndarray | None) -> Iterator[Chunk]:
    """Yields checked samples chunk by chunk; a chunk is valid until the next one.

    Args:
        equations: Equations to fit.
        samples: Motion and measured channels.
        factors: Weight by which each row is multiplied (N, C).
    """
    order, first = equations.order(samples)
    done = 0
    if compiled.available() and equations.straight and samples.covariance is None:
        for chunk in _compiled_chunks(equations, samples, factors, order, first):
            yield chunk
            done += chunk.samples
    if samples.covariance is not None:
        first = (0,) * len(first)  # Whitening mixes the channels.
    if done < len(samples):
        rest = None if factors is None else factors[done:]
        for rows in equations.rows(samples[done:] if done else samples, rest, order=order):
            yield Chunk(rows.shape[2], partial(_every, rows), partial(_grams, rows, first))


def _every(rows: np.ndarray, step: int) -> np.ndarray:
    return rows[:, :, ::step]


def _compiled_chunks(
    equations: Equations, samples: Samples, factors: np.ndarray | None, order: np.ndarray, first: Sequence[int]
) -> Iterator[Chunk]:
    """Yields chunks of equations with all columns written by a program, except constant ones, of a block at least."""
    program = equations.program(moving=samples.motion.base is not None, torques=False, order=order)
    memory = equations.block(compiled.COLUMN)
    program.fill(memory[: equations.parameters.rank].reshape(program.results, -1))
    numbers = np.array(program.numbers)
    size = max(CHUNK, INPUTS // (8 * max(program.inputs, 1)))
    for start in range(0, len(samples) - compiled.BLOCK + 1, size):
        part = samples[start : start + size]
        weights = None if factors is None else factors[start : start + size]

        def rows(step: int, part: Samples = part, weights: np.ndarray | None = weights) -> np.ndarray:
            some = None if weights is None else weights[::step]
            return np.concatenate([x.copy() for x in equations.rows(part[::step], some, order=order)], axis=2)

        def grams(
            factor: np.ndarray, noise: Memory, part: Samples = part, weights: np.ndarray | None = weights
        ) -> np.ndarray:
            arm, triangle = equations.mechanism, inverse_of(factor)
            inputs = program_inputs(arm.tree, part.motion, arm.gravity)
            given = numbers, inputs, memory, part.measured, weights, triangle, changing(triangle), first, noise
            return program.encoded.grams(*given)

        yield Chunk(len(part), rows, grams)


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Sufficient statistics of least squares for the samples so far.

    Attributes:
        names: Names of the r columns.
        factor: P, unit upper triangular with its columns in `order` (r + 1, r + 1).
        order: Order of the columns, the measurements last (r + 1,).
        grams: Gram matrix of the rows `[Y_b | Γ] P⁻¹` of each channel (C, r + 1, r + 1).
        samples: Number of samples.
        weighted: True if the rows are weighted, as by a covariance.
    """

    names: tuple[str, ...]
    factor: np.ndarray
    order: np.ndarray
    grams: np.ndarray
    samples: int
    weighted: bool

    @property
    def gram(self) -> np.ndarray:
        """Gram matrix of all rows in the coordinates of P (r + 1, r + 1)."""
        return self.grams.sum(axis=0)

    @property
    def root(self) -> np.ndarray:
        """Square matrix T such that `Tᵀ T` is the Gram matrix of all rows `[Y_b | Γ]` (r + 1, r + 1)."""
        return square_root(self.gram) @ self.factor

    @property
    def _triangle(self) -> np.ndarray:
        return self.factor[:, self.order]

    def with_chunk(self, chunk: Chunk) -> "Accumulator":
        """Accumulator with another chunk of samples."""
        now = replace(self, grams=self.grams + chunk.grams(self._triangle, None), samples=self.samples + chunk.samples)
        if _is_apart(now.gram, self._triangle):
            return now
        rows = np.vstack([self.root[:, self.order], chunk.rows(1).reshape(len(self.order), -1).T])
        factor = _factor(rows, self.order)
        # A triangular solve, not a product with the inverse: coordinates of a joint at rest are ill-conditioned.
        change = lapack.dtrtrs(factor[:, self.order], self._triangle.T, trans=1)[0].T
        renewed = replace(self, factor=factor, grams=change.T @ self.grams @ change)
        return replace(renewed, grams=renewed.grams + chunk.grams(renewed._triangle, None), samples=now.samples)


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
    factor: np.ndarray | None = None,
    factors: np.ndarray | None = None,
    before: Accumulator | None = None,
    checked: bool = False,
) -> Accumulator:
    """Accumulates samples, chunk by chunk.

    Args:
        equations: Equations to fit.
        samples: Motion and measured channels.
        factor: Coordinates to start from, by default those of some of the samples.
        factors: Weight by which each row is multiplied (N, C).
        before: Accumulator of samples to which these are added, by default none.
        checked: True for samples from `pieces`: for few samples a check costs as much as the sum.

    Returns:
        The accumulator of all samples.

    Raises:
        InputError: Samples do not fit the equations, or a covariance is not positive definite.
    """
    samples = samples if checked else equations.checked(samples)
    parts, (order, _) = chunks(equations, samples, factors), equations.order(samples)
    if before is None:
        first = next(parts)
        if factor is None:
            rows = first.rows(max(1, first.samples // max(PROBE, len(order))))
            factor = _factor(rows.reshape(len(order), -1).T, order)
        weighted, grams = samples.covariance is not None or factors is not None, np.zeros((1, *factor.shape))
        before = Accumulator(equations.names, factor, order, grams, 0, weighted).with_chunk(first)
    return reduce(Accumulator.with_chunk, parts, before)


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
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _is_apart(gram: np.ndarray, factor: np.ndarray) -> bool:
    """True if every column above rounding is far enough from the span of those before it.

    Args:
        gram: Gram matrix in coordinates (k, k).
        factor: These coordinates, triangular (k, k).
    """
    rounding = DEPENDENT**2 * (factor * (gram @ factor)).sum(axis=0)
    shown = gram + np.diag(np.where(rounding > 0, rounding, 1))
    triangle, failed = lapack.dpotrf(shown)
    return not failed and bool((triangle.diagonal() ** 2 > TOO_CLOSE * shown.diagonal()).all())


def remembered_sums(equations: Equations, samples: Samples, decay: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Gram matrices of all samples' `noise.remembered` columns (C, m, m).

    Args:
        equations: Equations of m columns and C channels.
        samples: Checked samples.
        decay: ρ of each channel's noise (C,).
        left: z of each channel at the sample before the first; overwritten by that of the last one (C, m).
    """
    order, _ = equations.order(samples)
    place, unchanged = np.argsort(order)[:-1], np.eye(len(order))
    last = np.column_stack([left, np.zeros(len(left))])[:, order]
    total = sum(chunk.grams(unchanged, (decay, last)) for chunk in chunks(equations, samples, None))
    left[:] = last[:, place]
    return np.asarray(total)[:, place[:, None], place]


def _grams(rows: np.ndarray, first: Sequence[int], factor: np.ndarray, memory: Memory) -> np.ndarray:
    """Gram matrices by BLAS (C, r + 1, r + 1).

    Args:
        rows: Columns first, in order (r + 1, C, n); changed in between and restored.
        first: First column that is not zero in each channel (C,).
        factor: Upper triangular (r + 1, r + 1).
        memory: As for a chunk.
    """
    inverse = inverse_of(factor)
    changed = changing(inverse)
    grams = np.zeros((rows.shape[1], len(rows), len(rows)))
    for c, (gram, start) in enumerate(zip(grams, first, strict=True)):
        own = changed[changed >= start]
        channel = rows[:, c]
        Z, before = channel[start:], channel[own]
        Z[own - start] = inverse[start:, own].T @ Z
        columns = Z
        if memory is not None:
            columns = remembered(Z, memory[0][c], memory[1][c, start:])
            memory[1][c, start:] = columns[:, -1]
        np.matmul(columns, columns.T, out=gram[start:, start:])
        channel[own] = before
    return grams


def changing(inverse: np.ndarray) -> np.ndarray:
    """Indices of the columns of a triangular matrix that differ from those of the identity."""
    return np.flatnonzero((inverse != np.eye(len(inverse))).any(axis=0))


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Inverse of a regular upper triangular matrix."""
    return lapack.dtrtri(factor)[0]


def excited(equations: Equations, samples: Samples) -> tuple[np.ndarray, ExcitationError | None]:
    """Singular values of the unit-norm columns, each channel divided by its scale, and an error if some are too small.

    The error names the parameters in combinations that the motion does not separate.
    """
    s, directions = _decomposed(equations, samples)
    hidden = directions[s <= s[0] / CONDITION_LIMIT]
    if not len(hidden):
        return s, None
    names = contributing(hidden, equations.names)
    return s, ExcitationError(
        f"In {listed(equations.channels)} the recorded motion excites {len(s) - len(hidden)} of {len(s)} "
        f"parameters; it does not separate {listed(names)}. Move the joints further (`multicontact excite` "
        "designs a motion), measure more, or put in what the model knows (--prior on).",
        names,
    )


def undetermined(equations: Equations, samples: Samples) -> tuple[str, ...]:
    """Names of the base parameters that lie mostly in combinations which the motion does not separate."""
    s, directions = _decomposed(equations, samples)
    hidden = (directions[s <= s[0] / CONDITION_LIMIT] ** 2).sum(axis=0)[: equations.parameters.rank]
    return tuple(name for name, share in zip(equations.names, hidden, strict=False) if share > MOSTLY)


def _decomposed(equations: Equations, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Singular values and right singular vectors of the unit-norm columns, each channel divided by its scale."""
    scales = channel_scales([samples.measured], equations.channels)
    weights = np.broadcast_to(1 / scales, samples.measured.shape)
    columns = accumulate(equations, samples, factors=weights).root[:, : len(equations.names)]
    norms = np.linalg.norm(columns, axis=0)
    # A decomposition of the triangle is faster than one of all rows, and less likely to fail to converge.
    _, s, directions = np.linalg.svd(triangle_of(columns / np.where(norms > 0, norms, 1)))
    return s, directions


def contributing(hidden: np.ndarray, names: Sequence[str]) -> list[str]:
    """Names of the columns that contribute notably to combinations that are not excited (k, r)."""
    size = np.linalg.norm(hidden, axis=0)
    return [name for name, share in zip(names, size, strict=True) if share > 0.1 * size.max()]


def separable(equations: Equations, samples: Samples) -> Equations:
    """Equations without the drives and offsets whose columns depend on those before them.

    Drives that are left out add to the coefficients that take them up (`absorbed`).

    Raises:
        InputError: Samples do not fit the equations.
    """
    columns = accumulate(equations, samples).root[:, : len(equations.names)]
    mask = independent(columns)
    kept = dict(zip(equations.names, mask, strict=True))
    without = replace(
        equations,
        drives=tuple(name for name in equations.drives if kept[name]),
        offsets=tuple(k for k in equations.offsets if kept[f"offset({equations.channels[k]})"]),
    )
    rank, count = equations.parameters.rank, equations.parameters.rank + len(equations.drives)
    stays = mask[:count] | (np.arange(count) < rank)
    if stays.all():
        return without
    sizes = np.maximum(np.linalg.norm(columns[:, :count], axis=0), 1e-300)
    unit, names = columns[:, :count] / sizes, np.array(equations.names[:count])
    combined = np.linalg.lstsq(unit[:, stays], unit[:, ~stays], rcond=INDEPENDENT)[0]
    units = combined.T * sizes[~stays, None] / sizes[stays]
    absorbed = {name: each[stays] + each[~stays] @ units for name, each in equations.absorbed.items()}
    absorbed |= dict(zip(names[~stays].tolist(), units, strict=True))
    takes = {*names[stays][(np.abs(combined) > MIXED).any(axis=1)].tolist(), *equations.mixed}
    of_motors = tuple(f"({motor})" for motor in equations.axes.motors)
    mixed = (name for name in without.drives if name in takes and name.endswith(of_motors))
    return replace(without, absorbed=absorbed, mixed=tuple(mixed))


def independent(columns: np.ndarray) -> np.ndarray:
    """Mask of the columns of a matrix (m, k) that are independent of those before them (k,)."""
    # Not by the diagonal of a triangular factor, which lacks a part of the columns after a dependent one.
    sizes, basis = np.linalg.norm(columns, axis=0), np.zeros_like(columns)
    stick_out = np.zeros(len(sizes), bool)
    for k, (column, size) in enumerate(zip(columns.T, sizes, strict=True)):
        out = column
        for _ in range(2):  # One pass leaves rounding errors along the others.
            out = out - basis @ (basis.T @ out)
        stick_out[k] = size > ZERO_COLUMN * sizes.max() and np.linalg.norm(out) > INDEPENDENT * size
        if stick_out[k]:
            basis[:, k] = out / np.linalg.norm(out)
    return stick_out
