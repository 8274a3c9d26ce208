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

REPEATED = 2.0
"""Median variance of sums of residuals, over that of independent periods, above which their errors are repeated."""

MOST = 1_000_000
"""Largest number of equal steps that a recording takes, with its pauses; a longer one takes longer steps."""


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
    number = np.maximum(there.sum(axis=0), 1)
    x = x - np.where(there, x, 0).sum(axis=0) / number
    spread = np.where(there, x**2, 0).sum(axis=0) / number
    moves = noise**2 < RESTS * spread
    if not moves.any():
        return np.inf
    pairs, products, squares = (each[: len(x) // 2] for each in of_pairs(x[:, moves]))
    apart = np.where(
        pairs > FEWEST * number[moves],
        (squares - products) / (spread[moves] * np.maximum(pairs, 1)) - noise[moves] ** 2 / spread[moves],
        np.inf,
    )
    same = apart.max(axis=1) < SAME
    between = apart.mean(axis=1)
    same &= np.logical_or.accumulate((between > OTHER) & (between < np.inf))
    if not same.any():
        return np.inf
    first = int(np.argmax(same))
    run = first + int(np.argmin(np.append(same[first:], False)))
    return step * (first + int(np.argmin(apart.max(axis=1)[first:run])))


def on_grid(times: Sequence[np.ndarray], values: Sequence[np.ndarray]) -> tuple[float, np.ndarray]:
    """Step of the slowest column's samples, s, and values at such steps, at most `MOST`, NaN for none (N, c)."""
    time, x = np.concatenate(times), np.concatenate(values)
    there = [np.flatnonzero(own) for own in np.isfinite(x).T]
    step = max(np.ptp(time) / MOST, *(np.median(np.diff(time[own])) for own in there if len(own) > 1), 1e-9)
    at = np.round((time - time[0]) / step).astype(int)
    out = np.full((at[-1] + 1, len(there)), np.nan)
    for k, own in enumerate(there):
        out[at[own], k] = x[own, k]
    return step, out


def of_pairs(x: np.ndarray) -> np.ndarray:
    """Number of pairs of samples k apart, and sums of their products and of their mean squares (3, N, c)."""
    there, size = np.isfinite(x), fft.next_fast_len(2 * len(x), real=True)
    number, values = there.astype(float), np.where(there, x, 0.0)
    a, b, c = (fft.rfft(signal, size, axis=0) for signal in (number, values, values**2))
    sums = [fft.irfft(each, size, axis=0) for each in (abs(a) ** 2, abs(b) ** 2, (c * a.conj()).real)]
    return np.array(sums)[:, : len(x)]


def repetition(times: Sequence[np.ndarray], residuals: Sequence[np.ndarray], period: float) -> np.ndarray:
    """Variance of the sum of residuals over that of independent periods, at least one (c,).

    Args:
        times: Times of samples, s (N,) each.
        residuals: Residuals, NaN where there is none (N, c) each.
        period: Period of the motion, s, infinite for none.
    """
    out = np.ones(residuals[0].shape[1])
    if period == np.inf:
        return out
    for k in range(len(out)):
        step, e = on_grid(times, [x[:, [k]] for x in residuals])
        _, products, squares = of_pairs(e)[..., 0]
        lags = np.round(np.arange(1, len(e) * step / period) * period / step).astype(int)
        lags = lags[lags < len(e)]
        r = products[lags].sum() / max(squares[lags].sum(), 1e-300)
        out[k] += max(np.isfinite(e).sum() * step / period - 1, 0) * max(r, 0)
    return out
