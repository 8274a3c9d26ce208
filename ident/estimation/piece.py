"""One piece of a recording in the joint estimate: its samples, its trajectory, and the two linearised."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ident.estimation.arrow import Arrow
from ident.estimation.block_tridiagonal import WINDOW
from ident.estimation.spline import Local, Spline
from ident.estimation.streams import Stream, channel_streams, penalty_streams, state_streams
from ident.estimation.whitening import Innovations, Rows, innovations, whitened


@dataclass(frozen=True, eq=False)
class Piece:
    """Samples of a recording that one trajectory runs through.

    Attributes:
        spline: The space of the trajectory.
        time: Sample times of the coordinates, s (N,).
        states: Measured coordinates, and first and second derivatives where they are measured (N, n) each; NaN where
            a sample is missing, None for a derivative that is not measured.
        when: Sample times of the channels, s (M,).
        measured: Measured channels, NaN where a sample is missing (M, C).
        wrenches: What the surroundings exert at contacts then, as averages and what is left of them (M, 2, 6 k).
        origin: Time from which the channels' clock is counted, s.
    """

    spline: Spline
    time: np.ndarray
    states: tuple[np.ndarray, np.ndarray | None, np.ndarray | None]
    when: np.ndarray
    measured: np.ndarray
    wrenches: np.ndarray
    origin: float = 0.0


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of all streams, and the jerk's.

    Attributes:
        states: Standard deviations of coordinates and of their derivatives (3, n).
        channels: Of the channels (C,).
        jerk: λ of each coordinate, the inverse of the variance of its white jerk (n,).
        states_rho: ρ of the coordinates (3, n).
        channels_rho: ρ of the channels (C,).
        floor_states: Smallest standard deviations (3, n); `floor_channels` of the channels (C,).
    """

    states: np.ndarray
    channels: np.ndarray
    jerk: np.ndarray
    states_rho: np.ndarray
    channels_rho: np.ndarray
    floor_states: np.ndarray
    floor_channels: np.ndarray

    def change(self, before: "Noise") -> float:
        """Largest change of the logarithm of a standard deviation, or of ρ."""
        logs = [np.abs(np.log(getattr(self, k) / getattr(before, k))) for k in ("states", "channels")]
        logs += [np.abs(getattr(self, k) - getattr(before, k)) for k in ("states_rho", "channels_rho")]
        return max(float(x.max(initial=0)) for x in logs)


class Linearised(NamedTuple):
    """A piece, its trajectory eliminated.

    Attributes:
        schur: Precision of θ (p, p).
        gradient: Right side (p,).
        step: Step of the coefficients at fixed θ (size n,).
        by_theta: How it changes with a step of θ, `step - by_theta @ δθ` (size n, p).
        states: The coordinates' streams, `channels` those of the channels, `penalty` the jerk's.
    """

    schur: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    by_theta: np.ndarray
    states: Stream
    channels: Stream
    penalty: Stream


