"""Residuals of an estimate and their autocorrelation, by which knots and noise models are chosen."""

from functools import partial

import numpy as np

from ident.estimation.measurement import Measurement
from ident.trajectory.fit.piece import Piece, predicted
from ident.trajectory.fit.restricted_likelihood import TINIEST
from ident.trajectory.result import TrajectoryEstimate

CORRELATED = 0.15
"""Autocorrelation of a residual at lag one above which denser knots, or correlated noise, are tried."""


def residual(measurement: Measurement, piece: Piece, coefficients: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Measured less predicted channels of a piece (M, C)."""
    return piece.measured - predicted(measurement, piece, partial(piece.spline.evaluate, coefficients), theta)


def correlated(estimate: TrajectoryEstimate, *, knots: bool) -> np.ndarray:
    """Mask of the recordings in which a channel's residual is correlated (L,), with `knots` as for `correlation`."""
    return np.asarray((correlation(estimate, knots=knots) > CORRELATED).any(axis=1))


def jumps(estimate: TrajectoryEstimate) -> np.ndarray:
    """Mask of the recordings in which a channel's residual is correlated, but not over the knot spacing (L,)."""
    near, far = (correlation(estimate, knots=knots) > CORRELATED for knots in (False, True))
    return np.asarray((near & ~far).any(axis=1))


def correlation(estimate: TrajectoryEstimate, *, knots: bool) -> np.ndarray:
    """Autocorrelation of the channels' residuals in every recording, without samples with slack (L, C).

    Args:
        estimate: The estimate.
        knots: True for a lag of the knot spacing, False for one sample.
    """
    fit = estimate.fit
    squares = np.full((2, len(fit.noises), len(fit.channel_noise)), [[[0.0]], [[TINIEST]]])
    for piece, c, own in zip(fit.pieces, fit.coefficients, fit.selections, strict=True):
        left = residual(estimate.measurement, piece, c, fit.theta[own])
        clear = np.isfinite(left)
        if piece.slack is not None:
            clear &= piece.slack < fit.noises[piece.log].channels
        left = np.where(clear, left, 0.0)
        lag = max(1, round(piece.spline.step / float(np.median(np.diff(piece.when))))) if knots else 1
        squares[:, piece.log] += [(left[lag:] * left[:-lag]).sum(axis=0), (left**2).sum(axis=0)]
    return np.asarray(squares[0] / squares[1])
