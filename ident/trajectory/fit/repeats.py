"""Motions that recordings repeat. What no model explains repeats with them, so that it is counted once.

    D(T) = <(q(t + T) - q(t))²> / (2 var q)        small for every joint that moves: q repeats after T

If residuals repeat as well, pairs of samples in two periods have r times the covariance of such a pair in one, with the
residuals' correlation r at equal phases, one of periods of a recording and one of different recordings. The sum of the
scores of n alike periods then has the variance

    n σ² (1 + (n - 1) r)

instead of n σ²: n periods tell little more than one. Recordings of the same motion are periods of one that has all of
them in a row.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import fft

from ident.estimation.measurement import Measurement
from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.fit.piece import Piece, Point, residual, residual_of_coordinates

SAME, OTHER = 0.01, 0.25
"""D of every joint below which a motion repeats, its noise aside, and mean D that it has between, so that a period is
no short time: the trials of a surgical arm have 1e-5 after 6.48 s, a UR10's at least .3."""

RESTS = 0.1
"""Variance of a joint's noise over that of its motion above which it does not count as moving."""

FEWEST = 0.25
"""Least share of the samples that have a partner one period later."""

REPEATED = 1.5
"""Median variance of sums of residuals, over that of independent periods, above which their errors are repeated: of two
periods, which have at most 2, with a correlation of a half."""

MOST = 1_000_000
"""Largest number of equal steps that a recording takes, with its pauses; a longer one takes longer steps."""


class RepeatedMotion(NamedTuple):
    """Recordings of one motion, in a row and in phase as if they were one recording of several periods.

    Attributes:
        starts: Time to add to the times of each recording, s, by its index.
        period: Time after which the motion repeats within a recording, s, infinite for none.
        apart: Time between recordings in the row, s, a multiple of the period.
        correlation: Correlations r of the residuals of all coordinates and channels at the same phase of two periods of
            one recording, and of two recordings, which is not more; at least zero (2, n + C).
        factor: Variance of their sums over that of independent periods, `1 + (n - 1) r` of alike ones (n + C,).
    """

    starts: dict[int, float]
    period: float
    apart: float
    correlation: np.ndarray
    factor: np.ndarray

    @property
    def lag(self) -> float:
        """Time after which the motion repeats in the row, s, infinite for none."""
        return self.apart if len(self.starts) > 1 and self.period == np.inf else self.period


def trials(fit: TrajectoryFit) -> list[RepeatedMotion]:
    """Recordings of a fit by the motion that they make, as if nothing but the motion repeated."""
    logs = [[piece for piece in fit.pieces if piece.log == log] for log in range(len(fit.noises))]
    nothing = np.zeros(len(fit.coordinate_noise) + len(fit.channel_noise))
    out, longest = list[RepeatedMotion](), max(float(own[-1].time[-1] - own[0].time[0]) for own in logs)
    for log, (own, noise) in enumerate(zip(logs, fit.noises, strict=True)):
        for each in out:
            first = min(each.starts)
            both = np.hypot(noise.states, fit.noises[first].states) / np.sqrt(2)
            if (late := lateness(logs[first], own, both, longest)) < np.inf:
                each.starts[log] = len(each.starts) * each.apart - late
                break
        else:
            T = period(own, noise.states)
            apart = T * float(np.ceil(2 * longest / T)) if np.isfinite(T) else 2 * longest
            out.append(RepeatedMotion({log: 0.0}, T, apart, np.stack([nothing, nothing]), nothing + 1))
    return out


def repetitions(measurement: Measurement, fit: TrajectoryFit) -> list[RepeatedMotion]:
    """Motions of a fit, and what repeats with them of the residuals."""
    out = trials(fit)
    for k, motion in enumerate(out):
        if motion.lag < np.inf:
            # Of all pieces: some of them have few partners one period later, or none.
            own = [(point, motion.starts[point.piece.log]) for point in fit.points if point.piece.log in motion.starts]
            times, when = [at.piece.time + x for at, x in own], [at.piece.when + x for at, x in own]
            states = [residual_of_coordinates(measurement, at) / at.noise.states for at, _ in own]
            channels = [_clear(measurement, at) for at, _ in own]
            both = repetition(times, states, motion), repetition(when, channels, motion)
            *correlation, factor = np.concatenate(both, axis=1)
            out[k] = motion._replace(correlation=np.array(correlation), factor=factor)
    return out


def _clear(measurement: Measurement, at: Point) -> np.ndarray:
    """Residuals of the channels over their noise, NaN where more than noise is expected (M, C)."""
    left = residual(measurement, at) / at.noise.channels
    return left if at.piece.slack is None else np.where(at.piece.slack < at.noise.channels, left, np.nan)


def repeating(measurement: Measurement, fit: TrajectoryFit) -> list[RepeatedMotion]:
    """Repeated motions whose errors repeat with the motion, in periods or recordings, by the median of the channels."""
    number = len(fit.channel_noise)
    every = repetitions(measurement, fit)
    return [each for each in every if np.median(each.factor[-number:]) > REPEATED]


