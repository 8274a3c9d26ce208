"""Piece of a recording in the trajectory estimate: samples, trajectory, and their linearised equations."""

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from ident.setup import Shift
from ident.trajectory.algebra.arrow import Arrow, Eliminated, Posterior
from ident.trajectory.algebra.rows import ChannelRows, Factors, StateRows
from ident.trajectory.algebra.sampling import Sampling
from ident.trajectory.algebra.spline import ORDER, Local, Spline
from ident.trajectory.algebra.whitening import Innovations, Sums, innovations


@dataclass(frozen=True, eq=False)
class Piece:
    """Samples of a recording with one trajectory.

    Attributes:
        spline: Spline space of the trajectory.
        time: Sample times of the coordinates, s (N,).
        states: Measured coordinates, and first and second derivatives where they are measured (N, n) each; NaN where
            a sample is missing, None for a derivative that is not measured.
        when: Sample times of the channels, s (M,).
        measured: Measured channels, NaN where a sample is missing (M, C).
        wrenches: Wrenches of the surroundings on the contacts at these times: averages and the rest (M, 2, 6 k).
        origin: Time zero of the channels' clock, s.
        late: Number of channels on that clock, the first ones, those of a wrench; by default all. Others are on the
            coordinates' clock.
        slack: Standard deviation of the channels' error in addition to noise (M, C), None for none.
        echo: What the measured coordinates make of commands, `kp q`, zero for other channels (M, C); None for none.
    """

    spline: Spline
    time: np.ndarray
    states: tuple[np.ndarray, np.ndarray | None, np.ndarray | None]
    when: np.ndarray
    measured: np.ndarray
    wrenches: np.ndarray
    origin: float = 0.0
    late: int | None = None
    slack: np.ndarray | None = None
    echo: np.ndarray | None = None

    @property
    def signal(self) -> np.ndarray:
        """Measured channels, commands as the torques that they make without damping (M, C)."""
        return self.measured if self.echo is None else self.measured - self.echo

    @cached_property
    def at_coordinates(self) -> Sampling:
        """Basis functions at the sample times of the coordinates, used in every round."""
        return Sampling(self.spline, self.time)

    @cached_property
    def _as_stamped(self) -> Sampling:
        return Sampling(self.spline, self.when)

    def at_channels(self, when: np.ndarray) -> Sampling:
        """Basis functions at true times of the channels' samples, computed once if these are as stamped."""
        return self._as_stamped if np.array_equal(when, self.when) else Sampling(self.spline, when)

    @cached_property
    def windows(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Windows for `StateRows` of the measured coordinates and derivatives, by order of the derivative."""
        out, at = {}, self.at_coordinates
        for kind in (kind for kind, measured in enumerate(self.states) if measured is not None):
            own = np.pad(at.intervals.dealt(at.local.basis[kind]), ((0, 0), (0, 0), (1, 0)))
            out[kind] = own, at.intervals.before(own, moved=1)
        return out


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of all streams and of the jerk.

    Attributes:
        states: Standard deviations of coordinates and of their derivatives (3, n).
        channels: Standard deviations of the channels (C,).
        jerk: λ of each coordinate, the inverse of the variance of its white jerk (n,).
        states_rho: ρ of the coordinates (3, n).
        channels_rho: ρ of the channels (C,).
        floor_states: Smallest standard deviations (3, n); `floor_channels` of the channels (C,).
        alike: Group number of each channel; noise is of similar size within a group. Empty for no groups.
    """

    states: np.ndarray
    channels: np.ndarray
    jerk: np.ndarray
    states_rho: np.ndarray
    channels_rho: np.ndarray
    floor_states: np.ndarray
    floor_channels: np.ndarray
    alike: tuple[int, ...] = ()

    def change(self, before: "Noise") -> float:
        """Largest change of the logarithm of a standard deviation, or of ρ."""
        logs = [np.abs(np.log(getattr(self, k) / getattr(before, k))) for k in ("states", "channels")]
        logs += [np.abs(getattr(self, k) - getattr(before, k)) for k in ("states_rho", "channels_rho")]
        return max(float(x.max(initial=0)) for x in logs)

    def midway(self, other: "Noise") -> "Noise":
        """Geometric means of standard deviations and smoothness, and means of ρ."""
        scales = {k: np.sqrt(getattr(self, k) * getattr(other, k)) for k in ("states", "channels", "jerk")}
        rhos = {k: (getattr(self, k) + getattr(other, k)) / 2 for k in ("states_rho", "channels_rho")}
        return replace(self, **scales, **rhos)


class Misfit(NamedTuple):
    """Sums of squares of a piece's residuals, and roughness of its trajectory.

    Streams are the coordinates, their first and second derivatives, and the channels: s = 3 n + C.

    Attributes:
        cost: Cost without the prior of θ.
        squares: Sums of squares of every stream's innovations and of their halves, as in `Sums` (3, s).
        number: Expected values of these if nothing were fitted (3, s).
        bends: `∫ x⃛² dt` of each coordinate (n,).
        rank: Rank of each coordinate's penalty (n,).
    """

    cost: float
    squares: np.ndarray
    number: np.ndarray
    bends: np.ndarray
    rank: np.ndarray


class Linearised(NamedTuple):
    """Linearised piece with the trajectory eliminated.

    With H the whole curvature and H_m a stream's part of it, the fit absorbs `tr(H⁻¹ H_m)` of the stream's degrees of
    freedom.

    Attributes:
        cost: Cost at the point of linearisation, as in `Misfit`.
        schur: Precision of θ (p, p).
        gradient: Right side (p,).
        step: Step of the coefficients at fixed θ (size n,).
        by_theta: Change with a step of θ, `step - by_theta @ δθ` (size n, p).
        taken: Absorbed degrees of freedom of innovations and of their halves; zero for halves where ρ is zero (3, s).
        held: `tr(H⁻¹ λ_j P_j)` of the jerk's penalties (n,).
    """

    cost: float
    schur: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    by_theta: np.ndarray
    taken: np.ndarray
    held: np.ndarray


class Predictor(Protocol):
    """Interface of a `Measurement` that a piece uses."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters θ."""

    @property
    def zeros(self) -> dict[int, int]:
        """Indices in θ of the coordinates' zeros, by coordinate."""

    @property
    def shifts(self) -> dict[int, Shift]:
        """Shifts of the samples' true times by their index in θ."""

    def values(self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Predicted channels (C, M)."""

    def derivatives(
        self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray, columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted channels (C, M), and their derivatives by the states (C, 3, n, M) and by entries of θ (C, k, M)."""


def misfit(
    measurement: Predictor, piece: Piece, coefficients: np.ndarray, *, theta: np.ndarray, noise: Noise
) -> Misfit:
    """Misfit of a trajectory and θ to the measured samples.

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
    """
    states = _states(measurement, piece, coefficients, theta, noise)
    channels = []
    for own, when in clocks(measurement, piece, theta):
        local = piece.at_channels(when).local
        predicted = measurement.values(local.combined(coefficients)[:3], piece.wrenches, theta)
        channels.append(_channels(piece, own, when, local, predicted, noise))
    bends = piece.spline.squared_jerk(coefficients)
    nothing = Sums(np.zeros((3, len(bends))), np.zeros((3, len(bends))))
    sums = [*(states[kind].sums if kind in states else nothing for kind in range(3)), *(new.sums for new in channels)]
    return Misfit(
        cost=_cost([*states.values(), *channels], noise, bends),
        squares=np.concatenate([each.squares for each in sums], axis=1),
        number=np.concatenate([each.number for each in sums], axis=1),
        bends=bends,
        rank=np.full(len(bends), float(piece.spline.size - ORDER)),
    )


def linearised(
    measurement: Predictor,
    piece: Piece,
    coefficients: np.ndarray,
    *,
    theta: np.ndarray,
    noise: Noise,
    columns: np.ndarray | None = None,
    root: np.ndarray | None = None,
) -> Linearised:
    """Normal equations of a piece at a trajectory and at θ, the trajectory eliminated.

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
        columns: Indices of the free entries of θ, ascending (k,), to which the results refer; by default all are free.
        root: Root of their covariance from all pieces (k, q); by default they absorb no degrees of freedom.

    Raises:
        numpy.linalg.LinAlgError: The trajectory is not determined.
    """
    columns = np.arange(len(theta)) if columns is None else columns
    n, S = coefficients.shape[1], piece.spline.intervals
    equations = normal_equations(measurement, piece, coefficients, theta, noise, columns)
    states, eliminated = equations.state_rows, equations.eliminated
    posterior = Posterior.of(eliminated, np.zeros((len(columns), 0)) if root is None else root, S, n)
    taken = [states[kind].taken(posterior) if kind in states else np.zeros((3, n)) for kind in range(3)]
    curvature = np.einsum("sjuv,uv->j", posterior.by_coordinate[:, :, 1:, 1:], piece.spline.penalty)
    return Linearised(
        cost=_cost(equations.innovations, noise, piece.spline.squared_jerk(coefficients)),
        schur=eliminated.schur,
        gradient=eliminated.gradient,
        step=eliminated.step,
        by_theta=eliminated.by_theta,
        taken=np.concatenate([*taken, *(each.rows.taken(posterior) for each in equations.channels)], axis=1),
        held=noise.jerk * curvature,
    )


class ChannelEquations(NamedTuple):
    """Rows of channels that share a clock.

    Attributes:
        channels: The channels.
        when: True times of their samples, s (M,).
        rows: The rows.
        new: Their innovations.
        by_states: Their derivatives by coordinates and the coordinates' derivatives (c, 3, n, M).
        by_theta: Their derivatives by θ (c, k, M).
    """

    channels: slice
    when: np.ndarray
    rows: ChannelRows
    new: Innovations
    by_states: np.ndarray
    by_theta: np.ndarray


class NormalEquations(NamedTuple):
    """Normal equations of a piece, and their rows.

    Attributes:
        eliminated: The equations, the trajectory eliminated.
        channels: The channels, grouped by clock.
        state_rows: Rows of measured coordinates and derivatives, by order of the derivative.
        states: Innovations of these.
    """

    eliminated: Eliminated
    channels: list[ChannelEquations]
    state_rows: dict[int, StateRows]
    states: dict[int, Innovations]

    @property
    def innovations(self) -> list[Innovations]:
        """Innovations of all streams."""
        return [*self.states.values(), *(each.new for each in self.channels)]


def normal_equations(
    measurement: Predictor,
    piece: Piece,
    coefficients: np.ndarray,
    theta: np.ndarray,
    noise: Noise,
    columns: np.ndarray,
) -> NormalEquations:
    """Normal equations of a piece at a trajectory and at θ, for the free entries of θ.

    Raises:
        numpy.linalg.LinAlgError: The trajectory is not determined.
    """
    channels = list(_channel_rows(measurement, piece, coefficients, theta, noise, columns))
    states = _states(measurement, piece, coefficients, theta, noise)
    state_rows = {kind: _state_rows(measurement, piece, own, kind, columns) for kind, own in states.items()}
    arrow = Arrow(piece.spline, coefficients.shape[1], len(columns))
    for each in channels:
        each.rows.add_to(arrow)
    for rows in state_rows.values():
        rows.add_to(arrow)
    arrow.add_penalty(noise.jerk, coefficients)
    return NormalEquations(arrow.eliminated(), channels, state_rows, states)


def _cost(every: Iterable[Innovations], noise: Noise, bends: np.ndarray) -> float:
    """Cost of a piece, from the innovations of all its streams and the `∫ x⃛² dt` of its trajectory (n,)."""
    return sum(new.cost for new in every) + float(noise.jerk @ bends)


def channel_times(measurement: Predictor, piece: Piece, theta: np.ndarray) -> np.ndarray:
    """True times of the channels' samples, corrected for delays and the clock's rate, s (M,)."""
    when, elapsed = piece.when, piece.when - piece.origin
    for at, shift in measurement.shifts.items():
        when = when + theta[at] * shift(elapsed)
    return when


def clocks(
    measurement: Predictor, piece: Piece, theta: np.ndarray, columns: Collection[int] = ()
) -> list[tuple[slice, np.ndarray]]:
    """Groups of channels that share a clock, each with the true times of its samples, s (M,); none without channels.

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        theta: Parameters (p,).
        columns: Entries of θ by which channels are differentiated.
    """
    number = piece.measured.shape[1]
    if not number:
        return []
    whole = piece.late is None or piece.late >= number
    if whole or not any(theta[at] or at in columns for at in measurement.shifts):
        return [(slice(0, number), channel_times(measurement, piece, theta))]
    return [(slice(0, piece.late), channel_times(measurement, piece, theta)), (slice(piece.late, number), piece.when)]


def predicted(
    measurement: Predictor, piece: Piece, motion: Callable[[np.ndarray], np.ndarray], theta: np.ndarray
) -> np.ndarray:
    """Predicted channels of a piece at a motion (M, C).

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        motion: Coordinates and at least their first two derivatives as a function of time (3, M, n).
        theta: Parameters (p,).
    """
    parts = [
        measurement.values(motion(when)[:3], piece.wrenches, theta)[own]
        for own, when in clocks(measurement, piece, theta)
    ]
    return np.concatenate(parts).T


def _channels(
    piece: Piece, own: slice, when: np.ndarray, local: Local, predicted: np.ndarray, noise: Noise
) -> Innovations:
    """Innovations of some channels, from predictions (C, M); a delay may put samples beyond the trajectory."""
    residual = np.where(piece.spline.holds(when)[:, None], (piece.measured - predicted.T)[:, own], np.nan)
    slack = None if piece.slack is None else piece.slack[:, own]
    return innovations(residual, local.interval, noise.channels[own], noise.channels_rho[own], slack)


def _channel_rows(
    measurement: Predictor,
    piece: Piece,
    coefficients: np.ndarray,
    theta: np.ndarray,
    noise: Noise,
    columns: np.ndarray,
) -> Iterator[ChannelEquations]:
    """Yields the rows and innovations of the channels on each clock; rows depend on all coordinates and free θ."""
    for k, (own, when) in enumerate(clocks(measurement, piece, theta, columns.tolist())):
        at = piece.at_channels(when)
        local, intervals = at.local, at.intervals
        x = local.combined(coefficients)
        values, by_states, by_theta = measurement.derivatives(x[:3], piece.wrenches, theta, columns)
        by_states, by_theta = by_states.transpose(3, 0, 1, 2)[:, own], by_theta.transpose(2, 0, 1)[:, own]
        if k == 0:
            rate = np.einsum("mcdj,dmj->mc", by_states, x[1:])
            for entry, shift in measurement.shifts.items():
                by_theta[..., columns == entry] = (rate * shift(piece.when - piece.origin)[:, None])[..., None]
        new = _channels(piece, own, when, local, values, noise)
        rows = ChannelRows(
            intervals,
            basis=at.dealt,
            by_states=intervals.dealt(by_states),
            by_theta=intervals.dealt(by_theta),
            factors=Factors.of(new, intervals),
        )
        by = by_states.transpose(1, 2, 3, 0), by_theta.transpose(1, 2, 0)
        yield ChannelEquations(own, when, rows, new, *by)


def _states(
    measurement: Predictor, piece: Piece, coefficients: np.ndarray, theta: np.ndarray, noise: Noise
) -> dict[int, Innovations]:
    """Innovations of measured coordinates and derivatives, by order of the derivative."""
    local = piece.at_coordinates.local
    predicted = local.combined(coefficients)
    for j, at in measurement.zeros.items():
        predicted[0, :, j] += theta[at]
    return {
        kind: innovations(measured - predicted[kind], local.interval, noise.states[kind], noise.states_rho[kind])
        for kind, measured in enumerate(piece.states)
        if measured is not None
    }


def _state_rows(measurement: Predictor, piece: Piece, new: Innovations, kind: int, columns: np.ndarray) -> StateRows:
    """Rows of the coordinates or a derivative, which depend on one coordinate each and on its zero if that is free."""
    zeros = {j: int(np.searchsorted(columns, at)) for j, at in measurement.zeros.items() if kind == 0 and at in columns}
    intervals = piece.at_coordinates.intervals
    return StateRows(intervals, piece.windows[kind], zeros, Factors.of(new, intervals))