class Predictor(Protocol):
    """What a piece asks of a `Measurement`."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters θ."""

    @property
    def zeros(self) -> dict[int, int]:
        """Where the zeros of coordinates stand in θ, by the coordinates."""

    def of_kind(self, kind: str, of: str = "") -> dict[int | None, int]:
        """Where the set-up parameters of a kind stand in θ, by their axes."""

    def values(self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Predicted channels (C, M)."""

    def derivatives(
        self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted channels (C, M), and their derivatives by the states (C, 3, n, M) and by θ (C, p, M)."""


class _States(NamedTuple):
    """Measured coordinates, or a derivative of them, and where they are on the trajectory.

    Attributes:
        local: Basis functions at the samples.
        new: What is new in each sample (N, n).
    """

    local: Local
    new: Innovations


def cost(measurement: Predictor, piece: Piece, coefficients: np.ndarray, *, theta: np.ndarray, noise: Noise) -> float:
    """What is minimised, but for the prior of θ.

    Args:
        measurement: Channels and parameters.
        piece: What was measured.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
    """
    total = sum(states.new.cost for states in _states(measurement, piece, coefficients, theta, noise).values())
    when = channel_times(measurement, piece, theta)
    local = piece.spline.local(when)
    predicted = measurement.values(local.combined(coefficients)[:3], piece.wrenches, theta)
    residual = np.where(piece.spline.holds(when)[:, None], piece.measured - predicted.T, np.nan)
    total += innovations(residual, local.interval, noise.channels, noise.channels_rho).cost
    return total + float(noise.jerk @ piece.spline.squared_jerk(coefficients))


def linearised(
    measurement: Predictor,
    piece: Piece,
    coefficients: np.ndarray,
    *,
    theta: np.ndarray,
    noise: Noise,
    columns: np.ndarray | None = None,
) -> Linearised:
    """The normal equations of a piece at a trajectory and at θ, the trajectory eliminated.

    Args:
        measurement: Channels and parameters.
        piece: What was measured.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
        columns: Entries of θ that are not held, ascending (k,); by default all are free. What is said of θ is of these.

    Raises:
        numpy.linalg.LinAlgError: The trajectory is not determined.
    """
    columns = np.arange(len(theta)) if columns is None else columns
    arrow = Arrow(piece.spline, coefficients.shape[1], len(columns))
    channels = _channel_rows(measurement, piece, coefficients, theta, noise, columns)
    arrow.add(channels)
    states = {
        kind: _state_rows(measurement, piece, own, kind, columns)
        for kind, own in _states(measurement, piece, coefficients, theta, noise).items()
    }
    for rows in states.values():
        arrow.add_separate(rows)
    arrow.add_penalty(noise.jerk, coefficients)
    eliminated = arrow.eliminated()
    return Linearised(
        schur=eliminated.schur,
        gradient=eliminated.gradient,
        step=eliminated.step,
        by_theta=eliminated.by_theta,
        states=state_streams(states, eliminated),
        channels=channel_streams(channels, eliminated),
        penalty=penalty_streams(piece.spline, coefficients, noise.jerk, eliminated),
    )


def channel_times(measurement: Predictor, piece: Piece, theta: np.ndarray) -> np.ndarray:
    """When the channels were what their samples say: delays and the clock's rate taken out, s (M,)."""
    when = piece.when
    for at in measurement.of_kind("clock").values():
        when = when + theta[at] * (piece.when - piece.origin)
    for at in measurement.of_kind("delay").values():
        when = when - theta[at]
    return when


def _channel_rows(
    measurement: Predictor,
    piece: Piece,
    coefficients: np.ndarray,
    theta: np.ndarray,
    noise: Noise,
    columns: np.ndarray,
) -> Rows:
    """Rows of the channels, which see all coordinates and all of θ that is not held."""
    when = channel_times(measurement, piece, theta)
    local = piece.spline.local(when)
    x = local.combined(coefficients)
    values, by_states, by_theta = measurement.derivatives(x[:3], piece.wrenches, theta)
    by_states, by_theta = by_states.transpose(3, 0, 1, 2), by_theta.transpose(2, 0, 1)
    rate = np.einsum("mcdj,dmj->mc", by_states, x[1:])
    for at in measurement.of_kind("clock").values():
        by_theta[..., at] = rate * (piece.when - piece.origin)[:, None]
    for at in measurement.of_kind("delay").values():
        by_theta[..., at] = -rate
    windows = np.zeros((*rate.shape, WINDOW, coefficients.shape[1]))
    windows[:, :, 1:] = local.basis[:3].transpose(1, 2, 0)[:, None] @ by_states
    # A delay or another clock may put samples beyond the trajectory's end.
    residual = np.where(piece.spline.holds(when)[:, None], piece.measured - values.T, np.nan)
    new = innovations(residual, local.interval, noise.channels, noise.channels_rho)
    border, every = by_theta[..., columns], np.arange(len(columns))
    return whitened(new, local.interval, piece.spline.intervals, windows=windows, border=border, columns=every)


def _states(
    measurement: Predictor, piece: Piece, coefficients: np.ndarray, theta: np.ndarray, noise: Noise
) -> dict[int, _States]:
    """What is measured of the coordinates, by the order of the derivative."""
    local = piece.spline.local(piece.time)
    predicted = local.combined(coefficients)
    for j, at in measurement.zeros.items():
        predicted[0, :, j] += theta[at]
    return {
        kind: _States(
            local,
            innovations(measured - predicted[kind], local.interval, noise.states[kind], noise.states_rho[kind]),
        )
        for kind, measured in enumerate(piece.states)
        if measured is not None
    }


def _state_rows(measurement: Predictor, piece: Piece, states: _States, kind: int, columns: np.ndarray) -> Rows:
    """Rows of the coordinates or of a derivative, which see one coordinate each, and its zero unless that is held."""
    interval, basis = states.local
    N, n = states.new.values.shape
    windows = np.zeros((N, n, WINDOW, 1))
    windows[:, :, 1:, 0] = basis[kind][:, None]
    zeros = {j: at for j, at in measurement.zeros.items() if kind == 0 and at in columns}
    border = np.zeros((N, n, len(zeros)))
    border[:, list(zeros), np.arange(len(zeros))] = 1
    seen = np.searchsorted(columns, list(zeros.values())).astype(int)
    return whitened(states.new, interval, piece.spline.intervals, windows=windows, border=border, columns=seen)
