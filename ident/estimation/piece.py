"""One piece of a recording in the joint estimate: its samples, its trajectory, and the two linearised."""

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from ident.estimation.arrow import Arrow, Eliminated, Posterior
from ident.estimation.intervals import Intervals
from ident.estimation.rows import ChannelRows, Factors, StateRows
from ident.estimation.spline import ORDER, Local, Spline
from ident.estimation.whitening import Innovations, Sums, innovations


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
        late: Number of the first channels, those of a wrench, whose clock it is; by default all are on it. Others are
            on the coordinates' clock.
        slack: Standard deviation of what is unknown of the channels besides their noise (M, C), None for nothing.
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

    @cached_property
    def local(self) -> Local:
        """Basis functions at the sample times of the coordinates, which every round asks for."""
        return self.spline.local(self.time)

    @cached_property
    def intervals(self) -> Intervals:
        """Where these samples are."""
        return Intervals(self.local.interval, self.spline.intervals)

    @cached_property
    def windows(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """As `StateRows` needs them, of what is measured of the coordinates, by the order of the derivative."""
        out = {}
        for kind in (kind for kind, measured in enumerate(self.states) if measured is not None):
            own = np.pad(self.intervals.dealt(self.local.basis[kind]), ((0, 0), (0, 0), (1, 0)))
            out[kind] = own, self.intervals.before(own, moved=1)
        return out


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
        alike: Number of a group for each channel, whose noise is of similar size; none for no groups.
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
    """How far a piece is from what was measured, and how its trajectory bends.

    Streams are the coordinates, their first and second derivatives, and the channels: s = 3 n + C.

    Attributes:
        cost: What is minimised, but for the prior of θ.
        squares: Sums of squares of every stream's innovations and of their halves, as `Sums` has them (3, s).
        number: What these would be on average were the noise not fitted (3, s).
        bends: `∫ x⃛² dt` of each coordinate (n,).
        rank: Of each coordinate's penalty (n,).
    """

    cost: float
    squares: np.ndarray
    number: np.ndarray
    bends: np.ndarray
    rank: np.ndarray


class Linearised(NamedTuple):
    """A piece, its trajectory eliminated.

    With H the whole curvature and H_m a stream's part of it, `tr(H⁻¹ H_m)` of its samples are taken by the fit.

    Attributes:
        cost: What is minimised there, as of a `Misfit`.
        schur: Precision of θ (p, p).
        gradient: Right side (p,).
        step: Step of the coefficients at fixed θ (size n,).
        by_theta: How it changes with a step of θ, `step - by_theta @ δθ` (size n, p).
        taken: These shares of innovations and of their halves, for halves zero where ρ is (3, s).
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
        self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray, columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted channels (C, M), and their derivatives by the states (C, 3, n, M) and by entries of θ (C, k, M)."""


def misfit(
    measurement: Predictor, piece: Piece, coefficients: np.ndarray, *, theta: np.ndarray, noise: Noise
) -> Misfit:
    """How far a trajectory and θ are from what was measured.

    Args:
        measurement: Channels and parameters.
        piece: What was measured.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
    """
    states = _states(measurement, piece, coefficients, theta, noise)
    channels = []
    for own, when in clocks(measurement, piece, theta):
        local = piece.spline.local(when)
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
    """The normal equations of a piece at a trajectory and at θ, the trajectory eliminated.

    Args:
        measurement: Channels and parameters.
        piece: What was measured.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
        columns: Entries of θ that are not held, ascending (k,); by default all are free. What is said of θ is of these.
        root: A root of their covariance (k, q), which follows from all pieces; by default they take no samples.

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
        when: When they were what their samples say, s (M,).
        rows: The rows.
        new: What is new in them.
        by_states: Their derivatives by coordinates and their derivatives (c, 3, n, M).
        by_theta: Their derivatives by θ (c, k, M).
    """

    channels: slice
    when: np.ndarray
    rows: ChannelRows
    new: Innovations
    by_states: np.ndarray
    by_theta: np.ndarray


class NormalEquations(NamedTuple):
    """A piece's normal equations and the rows that they are made of.

    Attributes:
        eliminated: The equations, the trajectory eliminated.
        channels: The channels, those that share a clock together.
        state_rows: Rows of what is measured of the coordinates, by the derivative's order.
        states: What is new in these.
    """

    eliminated: Eliminated
    channels: list[ChannelEquations]
    state_rows: dict[int, StateRows]
    states: dict[int, Innovations]

    @property
    def innovations(self) -> list[Innovations]:
        """What is new in all streams."""
        return [*self.states.values(), *(each.new for each in self.channels)]


def normal_equations(
    measurement: Predictor,
    piece: Piece,
    coefficients: np.ndarray,
    theta: np.ndarray,
    noise: Noise,
    columns: np.ndarray,
) -> NormalEquations:
    """The normal equations of a piece at a trajectory and at θ, for the entries of θ that are not held.

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
    """What is minimised of a piece, by what is new in all its streams and by how its trajectory bends (n,)."""
    return sum(new.cost for new in every) + float(noise.jerk @ bends)


def channel_times(measurement: Predictor, piece: Piece, theta: np.ndarray) -> np.ndarray:
    """When the channels were what their samples say: delays and the clock's rate taken out, s (M,)."""
    when = piece.when
    for at in measurement.of_kind("clock").values():
        when = when + theta[at] * (piece.when - piece.origin)
    for at in measurement.of_kind("delay").values():
        when = when - theta[at]
    return when


def clocks(
    measurement: Predictor, piece: Piece, theta: np.ndarray, columns: Collection[int] = ()
) -> list[tuple[slice, np.ndarray]]:
    """Channels that share a clock, and when they were what their samples say, s (M,).

    Args:
        measurement: Channels and parameters.
        piece: What was measured.
        theta: Parameters (p,).
        columns: Entries of θ by which channels are differentiated.
    """
    of_clock = [*measurement.of_kind("clock").values(), *measurement.of_kind("delay").values()]
    number = piece.measured.shape[1]
    whole = piece.late is None or piece.late >= number
    if whole or not any(theta[at] or at in columns for at in of_clock):
        return [(slice(0, number), channel_times(measurement, piece, theta))]
    return [(slice(0, piece.late), channel_times(measurement, piece, theta)), (slice(piece.late, number), piece.when)]


def predicted(
    measurement: Predictor, piece: Piece, motion: Callable[[np.ndarray], np.ndarray], theta: np.ndarray
) -> np.ndarray:
    """Predicted channels of a piece at a motion (M, C).

    Args:
        measurement: Channels and parameters.
        piece: What was measured.
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
    """What is new in some of the predicted channels (C, M); a delay may put samples beyond the trajectory."""
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
    """Rows of channels that share a clock, which see all coordinates and all of θ that is not held, and what is new."""
    for k, (own, when) in enumerate(clocks(measurement, piece, theta, columns.tolist())):
        local = piece.spline.local(when)
        x = local.combined(coefficients)
        values, by_states, by_theta = measurement.derivatives(x[:3], piece.wrenches, theta, columns)
        by_states, by_theta = by_states.transpose(3, 0, 1, 2)[:, own], by_theta.transpose(2, 0, 1)[:, own]
        if k == 0:
            rate = np.einsum("mcdj,dmj->mc", by_states, x[1:])
            for at in measurement.of_kind("clock").values():
                by_theta[..., columns == at] = (rate * (piece.when - piece.origin)[:, None])[..., None]
            for at in measurement.of_kind("delay").values():
                by_theta[..., columns == at] = -rate[..., None]
        intervals = Intervals(local.interval, piece.spline.intervals)
        new = _channels(piece, own, when, local, values, noise)
        rows = ChannelRows(
            intervals,
            basis=intervals.dealt(local.basis[:3].transpose(1, 2, 0)),
            by_states=intervals.dealt(by_states),
            by_theta=intervals.dealt(by_theta),
            factors=Factors.of(new, intervals),
        )
        by = by_states.transpose(1, 2, 3, 0), by_theta.transpose(1, 2, 0)
        yield ChannelEquations(own, when, rows, new, *by)


def _states(
    measurement: Predictor, piece: Piece, coefficients: np.ndarray, theta: np.ndarray, noise: Noise
) -> dict[int, Innovations]:
    """What is new in what is measured of the coordinates, by the order of the derivative."""
    local = piece.local
    predicted = local.combined(coefficients)
    for j, at in measurement.zeros.items():
        predicted[0, :, j] += theta[at]
    return {
        kind: innovations(measured - predicted[kind], local.interval, noise.states[kind], noise.states_rho[kind])
        for kind, measured in enumerate(piece.states)
        if measured is not None
    }


def _state_rows(measurement: Predictor, piece: Piece, new: Innovations, kind: int, columns: np.ndarray) -> StateRows:
    """Rows of the coordinates or of a derivative, which see one coordinate each, and its zero unless that is held."""
    zeros = {j: int(np.searchsorted(columns, at)) for j, at in measurement.zeros.items() if kind == 0 and at in columns}
    return StateRows(piece.intervals, piece.windows[kind], zeros, Factors.of(new, piece.intervals))
