"""Moves, which are kept or undone, and the prediction of pieces left out of a fit, by which most of them are.

    θ_-k = θ + (P - P_k)⁻¹ (g - g_k)                          parameters without piece k
    e_k  = y_k - f(x_k, θ_-k)                                 errors of its channels, motion from its angles alone
    c_k  = (θ_-k - θ)ᵀ P_k (θ_-k - θ) - 2 g_kᵀ (θ_-k - θ)      its cost with its own motion, less that at θ

P_k and g_k are the precision and the right side of piece k at the estimate θ, its trajectory eliminated.
"""

from collections.abc import Callable
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from ident.errors import ExcitationError
from ident.estimation.measurement import Measurement
from ident.estimation.noise import channel_scales
from ident.recordings.times import Sampled
from ident.tolerances import ROUNDING, UNEXPLAINED
from ident.trajectory.angles_alone import Trajectory, smoothed
from ident.trajectory.fit.fitted import TINIEST, TrajectoryFit, inverse_of_precision
from ident.trajectory.fit.piece import Piece, channel_times, predicted

SMOOTHING = 0.01 * 2.0 ** np.arange(6)
"""Time constants with which angles alone are smoothed, s; the one that predicts best is used."""

CLEARLY = 0.03
"""Decrease of the mean log error, over the explained channels, with which another fit replaces the usual one: white
weights cost less and are more robust to model errors."""

LOSSES = 3.0
"""Ratio of the gains of pieces to the losses of others above which a parameter is accepted: pieces carry different
information on it, so that neither their number nor a mean would do."""


class HasFit(Protocol):
    """Estimate, or search for one."""

    @property
    def fit(self) -> TrajectoryFit:
        """Its fit."""


State = TypeVar("State", bound=HasFit)


class Move(NamedTuple, Generic[State]):
    """A change of what is fitted.

    Attributes:
        fitted: Function that fits with it; it may be undetermined.
        kept: Test of the result: True to keep it.
    """

    fitted: Callable[[], State]
    kept: Callable[[State], bool]


def after(state: State, move: Move[State]) -> State:
    """State after a move, or the state itself if that is undetermined or not kept."""
    if state.fit.status == "interrupted":
        return state
    try:
        tried = move.fitted()
    except (ExcitationError, np.linalg.LinAlgError):
        return state
    return tried if tried.fit.status == "interrupted" or move.kept(tried) else state


def moved(state: State, proposed: Callable[[State], Move[State] | None]) -> State:
    """State after moves that are proposed for it, one after another, until one is not kept or none is proposed."""
    while state.fit.status != "interrupted" and (move := proposed(state)) is not None:
        before, state = state, after(state, move)
        if state is before:
            break
    return state


