"""Rows of equations chunk by chunk, and their Gram matrices in coordinates of a triangular factor.

    G_c = Tᵀ R_cᵀ R_c T,     R_c the rows [Y_b | Γ] of a channel,  T = P⁻¹ upper triangular

numpy computes the rows of some thousand samples and hands them to BLAS. Compiled code, where there is some, does all
with some hundred samples while they are in the inner caches.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.model import compiled
from ident.model.regressor import CHUNK, program_inputs

INPUTS = 2**20
"""Bytes of a program's inputs that compiled code is called for at once, if they are of `CHUNK` samples at least."""

SMALL = 16
"""Columns below which a general matrix product is faster than a symmetric one."""


class Chunk(NamedTuple):
    """Some samples of equations.

    Attributes:
        samples: Their number n.
        rows: Gives the rows of all or of every so-manieth sample, columns `[Y_b | Γ]` in their order (r + 1, C, n).
        grams: Gives Gram matrices in coordinates of an upper triangular factor (C, r + 1, r + 1).
    """

    samples: int
    rows: Callable[[int], np.ndarray]
    grams: Callable[[np.ndarray], np.ndarray]


def chunks(equations: Equations, samples: Samples, factors: np.ndarray | None) -> Iterator[Chunk]:
    """Samples that fit, chunk by chunk; what a chunk gives is there until the next one.

    Args:
        equations: What is fitted.
        samples: Motion and measured channels.
        factors: What each row is multiplied by (N, C).
    """
    order, first = equations.order(samples)
    if compiled.available() and _suits_compiled(equations, samples):
        yield from _compiled_chunks(equations, samples, factors, order, first)
        return
    if samples.covariance is not None:
        first = (0,) * len(first)  # Whitening mixes the channels.
    for rows in equations.rows(samples, factors, order=order):
        yield Chunk(rows.shape[2], partial(_every, rows), partial(_grams, rows, first))


def _every(rows: np.ndarray, step: int) -> np.ndarray:
    return rows[:, :, ::step]


def _suits_compiled(equations: Equations, samples: Samples) -> bool:
    return equations.straight and samples.covariance is None


def _compiled_chunks(
    equations: Equations, samples: Samples, factors: np.ndarray | None, order: np.ndarray, first: Sequence[int]
) -> Iterator[Chunk]:
    """Chunks of equations whose columns a program writes, but for constant ones."""
    program = equations.program(moving=samples.motion.base is not None, torques=False, order=order)
    memory = equations.block(compiled.COLUMN)
    program.fill(memory[: equations.parameters.rank].reshape(program.results, -1))
    numbers = np.array(program.numbers)
    size = max(CHUNK, INPUTS // (8 * max(program.inputs, 1)))
    for start in range(0, len(samples), size):
        part = samples[start : start + size]
        weights = None if factors is None else factors[start : start + size]

        def rows(step: int, part: Samples = part, weights: np.ndarray | None = weights) -> np.ndarray:
            some = None if weights is None else weights[::step]
            return np.concatenate([x.copy() for x in equations.rows(part[::step], some, order=order)], axis=2)

        def grams(factor: np.ndarray, part: Samples = part, weights: np.ndarray | None = weights) -> np.ndarray:
            if len(part) < compiled.BLOCK:
                return _grams(rows(1, part, weights), first, factor)
            inputs = program_inputs(part.motion, equations.mechanism.gravity)
            triangle = inverse_of(factor)
            changed = changing(triangle)
            return program.encoded.grams(numbers, inputs, memory, part.measured, weights, triangle, changed, first)

        yield Chunk(len(part), rows, grams)


def _grams(rows: np.ndarray, first: Sequence[int], factor: np.ndarray) -> np.ndarray:
    """Gram matrices by BLAS (C, r + 1, r + 1).

    Args:
        rows: Columns first, in their order (r + 1, C, n); in the end they are as they were.
        first: The first column that each channel sees (C,).
        factor: Upper triangular (r + 1, r + 1).
    """
    inverse = inverse_of(factor)
    changed = changing(inverse)
    grams = np.zeros((rows.shape[1], len(rows), len(rows)))
    for gram, channel, start in zip(grams, np.moveaxis(rows, 1, 0), first, strict=True):
        own = changed[changed >= start]
        Z, before = channel[start:], channel[own]
        Z[own - start] = inverse[start:, own].T @ Z
        # Times itself numpy takes it to BLAS's symmetric product, which is slower than the general one if it is small.
        np.matmul(Z, (Z.copy() if len(Z) < SMALL else Z).T, out=gram[start:, start:])
        channel[own] = before
    return grams


def changing(inverse: np.ndarray) -> np.ndarray:
    """Which columns a triangular matrix changes that others are multiplied with."""
    return np.flatnonzero((inverse != np.eye(len(inverse))).any(axis=0))


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Inverse of a regular upper triangular matrix."""
    return lapack.dtrtri(factor)[0]
