"""What every stream says of its noise: what its variance and smoothness are estimated from.

A stream's rows J of the trajectory and T of θ take `tr(H⁻¹ H_m)` of its samples, H being the whole curvature and H_m
the stream's part of it (Wood and Fasiolo, Biometrics 73, 2017, doi:10.1111/biom.12666). With the trajectory eliminated,

    tr(H⁻¹ H_m) = tr(J A⁻¹ Jᵀ) + tr(Eᵀ E Σ),     E = T - J A⁻¹ B,     Σ the covariance of θ

which becomes known when all pieces are.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ident.estimation.arrow import Eliminated, stacked
from ident.estimation.spline import ORDER, Spline
from ident.estimation.whitening import Rows

TOGETHER = 32
"""Intervals whose rows are worked on together, so that they stay in the cache."""


class Stream(NamedTuple):
    """What the streams of one kind say of their noise: by innovations, by their slow halves, and by their fast ones.

    Attributes:
        squares: Sums of squares in standard deviations, of innovations clipped (3, s).
        number: What they would be on average were the noise not fitted: how many samples, and parts of these (3, s).
        taken: Part of these that the trajectory takes; for halves zero where ρ is (3, s).
        by_theta: Squares of what θ takes, its covariance's share still to be put in; likewise (3, s, p, p).
    """

    squares: np.ndarray
    number: np.ndarray
    taken: np.ndarray
    by_theta: np.ndarray


def channel_streams(rows: Rows, eliminated: Eliminated) -> Stream:
    """Of rows that see all coordinates (s = C)."""
    S, _, C, w = rows.windows.shape
    inverse, by_theta = eliminated.inverse.reshape(S, w, w), eliminated.windows.reshape(S, w, -1)
    return Stream(rows.squares, rows.number, *_taken(rows, slice(0, C), inverse, by_theta))


def state_streams(rows: Mapping[int, Rows], eliminated: Eliminated) -> Stream:
    """Of coordinates, velocities and accelerations, one after the other (s = 3 n); zeros of what is not measured.

    Args:
        rows: Rows whose streams see one coordinate each, by the order of the derivative.
        eliminated: The normal equations.
    """
    n, p = eliminated.windows.shape[2:]
    nothing = np.zeros((3, n))
    kinds = [Stream(nothing, nothing, nothing, np.zeros((3, n, p, p)))] * 3
    for kind, own in rows.items():
        seen = [(eliminated.inverse[:, :, j, :, j], eliminated.windows[:, :, j]) for j in range(n)]
        parts = [_taken(own, slice(j, j + 1), *seen[j]) for j in range(n)]
        taken, squares = (np.concatenate(x, axis=1) for x in zip(*parts, strict=True))
        kinds[kind] = Stream(own.squares, own.number, taken, squares)
    return Stream(*(np.concatenate(x, axis=1) for x in zip(*kinds, strict=True)))


def penalty_streams(spline: Spline, coefficients: np.ndarray, jerk: np.ndarray, eliminated: Eliminated) -> Stream:
    """Of the prior with λ (n,) at coefficients (size, n), which has no halves: fields (n,), by_theta (n, p, p).

    `squares` is `∫ x⃛² dt`, `number` the rank.
    """
    n, R = len(jerk), spline.penalty_root
    curvature = [(eliminated.inverse[:, 1:, j, 1:, j].sum(axis=0) * spline.penalty).sum() for j in range(n)]
    squares = [weight * _squared(R @ eliminated.windows[:, 1:, j]) for j, weight in enumerate(jerk)]
    rank = np.full(n, float(spline.size - ORDER))
    return Stream(spline.squared_jerk(coefficients), rank, jerk * np.array(curvature), np.array(squares))


def _taken(rows: Rows, which: slice, inverse: np.ndarray, by_theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`tr(J A⁻¹ Jᵀ)` (3, s) and `Eᵀ E` (3, s, p, p) of some streams that see the same functions.

    Args:
        rows: Rows, of windows of w functions.
        which: Which of their streams.
        inverse: What these windows see of `A⁻¹` (S, w, w).
        by_theta: What they see of `A⁻¹ B` (S, w, p).
    """
    first, last = np.searchsorted(rows.coloured, (which.start, which.stop))
    parts = [(rows.windows[:, :, which], rows.border[:, :, which], np.arange(which.stop - which.start))]
    for half in rows.halves:
        own = rows.coloured[first:last] - which.start
        parts.append((half.windows[:, :, first:last], half.border[:, :, first:last], own))
    streams, p = which.stop - which.start, by_theta.shape[-1]
    taken, squares = np.zeros((3, streams)), np.zeros((3, streams, p, p))
    for k, (windows, border, own) in enumerate(parts):
        for start in range(0, len(windows), TOGETHER):
            some = slice(start, start + TOGETHER)
            # All streams of an interval in one product: few large ones are faster than many small ones.
            J = windows[some].reshape(len(windows[some]), -1, windows.shape[3])
            E = (J @ by_theta[some]).reshape(*border[some].shape[:3], p)
            E[..., rows.columns] -= border[some]
            taken[k, own] += np.einsum("imsw,imsw->s", (J @ inverse[some]).reshape(windows[some].shape), windows[some])
            for s, stream in enumerate(own):
                squares[k, stream] += _squared(E[:, :, s])
    return taken, squares


def _squared(E: np.ndarray) -> np.ndarray:
    """`Eᵀ E` over all leading dimensions (…, p) -> (p, p)."""
    rows = stacked(E)
    return rows.T @ rows
