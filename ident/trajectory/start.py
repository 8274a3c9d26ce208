"""Starting point of the trajectory estimate: coordinates smoothed one by one, then least squares for parameters.

Long delays have a start of their own, because the score test misses them: their effect is not linear. A force plate
under a person may be late by a tenth of a second or more, as long as accelerations take to change sign.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.noise import LEAST, beside_others, channel_scales, least_noise, rounding
from ident.recordings.smoothing import at_rest, white_noise
from ident.trajectory.angles_alone import Trajectory
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import TINIEST, Prior, TrajectoryFit
from ident.trajectory.fit.piece import Noise, Piece, channel_times, clocks
from ident.trajectory.left_out import motion_alone

REWEIGHTED = 4
"""Number of least-squares fits, each with the channels weighted by the residuals of the one before."""

FITS = 40
"""Rounds of smoothing."""

WHITE: Sequence[tuple[int, tuple[str, ...], bool]] = (3, ("states", "jerk"), False), (FITS, (), False)
"""Fits by which coordinates are smoothed: rounds, what is kept of the noise, and whether it may be correlated."""

SMOOTH = 2 * np.pi
"""Angular frequency ω of a motion as smooth as the first guess of λ, rad/s: its jerk is ω³ times its size."""

LOOSE = 0.05
"""Slack over the scale of its channel above which a sample is left out of the first least-squares fit."""

NOTHING = 1e-6
"""Least noise over the spread of a coordinate."""

AT_REST = 1e-3
"""Least noise of a coordinate at rest, over the largest spread of all coordinates. Its samples may show none, and its
zero follows from differences between their weight and the trajectory's: with a tenth of this noise these are lost to
rounding."""

TINY = 1e-12, 1e-9
"""Noise and spread assumed for a constant coordinate."""

SPACING, FURTHEST = 0.05, 3.0
"""Delays to try: their spacing in seconds, half of which the score test covers, and the largest one in standard
deviations of its prior."""

BETTER = 0.9
"""Largest geometric mean of the channels' residuals, over that without a delay, with which a delay is tried."""

SMOOTHED = 0.02, 0.08
"""Time constants of smoothing to try, s: for motions of robots and of people."""

REMAINING = 0.9
"""Least share of the samples that must overlap with the motion after a delay: few can be explained by chance."""

COMPARED = 400
"""Approximate largest number of samples of channels to compare."""


