"""Motions that a recording repeats. What no model explains repeats with them, so that it is counted once.

    D(T) = <(q(t + T) - q(t))²> / (2 var q)        small for every joint that moves: q repeats after T

If residuals repeat as well, with correlation r one period apart, the sum of n periods' scores has the variance

    n σ² (1 + (n - 1) r)

instead of n σ²: n periods tell little more than one.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import fft

from ident.estimation.measurement import Measurement
from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.fit.piece import Piece, residual
from ident.trajectory.fit.response import Response

SAME, OTHER = 0.01, 0.25
"""D of every joint below which a motion repeats, its noise aside, and mean D that it has between, so that a period is
no short time: the trials of a surgical arm have 1e-5 after 6.48 s, a UR10's at least .3."""

RESTS = 0.1
"""Variance of a joint's noise over that of its motion above which it does not count as moving."""

FEWEST = 0.25
"""Least share of the samples that have a partner one period later."""


def repetitions(fit: TrajectoryFit, responses: Mapping[int, Response]) -> list[list[np.ndarray]]:
    """Repetition of every recording's streams, as `repetition` has it, (s,) each.

    Args:
        fit: The fit.
        responses: Linear responses of some of its pieces, by index.
    """
    out = list[list[np.ndarray]]()
    for log, noise in enumerate(fit.noises):
        own = [here for k, here in responses.items() if fit.pieces[k].log == log]
        T = period([piece for piece in fit.pieces if piece.log == log], noise.states)
        streams = zip(*(here.streams for here in own), strict=True)
        out.append(
            [
                repetition([x.time for x in each], [np.where(x.clear, x.residual, np.nan) for x in each], T)
                for each in streams
            ]
        )
    return out


def repeating(measurement: Measurement, fit: TrajectoryFit) -> dict[int, tuple[float, float]]:
    """Period, s, and repetition of the channels, their median, of the recordings whose motions repeat, by index."""
    out = dict[int, tuple[float, float]]()
    for log, noise in enumerate(fit.noises):
        every = zip(fit.pieces, fit.coefficients, fit.selections, strict=True)
        own = [(piece, c, fit.theta[at]) for piece, c, at in every if piece.log == log]
        if (T := period([piece for piece, *_ in own], noise.states)) < np.inf:
            left = [residual(measurement, *place) for place in own]
            out[log] = T, float(np.median(repetition([piece.when for piece, *_ in own], left, T)))
    return out


def period(pieces: Sequence[Piece], noise: np.ndarray) -> float:
    """Time after which the measured coordinates of a recording repeat, s, infinite for none.

    Args:
        pieces: Pieces of the recording.
        noise: Standard deviations of the coordinates (n,).
    """
    step, x = on_grid([piece.time for piece in pieces], [piece.states for piece in pieces])
    there = np.isfinite(x)
    spread = np.nanvar(x, axis=0)
    moves = noise**2 < RESTS * spread
    if not moves.any():
        return np.inf
    x, there, spread = x[:, moves], there[:, moves].astype(float), spread[moves]
    x = np.where(there > 0, x - np.nanmean(x, axis=0), 0.0)
    half, size = len(x) // 2, fft.next_fast_len(2 * len(x), real=True)
    of_pairs, of_squares, of_motion = (fft.rfft(signal, size, axis=0) for signal in (there, x**2, x))

    def lagged(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(fft.irfft(a * b.conj(), size, axis=0)[:half])

    pairs = np.maximum(lagged(of_pairs, of_pairs), 1.0)
    squares = lagged(of_squares, of_pairs) + lagged(of_pairs, of_squares) - 2 * lagged(of_motion, of_motion)
    apart = np.where(
        pairs > FEWEST * there.sum(axis=0), squares / (2 * spread * pairs) - noise[moves] ** 2 / spread, np.inf
    )
    same = apart.max(axis=1) < SAME
    same &= np.logical_or.accumulate(apart.mean(axis=1) > OTHER)
    if not same.any():
        return np.inf
    first = int(np.argmax(same))
    run = first + int(np.argmin(np.append(same[first:], False)))
    return step * (first + int(np.argmin(apart.max(axis=1)[first:run])))


def on_grid(times: Sequence[np.ndarray], values: Sequence[np.ndarray]) -> tuple[float, np.ndarray]:
    """Step of samples, s, and their values at equal steps, NaN between pieces (N, c)."""
    step = float(np.median(np.concatenate([np.diff(time) for time in times])))
    first = min(time[0] for time in times)
    at = [np.round((time - first) / step).astype(int) for time in times]
    out = np.full((max(own[-1] for own in at) + 1, values[0].shape[1]), np.nan)
    for own, each in zip(at, values, strict=True):
        out[own] = each
    return step, out


def repetition(times: Sequence[np.ndarray], residuals: Sequence[np.ndarray], period: float) -> np.ndarray:
    """Variance of the sum of residuals over that of independent periods, at least one (c,).

    Args:
        times: Times of samples, s (N,) each.
        residuals: Residuals, NaN where there is none (N, c) each.
        period: Period of the motion, s, infinite for none.
    """
    if period == np.inf:
        return np.ones(residuals[0].shape[1])
    step, e = on_grid(times, residuals)
    number, products = len(e) * step / period, np.zeros((2, e.shape[1]))
    for lag in np.round(np.arange(1, number) * period / step).astype(int):
        later, earlier = e[lag:], e[: len(e) - lag]
        products += np.nansum([later * earlier, (later**2 + earlier**2) / 2 + 0 * later * earlier], axis=1)
    r = products[0] / np.maximum(products[1], 1e-300)
    return np.asarray(1 + (number - 1) * np.maximum(r, 0))