def without(fit: TrajectoryFit, pieces: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters fitted without some pieces.

    Returns:
        θ (p,), the inverse of its precision (k, k) over the fitted parameters, and their mask (p,).

    Raises:
        ExcitationError: The other pieces do not determine the parameters.
    """
    own = fit.shares[pieces]
    precision = sum((-schur for schur, _ in own), start=fit.precision)
    right = sum((-gradient for _, gradient in own), start=fit.gradient)
    free = fit.free & (np.diag(precision) > ROUNDING * np.diag(fit.precision))
    theta, inverse = fit.theta.copy(), inverse_of_precision(precision[np.ix_(free, free)])
    theta[free] += inverse @ right[free]
    return theta, inverse, free


def prediction_errors(measurement: Measurement, fit: TrajectoryFit, least: np.ndarray) -> np.ndarray:
    """Root mean squared errors of channels predicted from other pieces, relative to their signal (C,).

    Channels that other pieces do not explain count as 1. Poses are left out: they do not depend on what is chosen.

    Args:
        measurement: Channels and parameters.
        fit: The estimate.
        least: Slack above which samples are left out (C,).
    """
    names = measurement.equations.channels
    own = zip(fit.pieces, fit.selections, strict=True)
    signals = [piece.signal - of_contacts(measurement, piece, fit.theta[at]) for piece, at in own]
    scales = channel_scales(signals, names)[: len(names)]
    try:
        thetas = [without(fit, slice(k, k + 1))[0][own] for k, own in enumerate(fit.selections)]
    except ExcitationError:
        return np.ones(len(scales))
    every = []
    for T in SMOOTHING:
        each = [_squares(measurement, *pair, T, least) for pair in zip(fit.pieces, thetas, strict=True)]
        squares, number = (np.sum(parts, axis=0) for parts in zip(*each, strict=True))
        every.append(np.where(number > 0, np.sqrt(squares / np.maximum(number, 1)) / scales, 1.0))
    return min(
        (np.maximum(np.where(each > UNEXPLAINED, 1.0, each), TINIEST) for each in every), key=lambda x: np.log(x).mean()
    )


def clearly_less(usual: np.ndarray, others: np.ndarray, margin: float = CLEARLY) -> bool:
    """True if another fit's errors are smaller than the usual one's by a margin, from `prediction_errors` (C,)."""
    explained = (usual < 1) | (others < 1)
    return bool(explained.any() and np.log(others[explained]).mean() < np.log(usual[explained]).mean() - margin)


def of_contacts(measurement: Measurement, piece: Piece, theta: np.ndarray) -> np.ndarray | float:
    """The contacts' part of a piece's channels (M, C): where nothing else carries, the channels without it are zero."""
    if not measurement.contacts:
        return 0.0
    motion = motion_alone(piece, measurement, theta, SMOOTHING[0]).evaluate
    return predicted(measurement, piece, motion, theta, of_contacts=True)


def _squares(
    measurement: Measurement, piece: Piece, theta: np.ndarray, T: float, least: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squared errors of a piece's channels but poses, and their numbers of samples (C,)."""
    motion, own = motion_alone(piece, measurement, theta, T), len(measurement.equations.channels)
    error = (piece.measured - predicted(measurement, piece, motion.evaluate, theta))[:, :own]
    clear = motion.settled(channel_times(measurement, piece, theta))[:, None] & np.isfinite(error)
    if piece.slack is not None:
        clear &= piece.slack[:, :own] < least[:own]
    return (np.where(clear, error, 0.0) ** 2).sum(axis=0), clear.sum(axis=0)


def motion_alone(piece: Piece, measurement: Measurement, theta: np.ndarray, T: float) -> Trajectory:
    """Measured coordinates of a piece, smoothed once with a time constant T, less their estimated zeros."""
    if T not in piece.alone:
        piece.alone[T] = smoothed(Sampled(piece.time, piece.states), T)
    zeros = np.zeros(piece.states.shape[1])
    for j, at in measurement.zeros.items():
        zeros[j] = theta[at]
    motion = piece.alone[T]
    return Trajectory(motion.splines, [c - zeros for c in motion.coefficients])


def gains(fit: TrajectoryFit, candidates: np.ndarray) -> list[np.ndarray]:
    """Decrease of each piece's predicted cost if more parameters are fitted, NaN as for `costs` (K,) each.

    Args:
        fit: The estimate with the parameters fixed.
        candidates: Masks of those to fit as well (k, p).
    """
    held = costs(fit, fit.free)
    return [held - costs(fit, fit.free | own) for own in candidates]


def costs(fit: TrajectoryFit, free: np.ndarray) -> np.ndarray:
    """Predicted costs of the pieces with some parameters fitted, less those at the estimate (K,).

    Args:
        fit: The estimate.
        free: Mask of the fitted parameters (p,).

    Returns:
        The costs, NaN if the pieces without one do not determine the parameters.
    """
    try:
        return np.array([_cost(fit, k, free) for k in range(len(fit.shares))])
    except ExcitationError:
        return np.full(len(fit.shares), np.nan)


def _cost(fit: TrajectoryFit, k: int, free: np.ndarray) -> float:
    """Cost of a piece at the parameters fitted to the others, less that at the estimate.

    Parameters that the others do not determine, as an offset of one recording, are fitted to the piece.
    """
    schur, right = fit.shares[k]
    others = fit.precision - schur
    shared = free & (np.diag(others) - np.diag(fit.prior.precision) > ROUNDING * np.diag(fit.precision))
    apart = free & ~shared
    step, own = np.zeros(len(free)), np.ix_(apart, apart)
    step[shared] = inverse_of_precision(others[np.ix_(shared, shared)]) @ (fit.gradient - right)[shared]
    pull = fit.gradient - (fit.gradient - right) * shared - schur @ step
    step[apart] = inverse_of_precision((schur + fit.prior.precision)[own]) @ pull[apart]
    return float(step @ schur @ step - 2 * right @ step)


def clearly_better(gain: np.ndarray) -> bool:
    """True if the pieces that gain (K,) gain far more than the others lose."""
    return bool(gain[gain > 0].sum() > LOSSES * -gain[gain < 0].sum())
