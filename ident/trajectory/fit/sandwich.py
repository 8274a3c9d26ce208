"""Sandwich covariance of the trajectory estimate, valid if the fit's noise model is wrong.

    cov θ = P⁻¹ M P⁻¹,        M = prior + Σ Mᵀ λP M + Σ (1 - r) (W R)ᵀ Γ (W R) + r uᵀ Γ u

P is the precision of θ, W the weights of the working model, R the rows of θ and M what the smoothness takes of the
motion (`ident.trajectory.fit.response`), Γ the covariance of the noise estimated independently of the weights
(`ident.trajectory.fit.noise_colours`), and r the correlation of residuals where motions repeat
(`ident.trajectory.fit.repeats`), with the sum u over recordings and periods at equal phases.
Working weights with such a covariance are those of generalised estimating equations (Liang and Zeger, Biometrika 73,
1986, doi:10.1093/biomet/73.1.13).
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.noise import autoregressive
from ident.trajectory.algebra.arrow import stacked
from ident.trajectory.fit.fitted import TrajectoryFit, share
from ident.trajectory.fit.noise_colours import NoiseColours, noise_colours, response_of, some_responses
from ident.trajectory.fit.piece import Piece
from ident.trajectory.fit.repeats import RepeatedMotion, repetitions

LITTLE = 0.01
"""Correlation up to which rows are taken as alike in all periods, without sums: chance makes that of 10,000 samples,
and sums of long recordings take much memory."""

ALL = -1
"""Index of what repeats in all recordings of a motion, beside those of recordings."""


def with_scatter(measurement: Measurement, fit: TrajectoryFit, *, every: bool = True) -> TrajectoryFit:
    """Fit with the covariance of its gradient under the estimated noise.

    Args:
        measurement: Channels and parameters.
        fit: The fit, with or without the shares of its pieces.
        every: True for all pieces; False for as many as the noise is estimated from, enough for decisions, and of the
            others by numbers of samples.
    """
    responses = some_responses(measurement, fit)
    if not fit.shares:
        pieces = (responses.get(k) or response_of(measurement, fit, k) for k in range(len(fit.pieces)))
        equations = zip((here.eliminated for here in pieces), fit.selections, strict=True)
        fit = replace(fit, shares=[share(x.precision, x.gradient, own, len(fit.theta)) for x, own in equations])
    colours, scatters, tails = noise_colours(fit, responses), [], _Tails()
    repeated = [_Repeated(each, fit) for each in repetitions(measurement, fit)]
    of_log = {log: each for each in repeated for log in each.motion.starts}
    chosen, last = list(range(len(fit.pieces)) if every else responses), {x.log: k for k, x in enumerate(fit.pieces)}
    for k in chosen:
        if k - 1 not in chosen or not _goes_on(fit, k):
            tails = _Tails()
        here, own = responses.pop(k, None) or response_of(measurement, fit, k), fit.selections[k]
        scatter, again = here.scatter_of_motion, of_log[fit.pieces[k].log]
        motion = again.motion
        first = np.cumsum([0, *(len(stream.std) for stream in here.streams)]).tolist()
        # A share of the pieces has few partners one period later: its rows, too, are taken as alike in all periods.
        summed = every & (motion.correlation[0] > LITTLE)
        alone = np.where(summed, 1 - motion.correlation[0], motion.factor)
        for which, stream in enumerate(here.streams):
            for some, rows in here.blocks(which):
                pulls = stream.weighted(rows, some)
                if (beyond := stream.beyond_noise[:, some]).any():
                    loose = stacked(beyond[..., None] * pulls)
                    scatter += loose.T @ loose
                pulls *= stream.std[some, None]
                halves = np.empty_like(pulls)
                for at, s in enumerate(range(len(stream.std))[some]):
                    signal = which, s, first[which] + s
                    halves[:, at] = alone[signal[2]] * _half(pulls[:, at], colours, which, s, stream.step, tails)
                    if summed[signal[2]]:
                        again.add(signal, fit.pieces[k].log, stream.time, own, pulls[:, at])
                across = stacked(pulls).T @ stacked(halves)
                scatter += across + across.T
        if every and k == last[fit.pieces[k].log]:
            again.end(fit.pieces[k].log, colours)
        whole = np.zeros_like(fit.shares[k][0])
        whole[np.ix_(own, own)] = scatter
        scatters.append(whole)
    for again in repeated if every else ():
        across, within = again.scatters(colours)
        for log, total in within.items():
            samples = {k: len(piece.when) for k, piece in enumerate(fit.pieces) if piece.log == log}
            for k, number in samples.items():
                scatters[k] += number / sum(samples.values()) * total
        scatters.append(across)
    of_chosen = replace(fit, pieces=[fit.pieces[k] for k in chosen], scatters=scatters)
    return of_chosen if every else replace(fit, scatters=by_samples(of_chosen, fit.pieces))


class _Repeated:
    """Weighted rows of θ by the noise that repeats, summed over the periods of each recording of a motion, by phase.

    With these sums u_k, noise that repeats within recordings has the covariance `Σ u_kᵀ Γ u_k`, and noise that repeats
    across them that of all sums together: parameters of a recording's own see the periods of that one alone.
    """

    def __init__(self, motion: RepeatedMotion, fit: TrajectoryFit) -> None:
        self.motion = motion
        pieces = [piece for piece in fit.pieces if piece.log in motion.starts]
        times = zip(*((piece.time, piece.when) for piece in pieces), strict=True)
        # Time between samples of coordinates and of channels, in the slowest recording; clocks may nearly coincide.
        self._steps = [max(max(np.median(np.diff(x)), np.ptp(x) / len(x) / 2) for x in own) for own in times]
        self._first = pieces[0].time[0] + motion.starts[pieces[0].log]
        self._columns, self._sums = len(fit.theta), defaultdict[tuple[int, int, int], dict[int, np.ndarray]](dict)
        self._within = defaultdict[int, np.ndarray](partial(np.zeros, (self._columns, self._columns)))

    def add(
        self, signal: tuple[int, int, int], log: int, time: np.ndarray, columns: np.ndarray, rows: np.ndarray
    ) -> None:
        """Adds rows (N, k) of some parameters (k,) by a signal of a recording at its times, s (N,).

        The signal is given by its stream, its column there, and its index among all coordinates and channels.
        """
        step, start, sums = self._steps[signal[0] > 0], time[0] + self.motion.starts[log], self._sums[signal]
        within, across = self.motion.correlation[:, signal[2]]
        # Long recordings without a period, all of which are alike, take one sum.
        log = log if within > across else ALL
        if log not in sums:
            # Of recordings at several rates the slowest may be slower than the motion.
            sums[log] = np.zeros((max(round(self.motion.lag / step), 1), self._columns))
        places = np.round((start - self._first) / step) + np.round((time - time[0]) / step)
        # Half steps, too, round one way: a period need not be a number of steps.
        phases = (places % (self.motion.lag / step) + 0.500001).astype(int)
        np.add.at(sums[log], (phases[:, None] % len(sums[log]), columns), rows)

    def end(self, log: int, colours: NoiseColours) -> None:
        """Ends a recording, of which no more rows come: its sums, which are large, go into those of all."""
        for signal, sums in self._sums.items():
            if log in sums:
                within, across = self.motion.correlation[:, signal[2]]
                self._within[log] += self._scatter(signal, within - across, sums[log], colours)
                own = sums.pop(log)
                sums[ALL] = np.add(sums[ALL], own, out=sums[ALL]) if ALL in sums else own

    def scatters(self, colours: NoiseColours) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """Covariance of the right side of θ due to what repeats in all recordings, and in each alone (p, p)."""
        total = np.zeros((self._columns, self._columns))
        for signal, sums in self._sums.items():
            if across := self.motion.correlation[1, signal[2]]:
                total += self._scatter(signal, across, sums[ALL], colours)
        return total, self._within

    def _scatter(
        self, signal: tuple[int, int, int], size: float, sums: np.ndarray, colours: NoiseColours
    ) -> np.ndarray:
        """Covariance due to the sums (n, p) of rows by a signal, whose noise repeats with a correlation (p, p)."""
        which, s, _ = signal
        around, step = self.motion.period < np.inf, self._steps[which > 0]
        products = size * sums.T @ _half(sums, colours, which, s, step, _Tails(), around=around)
        return np.asarray(products + products.T)


def by_samples(fit: TrajectoryFit, pieces: Sequence[Piece]) -> list[np.ndarray]:
    """Covariance of each piece's right side from a fit of other pieces of the recordings, then what repeats (p, p)."""
    samples, scatters = np.zeros(1 + max(piece.log for piece in pieces)), defaultdict[int, np.ndarray | float](float)
    for piece, scatter in zip(fit.pieces, fit.scatter_shares, strict=False):
        samples[piece.log] += len(piece.when)
        scatters[piece.log] += scatter
    each = [len(piece.when) / samples[piece.log] * np.asarray(scatters[piece.log]) for piece in pieces]
    return [*each, *fit.scatter_shares[len(fit.pieces) :]]


