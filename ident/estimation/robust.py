"""Robust weighted least squares for real recordings, with standard deviations valid for autocorrelated noise.

minimise Σ_c Σ_n σ_c² ρ(u_nc / σ_c)        u = measured - Y x,   ρ Huber's, σ_c from the residuals (iterated)
cov x = B⁻¹ M B⁻¹,                          B = Yᵀ diag(ρ'') Y / σ²,   M from `noise.Sandwich`
"""

from dataclasses import replace

import numpy as np

from ident.estimation.accumulator import accumulate
from ident.estimation.equations import Equations
from ident.estimation.least_noise import least_noise
from ident.estimation.least_squares import Fit, huber_white, least_squares, solve
from ident.estimation.noise import Sandwich
from ident.estimation.samples import Samples
from ident.tolerances import NORMAL_MAD, ZERO_COLUMN

HUBER = 1.345
"""Residual, in standard deviations, beyond which samples lose weight; 95 % efficient for normal noise."""

INDEPENDENT = 1e-6
"""Distance of a unit-norm column from the span of others below which it depends on them."""

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
    chunks, channels = (rows[:-1] for rows in fit.equations.rows(samples)), len(fit.equations.channels)
    sandwich = Sandwich(len(fit.values), channels, steady=True).add(chunks, pull.T, len(fit.values) / channels)
    return bread @ sandwich.middle @ bread


def separable(equations: Equations, samples: Samples) -> Equations:
    """Equations without the drives and offsets whose columns depend on those before them.

    Raises:
        InputError: Samples do not fit the equations.
    """
    columns = accumulate(equations, samples).root[:, : len(equations.names)]
    kept = dict(zip(equations.names, independent(columns), strict=True))
    return replace(
        equations,
        drives=tuple(name for name in equations.drives if kept[name]),
        offsets=tuple(k for k in equations.offsets if kept[f"offset({equations.channels[k]})"]),
    )


def independent(columns: np.ndarray) -> np.ndarray:
    """Mask of the columns of a matrix (m, k) that are independent of those before them (k,)."""
    # Not by the diagonal of a triangular factor, which lacks a part of the columns after a dependent one.
    sizes, basis = np.linalg.norm(columns, axis=0), np.zeros_like(columns)
    stick_out = np.zeros(len(sizes), bool)
    for k, (column, size) in enumerate(zip(columns.T, sizes, strict=True)):
        out = column
        for _ in range(2):  # One pass leaves rounding errors along the others.
            out = out - basis @ (basis.T @ out)
        stick_out[k] = size > ZERO_COLUMN * sizes.max() and np.linalg.norm(out) > INDEPENDENT * size
        if stick_out[k]:
            basis[:, k] = out / np.linalg.norm(out)
    return stick_out


def spread(residual: np.ndarray) -> np.ndarray:
    """Standard deviation of each channel from the median absolute deviation, the usual one if most entries agree."""
    spread = NORMAL_MAD * np.median(np.abs(residual), axis=0)
    usual = residual.std(axis=0)
    floor = max(1e-9 * usual.max(initial=0), 1e-12)
    return np.maximum(np.where(spread > 1e-3 * usual, spread, usual), floor)
