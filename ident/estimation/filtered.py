"""Least squares as they are usually done: states low-passed and differentiated, at the best of several cut-offs.

    minimise Σ_c ‖Γ_c - Y_c x‖² / σ_c² + (ψ - ψ_0)ᵀ P (ψ - ψ_0),       σ_c from the residuals (iterated)

What a fit takes and what it leaves follows from Gram matrices of the columns beside the channels, low-passed and as
they came, so that one pass over the samples tells of all fits to their halves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from ident.errors import InputError
from ident.estimation.equations import Equations
from ident.estimation.preparation import Filtered, Prepared, coordinates, filtered
from ident.estimation.samples import Samples
from ident.recordings.smoothing import HIGHEST, chosen_cutoff, settling

FACTORS = 0.25, 0.5, 1.0, 2.0, 4.0
"""Cut-offs that are tried, of that which residual analysis chooses: it weighs noise of joint angles against distortion,
and knows nothing of what the model cannot follow."""

SETTLES = 8
"""Part of a recording at either end that is left out at most while the filter settles: short ones would be lost."""

ENOUGH = 5000
"""Samples, evenly spread, that each fit is made of at most: what a cut-off does shows in them."""

REWEIGHTED = 5
"""Fits, each with the channels weighted by the residuals of the one before."""

LEAST_NOISE = 1e-4
"""Least deviation of a channel's residual, of its signal, by which it is weighted."""

SLOW = 0.1
"""Velocity, over its root mean square, below which the torque of a joint that rubs is left alone: at rest friction is
anything up to breakaway, and a low-pass smears a reversal."""

UNDETERMINED = 1e-10
"""Eigenvalues of the scaled normal equations, of the largest, below which a combination stays as it was: zero, or as
the prior has it. Their roots are condition numbers of the columns."""