def period(pieces: Sequence[Piece], noise: np.ndarray) -> float:
    """Time after which the measured coordinates of a recording repeat, s, infinite for none.

    Args:
        pieces: Pieces of the recording.
        noise: Standard deviations of the coordinates (n,).
    """
    step, D = _differences([piece.time for piece in pieces], pieces, noise)
    worst = D.max(axis=1)
    D = D[: len(D) // 2]
    same, between = worst[: len(D)] < SAME, D.mean(axis=1)
    same &= np.logical_or.accumulate((between > OTHER) & (between < np.inf))
    if not same.any():
        return np.inf
    first = int(np.argmax(same))
    run = first + int(np.argmin(np.append(same[first:], False)))
    # The last of many periods is out of phase unless the period is known to a small part of a step.
    lag, number = first + int(np.argmin(worst[first:run])), 1
    while 2 * lag + 1 < len(worst) and (around := worst[2 * lag - 1 : 2 * lag + 2]).min() < SAME:
        lag, number = 2 * lag - 1 + int(np.argmin(around)), 2 * number
    return step * lag / number


def lateness(first: Sequence[Piece], other: Sequence[Piece], noise: np.ndarray, longest: float) -> float:
    """Time by which a recording makes the motion of a first one later, by their own clocks, s, infinite for never.

    Args:
        first: Pieces of the first recording.
        other: Pieces of the other recording.
        noise: Standard deviations of the coordinates, root mean square of both (n,).
        longest: Length of the longer one or more, s.
    """
    start = first[0].time[0] - other[0].time[0] + 2 * longest
    times = [*(piece.time for piece in first), *(piece.time + start for piece in other)]
    step, D = _differences(times, [*first, *other], noise)
    # Samples of one recording are never so far apart.
    across = int(longest / step) + 2
    best = across + int(np.argmin(D[across:].max(axis=1)))
    return float(step * best - start) if D[best].max() < SAME else np.inf


def _differences(times: Sequence[np.ndarray], pieces: Sequence[Piece], noise: np.ndarray) -> tuple[float, np.ndarray]:
    """Step of lags, s, and D of the joints that move by lag (N, k).

    It is infinite where too few samples have a partner, or where all joints rest in those that have one.
    """
    step, x = on_grid(times, [piece.states for piece in pieces])
    there = np.isfinite(x)
    number = np.maximum(there.sum(axis=0), 1)
    x = x - np.where(there, x, 0).sum(axis=0) / number
    spread = np.where(there, x**2, 0).sum(axis=0) / number
    moves = noise**2 < RESTS * spread
    if not moves.any():
        return step, np.full((len(x), 1), np.inf)
    number, spread, least = number[moves], spread[moves], noise[moves] ** 2
    pairs, products, squares, sums = of_pairs(x[:, moves])
    mean, square = (each / np.maximum(pairs, 1) for each in (sums, squares))
    D = (square - products / np.maximum(pairs, 1) - least) / spread
    live = ((square - mean**2) / spread).max(axis=1, keepdims=True) > OTHER
    return step, np.where((pairs > FEWEST * number) & live, D, np.inf)


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
    """Number of pairs of samples k apart, and sums of their products, mean squares and means (4, N, c)."""
    there, size = np.isfinite(x), fft.next_fast_len(2 * len(x), real=True)
    number, values = there.astype(float), np.where(there, x, 0.0)
    a, b, c = (fft.rfft(signal, size, axis=0) for signal in (number, values, values**2))
    spectra = abs(a) ** 2, abs(b) ** 2, (c * a.conj()).real, (b * a.conj()).real
    sums = [fft.irfft(each, size, axis=0) for each in spectra]
    return np.array(sums)[:, : len(x)]


def repetition(
    times: Sequence[np.ndarray], residuals: Sequence[np.ndarray], motion: RepeatedMotion
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Correlations as of `RepeatedMotion`, and variance of sums over that of independent periods (c,) each.

    Args:
        times: Times of samples in the row of recordings, s (N,) each.
        residuals: Residuals, NaN where there is none (N, c) each.
        motion: The motion, which repeats.
    """
    out = np.empty((3, residuals[0].shape[1]))
    for k in range(out.shape[1]):
        step, e = on_grid(times, [x[:, [k]] for x in residuals])
        pairs, products = of_pairs(e)[:2, :, 0]
        every = np.round(np.arange(1, len(e) * step / motion.lag) * motion.lag / step).astype(int)
        every = every[every < len(e)]
        # Recordings are shorter than half of the time between them.
        near, mean = every * step < motion.apart / 2, max(products[0], 1e-300) / max(pairs[0], 1)
        within, across = (
            float(np.clip(products[own].sum() / (max(pairs[own].sum(), 1) * mean), 0, 1))
            for own in (every[near], every[~near])
        )
        out[:, k] = max(within, across), across, 1 + max(2 * products[every].sum() / max(products[0], 1e-300), 0)
    return out[0], out[1], out[2]
