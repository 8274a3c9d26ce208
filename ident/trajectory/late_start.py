"""Starting values for long delays, which the score test misses because their effect is not linear.

A force plate under a person may be late by a tenth of a second or more, as long as accelerations take to change sign.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.noise import LEAST, beside_others
from ident.trajectory.angles_alone import Trajectory
from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.fit.piece import Piece, clocks
from ident.trajectory.left_out import motion_alone
from ident.trajectory.start import reweighted

SPACING, FURTHEST = 0.05, 3.0
"""Delays to try: their spacing in seconds, half of which the score test covers, and the largest one in standard
deviations of its prior."""

BETTER = 0.9
"""Largest geometric mean of the channels' residuals, over that without a delay, with which a delay is tried."""

SMOOTHED = 0.02, 0.08
"""Time constants of smoothing to try, s: for motions of robots and of people."""

REMAINING = 0.9
"""Least share of the samples that must overlap with the motion after a delay: few can be explained by chance."""

TINY = 1e-150
"""Least size of residuals, so that the logarithm of zeros is finite."""

TRIED, COMPARED = 20_000, 400
"""Approximate largest numbers of samples: of angles to smooth, and of channels to compare."""


def likely_delay(measurement: Measurement, at: int, fit: TrajectoryFit) -> float:
    """Delay with which the motion from angles alone predicts channels best, columns fitted again, s.

    Args:
        measurement: Channels, and the parameters of one recording.
        at: Index of the delay among all parameters.
        fit: Pieces and parameters.

    Returns:
        The delay, zero if none is clearly better than no delay.
    """
    own = [(piece, chosen) for piece, chosen in zip(fit.pieces, fit.selections, strict=True) if at in chosen]
    own = own[:: -(-sum(len(piece.time) for piece, _ in own) // TRIED)]
    share = -(-sum(len(piece.when) for piece, _ in own) // COMPARED)
    longest = max(piece.time[-1] - piece.time[0] for piece, _ in own)
    delays = _candidates(float(np.sqrt(fit.prior.known[at, at])), longest)
    number = len(delays) // 2

    def left(T: float) -> list[float]:
        motions = [motion_alone(piece, measurement, fit.theta[chosen], T) for piece, chosen in own]
        out = []
        for delay in delays.tolist():
            theta = np.where(np.arange(len(fit.theta)) == at, delay, fit.theta)
            each = zip(own, motions, strict=True)
            parts = [compared(measurement, piece, motion, theta[chosen], share) for (piece, chosen), motion in each]
            residuals, columns = zip(*parts, strict=True)
            out.append((np.concatenate(residuals), np.concatenate(columns)))
        least = max(REMAINING * len(out[number][0]), len(measurement.equations.names))
        channels = measurement.equations.channels
        return [unexplained(b, A, channels) if len(b) >= least else np.inf for b, A in out]

    every = min(map(left, SMOOTHED), key=min)
    best = int(np.argmin(every))
    better = np.isfinite(every[number]) and every[best] < every[number] + np.log(BETTER)
    return float(delays[best]) if better else 0.0


def compared(
    measurement: Measurement, piece: Piece, motion: Trajectory, theta: np.ndarray, share: int
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (M, C) and columns (M, C, k) of every `share`-th sample, of those neither missing nor near the ends."""
    piece = replace(piece, measured=piece.measured[:, : len(measurement.equations.channels)])
    every = clocks(measurement, piece, theta)
    settled = np.all([motion.settled(when) for _, when, _ in every], axis=0)
    taken = np.flatnonzero(np.isfinite(piece.measured).all(axis=1) & settled)[::share]
    residual, chosen = piece.measured[taken], np.arange(len(measurement.equations.names))
    columns = np.zeros((*residual.shape, len(chosen)))
    for own, when, _ in every if len(taken) else ():
        states = motion.evaluate(when[taken])[:3]
        predicted, _, derivatives = measurement.derivatives(states, piece.wrenches[taken], theta, chosen)
        residual[:, own] -= predicted[own].T
        columns[:, own] = derivatives[own].transpose(2, 0, 1)
    return residual, columns


def unexplained(residual: np.ndarray, columns: np.ndarray, channels: Sequence[str]) -> float:
    """Mean logarithm of the channels' RMS residuals (M, C) after columns (M, C, k) are fitted."""
    rms = np.sqrt((residual**2).mean(axis=0))
    least = LEAST * beside_others(rms, channels)
    step, _ = reweighted(residual, columns, np.maximum(rms, least), least)
    return float(np.log(np.maximum(np.sqrt(((residual - columns @ step) ** 2).mean(axis=0)), TINY)).mean())


def _candidates(root: float, longest: float) -> np.ndarray:
    """Delays to try, symmetric about zero, s.

    Args:
        root: Inverse of the prior's standard deviation, zero for none, 1/s.
        longest: Length of the longest piece, s: after a longer delay, channels and motion do not overlap.
    """
    number = int((min(FURTHEST / root, longest) if root else longest) / SPACING)
    return SPACING * np.arange(-number, number + 1)
