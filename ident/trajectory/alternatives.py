"""Alternatives to a fit, of which each is taken if left-out pieces are predicted clearly better.

Every alternative is asked for by the fit it would replace: a prior by columns that the data determine less well,
correlated noise by correlated residuals, and friction and offsets of each recording's own by recordings that disagree.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import special

from ident.errors import ExcitationError
from ident.estimation.measurement import Measurement
from ident.tolerances import SIGNIFICANT
from ident.trajectory.fit.piece import Piece, predicted
from ident.trajectory.fit.precision import embedded, inverse_of_precision
from ident.trajectory.fit.restricted_likelihood import TINIEST
from ident.trajectory.left_out import CLEARLY, clearly_less, prediction_errors, without
from ident.trajectory.result import TrajectoryEstimate

CORRELATED = 0.15
"""Autocorrelation of a residual at lag one above which denser knots, or correlated noise, are tried."""

CONTRADICTED = 2.0
"""Root mean square z of the estimate from the model, by the noise, above which the data contradict the model. True
models of persons without noise have 1.1 and 1.3, of a noisy arm .7 to 1.2. Of 12 arms of 5 and 10 % wrong masses that
predict left-out pieces better 10 have more: with these kept, the rest is predicted up to 11 times worse."""


def better(
    usual: TrajectoryEstimate, name: str, other: Callable[[], TrajectoryEstimate], margin: float = CLEARLY
) -> TrajectoryEstimate:
    """The usual estimate, or another one that predicts left-out pieces clearly better.

    Args:
        usual: The usual estimate, with the shares of its pieces.
        name: Name of the alternative.
        other: Function that returns the other one, which may not be determined.
        margin: Decrease of the mean log error from which it is better.
    """
    if usual.fit.status == "interrupted" or len(usual.fit.pieces) < 2:
        return usual
    try:
        tried = other()
    except (ExcitationError, np.linalg.LinAlgError):
        return usual
    if tried.fit.status == "interrupted":
        return tried
    both = usual, tried
    least = np.minimum(usual.fit.channel_noise, tried.fit.channel_noise)
    errors = np.array([prediction_errors(each.measurement, each.fit, least) for each in both])
    return replace(both[clearly_less(errors[0], errors[1], margin)], errors={**usual.errors, name: errors})


def or_model(estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """The estimate, or one with the model's bodies and drives if these predict left-out pieces clearly better.

    They also have to agree with the data: without the other condition few samples would be predicted from fewer ones,
    without this one a channel that the model predicts badly would count little. Offsets and set-up are those that the
    linear equations give with the model; trajectories, noise and covariance, that of prior and data, are the
    estimate's. Its intervals about the model's values are no posterior: their error was only tested, to
    `CONTRADICTED`.
    """
    fit, model = estimate.fit, estimate.measurement.equations.from_model
    theta, free = fit.theta.copy(), fit.free.copy()
    for own in fit.selections:
        theta[own[: len(model)]], free[own[: len(model)]] = model, False
    by, noise = inverse_of_precision(fit.precision[np.ix_(fit.free, fit.free)]), sum(fit.scatter_shares, np.zeros(()))
    moved, bodies = embedded(by @ noise[np.ix_(fit.free, fit.free)] @ by, fit.free), fit.free & ~free
    chi2, rank = _chi2((fit.theta - theta)[bodies], moved[np.ix_(bodies, bodies)])
    if chi2 > CONTRADICTED**2 * rank:
        return estimate
    held = replace(fit.at(theta), free=free)
    tried = better(estimate, "the model's bodies and drives", lambda: estimate.with_fit(held))
    if tried.fit is fit:
        return tried
    kept = fit.unbound.at(without(held, slice(0))[0])
    return replace(tried.with_fit(replace(kept, bounded=None)), kept=True)


def _chi2(x: np.ndarray, covariance: np.ndarray) -> tuple[float, int]:
    """Squared Mahalanobis distance of x (k,), and the rank of its covariance (k, k)."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, axes = np.linalg.eigh(covariance / np.outer(size, size))
    seen = values > 1e-9 * values[-1]
    return float(((axes.T @ (x / size))[seen] ** 2 / values[seen]).sum()), int(seen.sum())


def disagree(estimate: TrajectoryEstimate, mine: np.ndarray) -> bool:
    """True if some parameters, by their indices, would differ significantly between the recordings (score test).

    With H_l and g_l the precision and right side of recording l, H their sum with the prior's, and K the parameters,

        gᵀ S⁻¹ g ~ χ²,    S_lm = (δ_lm H_l - H_l H⁻¹ H_m)_KK

    where g are the (g_l)_K of all recordings but the first.
    """
    fit, free = estimate.fit, estimate.fit.free
    mine = mine[free[mine]]
    if len(estimate.counts) < 2 or not len(mine):
        return False
    parts = [fit.shares[estimate.pieces_of(k)] for k in range(1, len(estimate.counts))]
    every = [(np.sum([H for H, _ in part], axis=0), np.sum([g for _, g in part], axis=0)) for part in parts]
    across = np.hstack([H[np.ix_(free, mine)] for H, _ in every])
    alone = np.zeros((across.shape[1], across.shape[1]))
    for k, (H, _) in enumerate(every):
        own = slice(k * len(mine), (k + 1) * len(mine))
        alone[own, own] = H[np.ix_(mine, mine)]
    score = np.concatenate([g[mine] for _, g in every])
    S = alone - across.T @ inverse_of_precision(fit.precision[np.ix_(free, free)]) @ across
    chi2, rank = _chi2(score, S)
    return chi2 > special.chdtri(rank, SIGNIFICANT)


def residual(measurement: Measurement, piece: Piece, coefficients: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Measured less predicted channels of a piece (M, C)."""
    return piece.measured - predicted(measurement, piece, partial(piece.spline.evaluate, coefficients), theta)


def correlated(estimate: TrajectoryEstimate) -> np.ndarray:
    """Masks of the channels whose residual is correlated over one sample, and over the knot spacing (2, L, C).

    By recording, without samples with slack.
    """
    fit = estimate.fit
    products = np.zeros((2, len(fit.noises), len(fit.channel_noise)))
    squares = np.full(products.shape[1:], TINIEST)
    for piece, c, own in zip(fit.pieces, fit.coefficients, fit.selections, strict=True):
        left = residual(estimate.measurement, piece, c, fit.theta[own])
        clear = np.isfinite(left)
        if piece.slack is not None:
            clear &= piece.slack < fit.noises[piece.log].channels
        left = np.where(clear, left, 0.0)
        squares[piece.log] += (left**2).sum(axis=0)
        for k, lag in enumerate((1, max(1, round(piece.spline.step / float(np.median(np.diff(piece.when))))))):
            products[k, piece.log] += (left[lag:] * left[:-lag]).sum(axis=0)
    return np.asarray(products > CORRELATED * squares)
