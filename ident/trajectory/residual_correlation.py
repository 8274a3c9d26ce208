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


def correlated(estimate: TrajectoryEstimate) -> bool:
    """True if a channel's residual is correlated from one sample to the next."""
    return bool((correlation(estimate, 0.0) > CORRELATED).any())


def jumps(estimate: TrajectoryEstimate) -> bool:
    """True if a channel's residual is correlated, but not over the knot spacing."""
    near, far = correlation(estimate, 0.0), correlation(estimate, estimate.step)
    return bool(((near > CORRELATED) & (far < CORRELATED)).any())


def correlation(estimate: TrajectoryEstimate, time: float) -> np.ndarray:
    """Autocorrelation of the channels' residuals at a lag of at least one sample, without samples with slack (C,).

    Args:
        estimate: The estimate.
        time: Lag, s.
    """
    fit = estimate.fit
    squares = np.full((2, len(fit.noise.channels)), [[0.0], [TINIEST]])
    for piece, c, own in zip(fit.pieces, fit.coefficients, fit.selections, strict=True):
        left = residual(estimate.measurement, piece, c, fit.theta[own])
        clear = np.isfinite(left)
        if piece.slack is not None:
            clear &= piece.slack < fit.noise.channels
        left = np.where(clear, left, 0.0)
        lag = max(1, round(time / float(np.median(np.diff(piece.when)))))
        squares += [(left[lag:] * left[:-lag]).sum(axis=0), (left**2).sum(axis=0)]
    return np.asarray(squares[0] / squares[1])