_Tails = dict[tuple[int, int, int], np.ndarray]
"""State of the recursion for slow noise at the end of a piece, by stream, column and correlation time."""


def _goes_on(fit: TrajectoryFit, k: int) -> bool:
    """True if a piece continues the one before in the same recording."""
    before, here = fit.pieces[k - 1], fit.pieces[k]
    gap = here.time[0] - before.time[-1]
    usual = (before.time[-1] - before.time[0]) / max(len(before.time) - 1, 1)
    same = np.array_equal(fit.selections[k], fit.selections[k - 1]) and here.origin == before.origin
    return bool(same and 0 < gap < 2 * usual)


def _half(
    y: np.ndarray, colours: NoiseColours, which: int, s: int, step: float, tails: _Tails, *, around: bool = False
) -> np.ndarray:
    """`G y` for weighted rows y of θ (N, p), with `G + Gᵀ = Γ` relative to the noise variance of the fit.

    Periodic noise of the same variance goes around, from the end of y to its beginning.
    """
    weight, weighted = 0.0, np.zeros_like(y)
    for b, (time, size) in enumerate(zip(colours.times, colours.amplitudes[which][:, s], strict=True)):
        if not size:
            continue
        if not time:
            weight += size
            continue
        # The sum over all pairs of samples, each weighted by exp(-|t| / τ), in one pass; twice each sample with itself.
        rho = np.exp(-step / time)
        start = tails.get((which, s, b), np.zeros(y.shape[1]))
        if around:
            whole = rho ** len(y)
            start, size = autoregressive(y, rho, start)[-1] / (1 - whole), size * (1 - whole) / (1 + whole)
        z = autoregressive(y, rho, start)
        tails[which, s, b] = z[-1]
        weight -= size
        weighted += size * z
    return weighted + weight / 2 * y
