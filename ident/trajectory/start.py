"""Starting point of the trajectory estimate: coordinates smoothed one by one, then least squares for parameters."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import cast

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.noise import channel_scales, least_noise, rounding
from ident.recordings.smoothing import at_rest, white_noise
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import Prior, Start
from ident.trajectory.fit.piece import Noise, Piece, channel_times

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


def _none(_: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the coordinates and of θ on which no channels depend (0, 0)."""
    return np.zeros((0, 0), bool), np.zeros((0, len(columns)), bool)


COORDINATES = cast(
    Measurement, SimpleNamespace(names=(), zeros={}, shifts={}, pose_shifts={}, tracked={}, dependence=_none)
)
"""Stand-in for the measurement in fits of coordinates alone, without channels and parameters."""


def start(
    measurement: Measurement,
    pieces: Sequence[Piece],
    alone: Start,
    prior: tuple[np.ndarray, np.ndarray],
    free: np.ndarray,
) -> Start:
    """Starting point of smoothed coordinates, and parameters by weighted least squares.

    Args:
        measurement: Channels and parameters.
        pieces: Measured samples.
        alone: Coordinates smoothed alone.
        prior: Mean (p,) and precision (p, p) of θ, zero where nothing is known.
        free: Mask of the entries of θ to fit; the others have their means (p,).
    """
    names, alike, noises = measurement.equations.channels, _alike(measurement), list[Noise]()
    floor = least_noise([piece.signal for piece in pieces], names)
    theta, channels = _regressed(measurement, pieces, alone.coefficients, prior, free, floor)
    for log, noise in enumerate(alone.noises):
        own = least_noise([piece.signal for piece in pieces if piece.log == log], names)
        std, rho = np.maximum(channels, own), np.zeros(len(own))
        noises.append(replace(noise, channels=std, channels_rho=rho, floor_channels=own, alike=alike))
    return Start(theta, noises, alone.coefficients)


def smoothed(
    pieces: Sequence[Piece],
    noises: Sequence[Noise] | None = None,
    *,
    coloured: bool = False,
    executor: Executor | None = None,
) -> Start:
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
    begin = Start(none, own, [_interpolated(piece) for piece in pieces])
    bare = [
        replace(piece, when=none, measured=np.zeros((0, 0)), wrenches=piece.wrenches[:0], slack=None)
        for piece in pieces
    ]
    fits = [*WHITE, *[(FITS, (), True)] * coloured] if noises is None else [(FITS, ("states",), False)]
    fit = partial(iteration.fit, COORDINATES, bare, prior=Prior(none, np.zeros((0, 0))), free=np.zeros(0, bool))
    for rounds, kept, may in fits:
        begin = fit(begin, coloured=may, kept=kept, executor=executor, rounds=rounds).end
    return begin


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


def _regressed(
    measurement: Measurement,
    pieces: Sequence[Piece],
    coefficients: Sequence[np.ndarray],
    prior: tuple[np.ndarray, np.ndarray],
    free: np.ndarray,
    floor: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """θ by least squares on given trajectories, and standard deviations of the channels' residuals (C,)."""
    theta, precision = prior[0].copy(), prior[1][np.ix_(free, free)]
    A, b = _linear(measurement, pieces, coefficients, theta, free)
    std = channel_scales([piece.signal for piece in pieces], measurement.equations.channels)
    step, std = reweighted(np.where(_loose(pieces, std), np.nan, b), A, std, floor, precision)
    theta[free] += step
    return theta, std


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


def _loose(pieces: Sequence[Piece], scales: np.ndarray) -> np.ndarray:
    """Mask of the channels' samples whose slack is not small relative to the channels' scales (C,), (N, C)."""
    nothing = (np.zeros(piece.measured.shape) if piece.slack is None else piece.slack for piece in pieces)
    return np.asarray(np.concatenate(list(nothing)) > LOOSE * scales)


def _linear(
    measurement: Measurement,
    pieces: Sequence[Piece],
    coefficients: Sequence[np.ndarray],
    theta: np.ndarray,
    free: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of all pieces' channels by the free entries of θ (N, C, f), and their residuals (N, C)."""
    rows, right = [], []
    for piece, c in zip(pieces, coefficients, strict=True):
        x = piece.spline.evaluate(c, channel_times(measurement, piece, theta))
        values, _, by_theta = measurement.derivatives(x[:3], piece.wrenches, theta, np.flatnonzero(free))
        rows.append(by_theta.transpose(2, 0, 1))
        right.append(piece.measured - values.T)
    return np.concatenate(rows), np.concatenate(right)