def _none(_: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the coordinates and of θ on which no channels depend (0, 0)."""
    return np.zeros((0, 0), bool), np.zeros((0, len(columns)), bool)


NONE_OF = "zeros", "shifts", "torque_shifts", "pose_shifts", "tracked"
"""Parts of a measurement of which coordinates alone have none."""

COORDINATES = cast(Measurement, SimpleNamespace(names=(), dependence=_none, **{name: {} for name in NONE_OF}))
"""Stand-in for the measurement in fits of coordinates alone, without channels and parameters."""


def start(
    measurement: Measurement,
    pieces: Sequence[Piece],
    alone: TrajectoryFit,
    prior: tuple[np.ndarray, np.ndarray],
    free: np.ndarray,
) -> tuple[np.ndarray, list[Noise]]:
    """Parameters by weighted least squares (p,), and the noise of every recording with that of the channels.

    Args:
        measurement: Channels and parameters.
        pieces: Measured samples.
        alone: Coordinates smoothed alone.
        prior: Mean (p,) and precision (p, p) of θ, zero where nothing is known.
        free: Mask of the entries of θ to fit; the others have their means (p,).
    """
    names, alike, noises = measurement.equations.channels, _alike(measurement), list[Noise]()
    signals, theta = [piece.signal for piece in pieces], prior[0].copy()
    scales, rows, right = channel_scales(signals, names), [], []
    for piece, c in zip(pieces, alone.coefficients, strict=True):
        x = piece.spline.evaluate(c, channel_times(measurement, piece, theta))
        values, _, by_theta = measurement.derivatives(x[:3], piece.wrenches, theta, np.flatnonzero(free))
        loose = False if piece.slack is None else piece.slack > LOOSE * scales
        rows.append(by_theta.transpose(2, 0, 1))
        right.append(np.where(loose, np.nan, piece.measured - values.T))
    given = np.concatenate(right), np.concatenate(rows), scales, least_noise(signals, names)
    step, channels = reweighted(*given, prior[1][np.ix_(free, free)])
    theta[free] += step
    for log, noise in enumerate(alone.noises):
        own = least_noise([piece.signal for piece in pieces if piece.log == log], names)
        std, rho = np.maximum(channels, own), np.zeros(len(own))
        noises.append(replace(noise, channels=std, channels_rho=rho, floor_channels=own, alike=alike))
    return theta, noises


def smoothed(
    pieces: Sequence[Piece],
    noises: Sequence[Noise] | None = None,
    *,
    coloured: bool = False,
    executor: Executor | None = None,
) -> TrajectoryFit:
    """Every coordinate smoothed alone, with smoothness, and noise unless given, by restricted likelihood.

    Args:
        pieces: Measured samples.
        noises: The noise of every recording, if known.
        coloured: True if it may be correlated over time.
        executor: Executor for the pieces; by default they are computed here.
    """
    none, logs = np.zeros(0), range(max(piece.log for piece in pieces) + 1)
    own = noises or [_first_noise([piece for piece in pieces if piece.log == log]) for log in logs]
    own = [replace(noise, channels=none, channels_rho=none, floor_channels=none, alike=()) for noise in own]
    bare = [
        replace(piece, when=none, measured=np.zeros((0, 0)), wrenches=piece.wrenches[:0], slack=None)
        for piece in pieces
    ]
    prior, no_indices = Prior(none, np.zeros((0, 0))), [np.zeros(0, int)] * len(logs)
    fit = TrajectoryFit([], no_indices, prior, none, none > 0, own, [_interpolated(piece) for piece in pieces], bare)
    fits = [*WHITE, *[(FITS, (), True)] * coloured] if noises is None else [(FITS, ("states",), False)]
    for rounds, kept, may in fits:
        fit = iteration.fit(COORDINATES, fit, coloured=may, kept=kept, executor=executor, rounds=rounds)
    return fit


def _first_noise(pieces: Sequence[Piece]) -> Noise:
    """First guess of a recording's, from its pieces."""
    spread = np.maximum(np.nanstd(np.concatenate([piece.states for piece in pieces]), axis=0), TINY[1])
    none, parts = np.zeros(0), zip(*(piece.states.T for piece in pieces), strict=True)
    rests = np.where(_resting(pieces), AT_REST * spread.max(), 0.0)
    floor = np.maximum(np.maximum(NOTHING * spread, rests), rounding([piece.states for piece in pieces]))
    std = np.maximum([white_noise(*each) for each in parts], np.maximum(floor, TINY[0]))
    return Noise(std, none, 1 / (spread**2 * SMOOTH**6), 0 * std, none, floor, none)


def _resting(pieces: Sequence[Piece]) -> np.ndarray:
    """Mask of the coordinates that rest in every piece (n,)."""
    q = np.concatenate([piece.states for piece in pieces])
    largest = float(np.max(np.nanmax(q, axis=0) - np.nanmin(q, axis=0)))
    each = [[at_rest(x, largest) for x in piece.states.T] for piece in pieces]
    return np.asarray(np.all(each, axis=0))


def _alike(measurement: Measurement) -> tuple[int, ...]:
    """Group number of each channel: forces of a sensor, its moments, joint torques each, positions, orientations."""
    groups, single = [component // 3 for component in measurement.components], len(measurement.equations.channels)
    poses = (2 + single + k // 3 for k in range(measurement.width - single))
    return (*groups, *range(2, 2 + single - len(groups)), *poses)


def _interpolated(piece: Piece) -> np.ndarray:
    """Coefficients near the samples: the coordinate at the middle of each basis function (size, n)."""
    middle = piece.spline.start + (np.arange(piece.spline.size) - 2) * piece.spline.step
    measured = ((x, np.isfinite(x)) for x in piece.states.T)
    return np.stack([np.interp(middle, piece.time[there], x[there]) for x, there in measured], axis=1)


def reweighted(
    residual: np.ndarray, columns: np.ndarray, std: np.ndarray, floor: np.ndarray, precision: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of least squares reweighted by channel (k,), and the channels' standard deviations (C,).

    Args:
        residual: Samples of the channels, NaN where one is missing (N, C).
        columns: Their derivatives by the coefficients (N, C, k).
        std: Standard deviations of the channels in the first fit (C,).
        floor: Least ones (C,).
        precision: Precision of a prior of the coefficients about zero (k, k).
    """
    there = np.isfinite(residual)
    A, b = np.where(there[..., None], columns, 0), np.where(there, residual, 0)
    by_channel = A.transpose(1, 2, 0)
    normals, rights = by_channel @ A.swapaxes(0, 1), (by_channel @ b.T[:, :, None])[..., 0]
    step = np.zeros(A.shape[-1])
    for _ in range(REWEIGHTED):
        normal, right = np.tensordot(std**-2, normals, axes=1) + precision, std**-2 @ rights
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
        rms = np.sqrt(((b - A @ step) ** 2).sum(axis=0) / np.maximum(there.sum(axis=0), 1))
        std = np.maximum(rms, floor)
    return step, std


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
    share = -(-sum(len(piece.when) for piece, _ in own) // COMPARED)
    longest = max(piece.time[-1] - piece.time[0] for piece, _ in own)
    # After a longer delay channels and motion do not overlap; no prior has no limit of its own.
    most = FURTHEST / max(float(np.sqrt(fit.prior.known[at, at])), TINIEST)
    number = int(min(most, longest) / SPACING)
    delays = SPACING * np.arange(-number, number + 1)

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
    return float(np.log(np.maximum(np.sqrt(((residual - columns @ step) ** 2).mean(axis=0)), TINIEST)).mean())
