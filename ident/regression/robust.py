"""Robust weighted least squares for real recordings, with standard deviations valid for autocorrelated noise.

minimise Σ_c Σ_n σ_c² ρ(u_nc / σ_c)        u = measured - Y x,   ρ Huber's, σ_c from the residuals (iterated)
cov x = B⁻¹ M B⁻¹,                          B = Yᵀ diag(ρ'') Y / σ²,   M from `noise.Sandwich`
"""

from dataclasses import replace
from functools import partial

import numpy as np

from ident.estimation.accumulator import accumulate, remembered_sums
from ident.estimation.channel_scales import least_noise
from ident.estimation.equations import Equations
from ident.estimation.noise import Sandwich
from ident.estimation.samples import Samples
from ident.regression.ordinary import Fit, huber_white, least_squares, solve
from ident.tolerances import NORMAL_MAD

HUBER = 1.345
"""Residual, in standard deviations, beyond which samples lose weight; 95 % efficient for normal noise."""

ITERATIONS = 50
CONVERGED = 1e-6
"""Change of the fit, in standard deviations of the channels, below which it has converged."""


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
    for _ in range(ITERATIONS):
        before = residual
        accumulated = accumulate(equations, samples, factor=factor, factors=np.sqrt(weights) / scale)
        fit, factor = solve(accumulated, equations), accumulated.factor
        residual = fit.residual(samples)
        scale = np.maximum(spread(residual), least)
        weights = np.minimum(1, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
        if np.abs(residual - before).max(initial=0, where=weights == 1) <= CONVERGED * scale.min():
            break
    covariance = _covariance(fit, samples, weights * residual / scale**2, (weights == 1) / scale)
    return replace(fit, covariance=covariance, noise="correlated over time or not")


def _covariance(fit: Fit, samples: Samples, pull: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Covariance of the coefficients under noise that is correlated over time.

    Args:
        fit: The fit.
        samples: The fitted samples.
        pull: Contribution of each residual to the normal equations (N, C).
        held: Root of its derivative by the residual (N, C), zero beyond Huber's limit.
    """
    bread = solve(accumulate(fit.equations, samples, factors=held), fit.equations).bread
    channels = len(fit.equations.channels)
    sandwich = Sandwich(len(fit.values), channels)
    sandwich.add_steady(partial(remembered_sums, fit.equations, samples), pull.T, len(fit.values) / channels)
    return bread @ sandwich.middle @ bread


def spread(residual: np.ndarray) -> np.ndarray:
    """Standard deviation of each channel from the median absolute deviation, the usual one if most entries agree."""
    spread = NORMAL_MAD * np.median(np.abs(residual), axis=0)
    usual = residual.std(axis=0)
    floor = max(1e-9 * usual.max(initial=0), 1e-12)
    return np.maximum(np.where(spread > 1e-3 * usual, spread, usual), floor)
