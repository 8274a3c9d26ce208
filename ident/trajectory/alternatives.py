"""Alternatives to a fit, of which each is taken if left-out pieces are predicted clearly better.

Every alternative is asked for by the fit it would replace: a prior by columns that the data determine less well,
correlated noise by correlated residuals, and friction and offsets of each recording's own by recordings that disagree.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import linalg, special

from ident.errors import ExcitationError
from ident.tolerances import SIGNIFICANT
from ident.trajectory.fit.fitted import TINIEST, inverse_of_precision
from ident.trajectory.fit.piece import residual
from ident.trajectory.left_out import CLEARLY, clearly_less, prediction_errors
from ident.trajectory.result import TrajectoryEstimate

CORRELATED = 0.15
"""Autocorrelation of a residual at lag one above which denser knots, or correlated noise, are tried."""


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
    alone = linalg.block_diag(*(H[np.ix_(mine, mine)] for H, _ in every))
    score = np.concatenate([g[mine] for _, g in every])
    S = alone - across.T @ inverse_of_precision(fit.precision[np.ix_(free, free)]) @ across
    size = np.sqrt(np.maximum(np.diag(S), 1e-300))
    values, axes = np.linalg.eigh(S / np.outer(size, size))
    seen = values > 1e-9 * values[-1]
    z = (axes.T @ (score / size))[seen] / np.sqrt(values[seen])
    return bool((z**2).sum() > special.chdtri(seen.sum(), SIGNIFICANT))


def correlated(estimate: TrajectoryEstimate) -> np.ndarray:
    """Masks of the channels whose residual is correlated over one sample, and over the knot spacing (2, L, C).

    By recording, without samples with slack.
    """
    fit = estimate.fit
    products = np.zeros((2, len(fit.noises), len(fit.channel_noise)))
    squares = np.full(products.shape[1:], TINIEST)
    for point in fit.points:
        piece, left = point.piece, residual(estimate.measurement, point)
        clear = np.isfinite(left)
        if piece.slack is not None:
            clear &= piece.slack < point.noise.channels
        left = np.where(clear, left, 0.0)
        squares[piece.log] += (left**2).sum(axis=0)
        for k, lag in enumerate((1, max(1, round(piece.spline.step / float(np.median(np.diff(piece.when))))))):
            products[k, piece.log] += (left[lag:] * left[:-lag]).sum(axis=0)
    return np.asarray(products > CORRELATED * squares)