@dataclass(frozen=True, eq=False)
class FilteredLeastSquares:
    """Least squares at the best of several cut-offs.

    Attributes:
        cutoffs: The cut-off of each recording to judge by, Hz; None for velocities and accelerations as they came,
            where none can be chosen.
        predicted: Channels that are predicted of each (N, C).
    """

    cutoffs: tuple[float | None, ...]
    predicted: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over samples: Gram matrices of `[Y | low-passed | raw]` of each channel, and how many they are.

    Attributes:
        grams: Gram matrices (C, m + 2, m + 2).
        count: Samples that count in each channel (C,).
        total: Sums of the raw channels (C,).
    """

    grams: np.ndarray
    count: np.ndarray
    total: np.ndarray

    def __add__(self, other: "_Sums") -> "_Sums":
        return _Sums(self.grams + other.grams, self.count + other.count, self.total + other.total)

    @property
    def signal(self) -> np.ndarray:
        """Standard deviation of the raw channels (C,)."""
        variance = self.grams[:, -1, -1] / self.count - (self.total / self.count) ** 2
        return np.sqrt(np.maximum(variance, 1e-300))

    def residual(self, x: np.ndarray, measured: int) -> np.ndarray:
        """Root mean square of measurements less what coefficients (m,) predict, the last row or the last but one."""
        y = np.zeros(self.grams.shape[1])
        y[: len(x)], y[measured] = -x, 1
        return np.sqrt(np.maximum(np.einsum("i,cij,j->c", y, self.grams, y), 0) / self.count)


def filtered_least_squares(
    fitted: Sequence[tuple[Prepared, slice]],
    judged: Sequence[tuple[Prepared, slice | np.ndarray]],
    equations: Equations,
    prior: tuple[np.ndarray, np.ndarray],
    *,
    others: bool = False,
) -> FilteredLeastSquares:
    """Predictions by least squares at the cut-off at which halves of what is fitted predict each other best.

    Args:
        fitted: Recordings and the samples of each to fit.
        judged: Recordings and the samples of each to predict.
        equations: Channels and columns.
        prior: Mean of ψ and its precision, zero where nothing is known (r,), (r, r).
        others: Whether those to predict are those that are fitted, each predicted from the others.
    """
    cutoffs = _cutoffs([log for log, _ in (*fitted, *judged)])
    samples = sum(part.stop - part.start for _, part in fitted)
    thin = max(1, round(samples / ENOUGH))
    halves = {c: [_halves(log, part, equations, c, thin) for log, part in fitted] for c in cutoffs}
    best, predicted = list[float | None](), list[np.ndarray]()
    for k, (log, part) in enumerate(judged):
        used = [i for i in range(len(fitted)) if not others or i != k]
        sums = {
            c: [reduce(add, pair) for pair in zip(*(own[i] for i in used), strict=True)] for c, own in halves.items()
        }
        chosen = min(cutoffs, key=lambda c: _error(sums[c], prior))
        x = _solved(sums[chosen][0] + sums[chosen][1], prior)
        best.append(chosen)
        motion = filtered(log, chosen).motion[log.taken(part)]
        rows = equations.rows(Samples(motion, np.zeros((len(motion), len(equations.channels)))))
        predicted.append(np.hstack([np.tensordot(x, r[:-1], axes=1) for r in rows]).T)
    return FilteredLeastSquares(tuple(best), tuple(predicted))


def _cutoffs(logs: Sequence[Prepared]) -> list[float | None]:
    """Cut-offs to try, Hz, by the first recording; where none can be chosen, None for states as they came.

    The joint estimate knows joint angles alone, and so do these. Angles are known where channels are to be predicted,
    therefore all of them have a say.
    """
    first = logs[0]
    try:
        usual = chosen_cutoff(coordinates(first.recording, first.mechanism.joints), first.recording.rate)
    except InputError:
        return [None]
    rates, shortest = [log.recording.rate for log in logs], min(len(log.samples) for log in logs)
    lowest, highest = max(rates) / shortest, HIGHEST * min(rates)
    return list(dict.fromkeys(min(max(factor * usual, lowest), highest) for factor in FACTORS))


def _halves(log: Prepared, part: slice, equations: Equations, cutoff: float | None, thin: int) -> tuple[_Sums, _Sums]:
    """Sums over either half of a part of a recording."""
    own, size = filtered(log, cutoff), len(log.samples)
    edge = 0 if cutoff is None else min(settling(log.recording.rate, cutoff), size // SETTLES)
    taken = log.taken(slice(max(part.start, edge), min(part.stop, size - edge)))[::thin]
    first, second = np.array_split(taken, 2)
    return _sums(own, first, equations), _sums(own, second, equations)


def _sums(own: Filtered, taken: np.ndarray, equations: Equations) -> _Sums:
    samples, first = Samples(own.motion[taken], own.measured[taken]), 0
    counts, raw = _counting(samples, equations), own.raw[taken]
    grams = np.zeros((len(equations.channels), len(equations.names) + 2, len(equations.names) + 2))
    for rows in equations.rows(samples) if len(taken) else ():
        part = slice(first, first + rows.shape[2])
        for channel, gram in enumerate(grams):
            counting = counts[part, channel]
            every = np.vstack([rows[:, channel, counting], raw[part, channel][counting]])
            # Torques of one limb see nothing of the others.
            seen = np.flatnonzero(every.any(axis=1))
            gram[np.ix_(seen, seen)] += every[seen] @ every[seen].T
        first = part.stop
    return _Sums(grams, np.maximum(counts.sum(axis=0), 1), (counts * raw).sum(axis=0))


def _counting(samples: Samples, equations: Equations) -> np.ndarray:
    """Mask of the measurements that count: not the torques of joints that rub and hardly move (N, C)."""
    counting = np.ones(samples.measured.shape, bool)
    if equations.drives:
        velocity = np.abs(samples.motion.dq[:, list(equations.torques)])
        moving = velocity >= SLOW * np.sqrt((velocity**2).mean(axis=0))
        counting[:, len(equations.channels) - len(equations.torques) :] = moving
    return counting


def _error(halves: Sequence[_Sums], prior: tuple[np.ndarray, np.ndarray]) -> float:
    """Logarithm of what is left over the signal, on average over the channels, as either half predicts the other."""
    a, b = halves
    left = [other.residual(_solved(own, prior), -1) / other.signal for own, other in ((a, b), (b, a))]
    return float(np.log(np.maximum(left, 1e-300)).mean())


def _solved(sums: _Sums, prior: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Coefficients (m,)."""
    m = sums.grams.shape[1] - 2
    mean, precision = np.zeros(m), np.zeros((m, m))
    r = len(prior[0])
    mean[:r], precision[:r, :r] = prior
    x, std = np.zeros(m), sums.signal
    for _ in range(REWEIGHTED):
        normal = np.tensordot(std**-2, sums.grams[:, :m, :m], axes=1) + precision
        right = std**-2 @ sums.grams[:, :m, m] + precision @ mean
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        values, axes = np.linalg.eigh(normal / np.outer(scale, scale))
        inverse = np.where(values > UNDETERMINED * values[-1], 1 / np.maximum(values, 1e-300), 0)
        x = axes @ (inverse * (axes.T @ (right / scale))) / scale
        std = np.maximum(sums.residual(x, -2), LEAST_NOISE * sums.signal)
    return x
