"""Conventional least squares of real recordings: on low-passed states at the best of several cut-offs, and robust.

    minimise Σ_c ‖Γ_c - Y_c x‖² / σ_c² + (ψ - ψ_0)ᵀ P (ψ - ψ_0),       σ_c from the residuals (iterated)

Coefficients and residuals follow from Gram matrices of the columns and the channels, low-passed and raw, so that one
pass over the samples serves all fits to their halves.

Robust weighted least squares take the states as exact, with standard deviations valid for autocorrelated noise.

    minimise Σ_c Σ_n σ_c² ρ(u_nc / σ_c)        u = measured - Y x,   ρ Huber's, σ_c from the residuals (iterated)
    cov x = B⁻¹ M B⁻¹,                          B = Yᵀ diag(ρ'') Y / σ²,   M from `noise.Sandwich`
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import add

import numpy as np

from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.accumulator import accumulate, excited, remembered_sums, separable
from ident.estimation.equations import Equations
from ident.estimation.noise import Sandwich, beside_others, least_noise, spread
from ident.estimation.preparation import Part, Prepared, filtered, length
from ident.estimation.recorded_motion import usual_cutoff
from ident.estimation.samples import Samples
from ident.estimators.predictions import Candidate
from ident.problem import Problem
from ident.recordings.smoothing import HIGHEST, settling
from ident.regression.held_out import MODEL
from ident.regression.ordinary import Fit, huber_white, least_squares, solve

FACTORS = 0.25, 0.5, 1.0, 2.0, 4.0
"""Cut-offs to try, relative to that of residual analysis, which weighs noise of joint angles against distortion but
ignores what the model cannot explain."""

SLOW = 0.1
"""Velocity, over its root mean square, below which the torque of a joint with friction is left out: at rest friction
is anything up to breakaway friction, and a low-pass blurs a reversal."""


def ordinary(problem: Problem) -> Estimate:
    """Ordinary least squares, as in the paper."""
    return _least_squares(problem, weighted=False)


def weighted(problem: Problem) -> Estimate:
    """Least squares of channels weighted by their residuals, outliers weighted down."""
    return _least_squares(problem, weighted=True)


def _least_squares(problem: Problem, *, weighted: bool) -> Estimate:
    equations, samples = problem.equations, problem.samples
    singular_values, poor = excited(equations, samples)
    if poor:
        raise poor
    with_offsets = separable(equations.with_offsets(equations.sensed), samples)
    full = robust_fit(with_offsets, samples, weighted=weighted)
    fit = full if problem.offsets else robust_fit(equations, samples, weighted=weighted)
    held_out, model = problem.held_out(fit), Candidate.model(with_offsets, samples)
    held_out = replace(held_out, rivals={MODEL: model.residuals(held_out.samples)[0]})
    return Estimate(problem.fitted, fit, full.offsets, held_out, singular_values)


def robust_fit(equations: Equations, samples: Samples, *, weighted: bool = True) -> Fit:
    """Iteratively reweighted least squares of channels with different noise (Huber's M-estimator).

    Every channel is weighted by the inverse of its residual's standard deviation, which is estimated along with the
    coefficients, and entries with large residuals lose weight. The rows are computed again in every iteration, so that
    only the channels are kept in memory.

    Args:
        equations: Equations to fit.
        samples: Motion and measured channels.
        weighted: False for ordinary least squares.

    Returns:
        The fit; its standard deviations are valid for noise correlated over time.

    Raises:
        InputError: Samples do not fit the equations.
        ExcitationError: The motion does not separate the parameters.
    """
    if not weighted:
        return huber_white(least_squares(equations, samples), samples, steady=True)
    residual = samples.measured
    least = least_noise([samples.measured], equations.channels)
    scale = np.maximum(spread(residual - residual.mean(axis=0)), least)
    weights, factor = np.ones_like(residual), None
    for _ in range(50):
        before = residual
        accumulated = accumulate(equations, samples, factor=factor, factors=np.sqrt(weights) / scale)
        fit, factor = solve(accumulated, equations), accumulated.factor
        residual = fit.residual(samples)
        scale = np.maximum(spread(residual), least)
        # Residuals lose weight beyond 1.345 standard deviations: 95 % efficient for normal noise.
        weights = np.minimum(1, 1.345 * scale / np.maximum(np.abs(residual), 1e-300))
        if np.abs(residual - before).max(initial=0, where=weights == 1) <= 1e-6 * scale.min():
            break
    covariance = _covariance(fit, samples, weights * residual / scale**2, (weights == 1) / scale)
    return replace(fit, covariance=covariance)


def _covariance(fit: Fit, samples: Samples, pull: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Covariance of the coefficients under noise that is correlated over time.

    Args:
        fit: The fit.
        samples: The fitted samples.
        pull: Contribution of each residual to the normal equations (N, C).
        held: Root of its derivative by the residual (N, C), zero beyond Huber's limit.
    """
    huber = solve(accumulate(fit.equations, samples, factors=held), fit.equations)
    channels = len(fit.equations.channels)
    sandwich = Sandwich(len(fit.values), channels)
    sandwich.add_steady(partial(remembered_sums, fit.equations, samples), pull.T, len(fit.values) / channels)
    return huber.sandwich(sandwich.middle)


@dataclass(frozen=True, eq=False)
class FilteredLeastSquares:
    """Least squares at the best of several cut-offs.

    Attributes:
        cutoffs: Cut-off for all recordings to predict, or for each, Hz; None for measured velocities and
            accelerations, where none can be chosen.
        values: Coefficients that predict all, or each (1 or J, m).
    """

    cutoffs: tuple[float | None, ...]
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over samples: Gram matrices of `[Y | low-passed | raw]` of each channel, and counts.

    Attributes:
        grams: Gram matrices (C, m + 2, m + 2).
        count: Number of samples used in each channel (C,).
        total: Sums of the raw channels (C,).
        channels: Names of the channels.
    """

    grams: np.ndarray
    count: np.ndarray
    total: np.ndarray
    channels: tuple[str, ...]

    def __add__(self, other: "_Sums") -> "_Sums":
        return _Sums(self.grams + other.grams, self.count + other.count, self.total + other.total, self.channels)

    @property
    def scales(self) -> np.ndarray:
        """Standard deviation of the raw channels, of flat ones that of their kind (C,)."""
        square = self.grams[:, -1, -1] / self.count
        # Computed as a difference, with rounding errors.
        variance = square - (self.total / self.count) ** 2
        return beside_others(np.sqrt(np.where(variance > 1e-12 * square, variance, 0)), self.channels)

    def residual(self, x: np.ndarray, measured: int) -> np.ndarray:
        """Root mean square of measured less predicted channels (C,).

        Args:
            x: Coefficients (m,).
            measured: Row of the measurements: -1 raw, -2 low-passed.
        """
        y = np.zeros(self.grams.shape[1])
        y[: len(x)], y[measured] = -x, 1
        return np.sqrt(np.maximum(np.einsum("i,cij,j->c", y, self.grams, y), 0) / self.count)


def filtered_least_squares(
    fitted: Sequence[Part[slice]],
    judged: Sequence[Part[slice | np.ndarray]],
    equations: Equations,
    prior: tuple[np.ndarray, np.ndarray],
    *,
    others: bool = False,
) -> FilteredLeastSquares:
    """Least squares at the cut-off at which halves of the fitted samples predict each other best.

    Args:
        fitted: Parts of recordings to fit.
        judged: Parts of recordings to predict.
        equations: Channels and columns.
        prior: Mean of ψ and drives and its precision, zero where nothing is known (r + d,), (r + d, r + d).
        others: True if the recordings to predict are the fitted ones, each predicted from the others.
    """
    cutoffs = _cutoffs([part.log for part in (*fitted, *judged)])
    # Some 5000 samples, evenly spread, are enough to compare cut-offs.
    thin = max(1, round(length(fitted) / 5000))
    halves = {c: [_halves(part, equations, c, thin) for part in fitted] for c in cutoffs}
    best, values = list[float | None](), list[np.ndarray]()
    for k in range(len(judged) if others else 1):
        used = [i for i in range(len(fitted)) if not others or i != k]
        sums = {
            c: [reduce(add, pair) for pair in zip(*(own[i] for i in used), strict=True)] for c, own in halves.items()
        }
        chosen = min(cutoffs, key=lambda c: _error(sums[c], prior))
        best.append(chosen)
        values.append(_solved(sums[chosen][0] + sums[chosen][1], prior))
    return FilteredLeastSquares(tuple(best), np.stack(values))


def _cutoffs(logs: Sequence[Prepared]) -> list[float | None]:
    """Cut-offs to try, Hz, by the first recording; None for the measured states where none can be chosen.

    They depend on joint angles alone, as in the trajectory estimate. Angles are known in the recordings to predict as
    well, so all of them are used.
    """
    first = logs[0]
    try:
        usual = usual_cutoff(first.recording, first.mechanism.joints)
    except InputError:
        return [None]
    rates, shortest = [log.recording.rate for log in logs], min(len(log.samples) for log in logs)
    lowest, highest = max(rates) / shortest, HIGHEST * min(rates)
    return list(dict.fromkeys(min(max(factor * usual, lowest), highest) for factor in FACTORS))


def _halves(part: Part[slice], equations: Equations, cutoff: float | None, thin: int) -> tuple[_Sums, _Sums]:
    """Sums over either half of a part of a recording."""
    log, span = part
    (own, raw), size = filtered(log, cutoff), len(log.samples)
    # While the filter settles samples are left out, but for those of short recordings, which would be lost.
    edge = 0 if cutoff is None else min(settling(log.recording.rate, cutoff), size // 8)
    taken = log.taken(slice(max(span.start, edge), min(span.stop, size - edge)))[::thin]
    first, second = np.array_split(taken, 2)
    return _sums(own[first], raw[first], equations), _sums(own[second], raw[second], equations)


def _sums(samples: Samples, raw: np.ndarray, equations: Equations) -> _Sums:
    counts, first = _counting(samples, equations), 0
    grams = np.zeros((len(equations.channels), len(equations.names) + 2, len(equations.names) + 2))
    for rows in equations.rows(samples) if len(samples) else ():
        part = slice(first, first + rows.shape[2])
        for channel, gram in enumerate(grams):
            counting = counts[part, channel]
            every = np.vstack([rows[:, channel, counting], raw[part, channel][counting]])
            # Torques of one limb do not depend on the others.
            nonzero = np.flatnonzero(every.any(axis=1))
            gram[np.ix_(nonzero, nonzero)] += every[nonzero] @ every[nonzero].T
        first = part.stop
    return _Sums(grams, np.maximum(counts.sum(axis=0), 1), (counts * raw).sum(axis=0), equations.channels)


def _counting(samples: Samples, equations: Equations) -> np.ndarray:
    """Mask of the measurements that are used: not torques of joints with friction at low velocity (N, C)."""
    counting = np.ones(samples.measured.shape, bool)
    if equations.drives:
        axes, torques = equations.axes, list(equations.torques)
        velocity = np.abs(axes.moved(samples.motion.dq))
        slow = (velocity < SLOW * np.sqrt((velocity**2).mean(axis=0))) & axes.driven
        counting[:, len(equations.channels) - len(torques) :] = ~(slow @ (axes.matrix[:, torques] != 0))
    return counting


def _error(halves: Sequence[_Sums], prior: tuple[np.ndarray, np.ndarray]) -> float:
    """Mean log of residual over scale over the channels, each half predicted from the other."""
    a, b = halves
    left = [other.residual(_solved(own, prior), -1) / other.scales for own, other in ((a, b), (b, a))]
    return float(np.log(np.maximum(left, 1e-300)).mean())


def _solved(sums: _Sums, prior: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Coefficients fitted with the prior, channels reweighted by their residuals (m,).

    Combinations of columns of a condition number above 1e5 are not fitted and stay zero.
    """
    m = sums.grams.shape[1] - 2
    mean, precision = np.zeros(m), np.zeros((m, m))
    r = len(prior[0])
    mean[:r], precision[:r, :r] = prior
    x, std = np.zeros(m), sums.scales
    for _ in range(5):
        normal = np.tensordot(std**-2, sums.grams[:, :m, :m], axes=1) + precision
        right = std**-2 @ sums.grams[:, :m, m] + precision @ mean
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        values, axes = np.linalg.eigh(normal / np.outer(scale, scale))
        inverse = np.where(values > 1e-10 * values[-1], 1 / np.maximum(values, 1e-300), 0)
        x = axes @ (inverse * (axes.T @ (right / scale))) / scale
        std = np.maximum(sums.residual(x, -2), 1e-4 * sums.scales)
    return x
