"""Rows of equations chunk by chunk, and their Gram matrices in the coordinates of a triangular factor.

    G_c = Tᵀ R_cᵀ R_c T,     R_c the rows [Y_b | Γ] of a channel,  T = P⁻¹ upper triangular

numpy computes the rows of some thousand samples and passes them to BLAS. Compiled code, if available, does everything
for some hundred samples while they are in the inner caches.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ident.estimation.equations import Equations
from ident.estimation.noise import remembered
from ident.estimation.samples import Samples
from ident.model import compiled
from ident.model.regressor import CHUNK, program_inputs

INPUTS = 2**20
"""Bytes of inputs per call of compiled code, which takes `CHUNK` samples at least."""

SMALL = 16
"""Columns below which a general matrix product is faster than a symmetric one."""

Memory = tuple[np.ndarray, np.ndarray] | None
"""ρ of each channel's noise (C,), and its last z (C, r + 1), which is overwritten; see `noise.remembered`."""


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
            inputs, triangle = program_inputs(part.motion, equations.mechanism.gravity), inverse_of(factor)
            given = numbers, inputs, memory, part.measured, weights, triangle, changing(triangle), first, noise
            return program.encoded.grams(*given)

        yield Chunk(len(part), rows, grams)


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
        # numpy computes Z Zᵀ by BLAS's symmetric product, which is slower than the general one for small Z: hence copy.
        np.matmul(columns, (columns.copy() if len(Z) < SMALL else columns).T, out=gram[start:, start:])
        channel[own] = before
    return grams


def changing(inverse: np.ndarray) -> np.ndarray:
    """Indices of the columns of a triangular matrix that differ from those of the identity."""
    return np.flatnonzero((inverse != np.eye(len(inverse))).any(axis=0))


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Inverse of a regular upper triangular matrix."""
    return lapack.dtrtri(factor)[0]
