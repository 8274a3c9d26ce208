"""Piece of a recording in the trajectory estimate: samples, trajectory, and their linearised equations."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from ident.estimation.measurement import Measurement
from ident.setup import Shift
from ident.trajectory.algebra.rows import NODES, TURNED, WORTH_IT, Nodes
from ident.trajectory.algebra.spline import Sampling, Spline


@dataclass(frozen=True, eq=False)
class Piece:
    """Samples of a recording with one trajectory.

    Attributes:
        spline: Spline space of the trajectory.
        time: Sample times of the coordinates, s (N,).
        states: Measured coordinates, NaN where a sample is missing (N, n).
        when: Sample times of the channels, s (M,).
        measured: Measured channels, NaN where a sample is missing (M, C).
        wrenches: Wrenches of the surroundings on the contacts at these times, averages and the rest; and measured
            orientations of tracked bodies, in halves (M, 2, 6 k).
        origin: Time zero of the channels' clock, s.
        late: Number of channels on that clock, the first ones, those of a wrench or of commands; by default all. Others
            are on the coordinates' clock.
        slack: Standard deviation of the channels' error in addition to noise (M, C), None for none.
        held: Time by which the channels act later than they are stamped, in addition to estimated shifts, s: half a
            sample of commands that are held.
        echo: What the measured coordinates make of commands, `kp q`, zero for other channels (M, C); None for none.
        log: Index of the recording, whose pieces share their noise.
        alone: Motions smoothed from the coordinates alone, by time constant, as far as they were needed; copies of the
            piece share them.
    """

    spline: Spline
    time: np.ndarray
    states: np.ndarray
    when: np.ndarray
    measured: np.ndarray
    wrenches: np.ndarray
    origin: float = 0.0
    late: int | None = None
    slack: np.ndarray | None = None
    held: float = 0.0
    echo: np.ndarray | None = None
    log: int = 0
    alone: dict[float, Any] = field(default_factory=dict)

    @property
    def signal(self) -> np.ndarray:
        """Measured channels, commands as the torques that they make without damping (M, C)."""
        return self.measured if self.echo is None else self.measured - self.echo

    @cached_property
    def at_coordinates(self) -> Sampling:
        """Basis functions at the sample times of the coordinates, used in every round."""
        return Sampling(self.spline, self.time)

    @property
    def acting(self) -> np.ndarray:
        """True times of the channels' samples without estimated shifts, s (M,)."""
        return self.when + self.held if self.held else self.when

    @cached_property
    def _as_stated(self) -> Sampling:
        return Sampling(self.spline, self.acting)

    def at_channels(self, when: np.ndarray) -> Sampling:
        """Basis functions at true times of the channels' samples, computed once if these are as stated."""
        return self._as_stated if np.array_equal(when, self.acting) else Sampling(self.spline, when)

    def nodes(self, when: np.ndarray, turning: np.ndarray) -> Nodes | None:
        """Nodes for channels; None with slack, with few samples, or where a body turns far within an interval.

        Args:
            when: True times of the channels' samples, s (M,).
            turning: Masks of the coordinates that turn each body (b, n).
        """
        if self.slack is not None or len(when) < WORTH_IT * NODES * self.spline.intervals:
            return None
        if (self.moved @ turning.T).max(initial=0) > TURNED:
            return None
        return self._nodes_as_stated if np.array_equal(when, self.acting) else Nodes(Sampling(self.spline, when))

    @cached_property
    def moved(self) -> np.ndarray:
        """Sizes of the changes of the measured coordinates over every interval, zero without samples (S, n)."""
        knots = self.spline.start + self.spline.step * np.arange(self.spline.intervals + 1)
        out = np.zeros((self.spline.intervals, self.states.shape[1]))
        for x, own in zip(self.states.T, out.T, strict=True):
            if (there := np.isfinite(x)).any():
                own[:] = np.abs(np.diff(np.interp(knots, self.time[there], x[there])))
        return out

    @cached_property
    def _nodes_as_stated(self) -> Nodes:
        return Nodes(self._as_stated)

    @cached_property
    def windows(self) -> tuple[np.ndarray, np.ndarray]:
        """Windows for `StateRows` of the measured coordinates."""
        at = self.at_coordinates
        own = np.pad(at.intervals.dealt(at.local.basis[0]), ((0, 0), (0, 0), (1, 0)))
        return own, at.intervals.before(own, moved=1)


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of all streams of a recording, and of the jerk.

    Attributes:
        states: Standard deviations of the coordinates (n,).
        channels: Standard deviations of the channels (C,).
        jerk: λ of each coordinate, the inverse of the variance of its white jerk (n,).
        states_rho: ρ of the coordinates (n,).
        channels_rho: ρ of the channels (C,).
        floor_states: Smallest standard deviations (n,); `floor_channels` of the channels (C,).
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


class Point(NamedTuple):
    """Trajectory, parameters and noise of a piece.

    Attributes:
        piece: Measured samples.
        coefficients: Spline coefficients (size, n).
        theta: Parameters of its recording (p,).
        noise: Standard deviations, correlation and smoothness.
    """

    piece: Piece
    coefficients: np.ndarray
    theta: np.ndarray
    noise: Noise


def channel_times(measurement: Measurement, piece: Piece, theta: np.ndarray) -> np.ndarray:
    """True times of the channels' samples, corrected for delays and the clock's rate, s (M,)."""
    when, elapsed = piece.acting, piece.when - piece.origin
    for at, shift in measurement.shifts.items():
        when = when + theta[at] * shift(elapsed)
    return when


class ChannelClock(NamedTuple):
    """Channels that share a clock.

    Attributes:
        channels: The channels.
        when: True times of their samples, s (M,).
        shifts: Shifts of these times by their index in θ, of those that are not zero or are differentiated by.
    """

    channels: slice
    when: np.ndarray
    shifts: Mapping[int, Shift]


def clocks(
    measurement: Measurement, piece: Piece, theta: np.ndarray, columns: Collection[int] = ()
) -> list[ChannelClock]:
    """Clocks of all channels, as few as possible: of a wrench or of commands, of other torques, of poses; perhaps none.

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        theta: Parameters (p,).
        columns: Entries of θ by which channels are differentiated.
    """
    number = piece.measured.shape[1]
    if not number:
        return []
    torques = min(len(measurement.equations.channels), number)
    late = torques if piece.late is None else min(piece.late, torques)
    out, elapsed = list[ChannelClock](), piece.when - piece.origin
    for end, when, shifts in (
        (late, piece.acting, measurement.shifts),
        (torques, piece.when, measurement.torque_shifts),
        (number, piece.when, measurement.pose_shifts),
    ):
        first = out[-1].channels.stop if out else 0
        acting = {at: shift for at, shift in shifts.items() if theta[at] or at in columns}
        for at, shift in acting.items():
            when = when + theta[at] * shift(elapsed)
        if out and not acting and when is out[-1].when:
            out[-1] = out[-1]._replace(channels=slice(out[-1].channels.start, end))
        elif end > first:
            out.append(ChannelClock(slice(first, end), when, acting))
    return out


def predicted(
    measurement: Measurement,
    piece: Piece,
    motion: Callable[[np.ndarray], np.ndarray],
    theta: np.ndarray,
    *,
    of_contacts: bool = False,
) -> np.ndarray:
    """Predicted channels of a piece at a motion (M, C).

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        motion: Coordinates and at least their first two derivatives as a function of time (3, M, n).
        theta: Parameters (p,).
        of_contacts: True for the contribution of the contacts alone.
    """
    values = measurement.of_contacts if of_contacts else measurement.values
    parts = [
        values(motion(each.when)[:3], piece.wrenches, theta)[each.channels]
        for each in clocks(measurement, piece, theta)
    ]
    return np.concatenate(parts).T


def residual(measurement: Measurement, at: Point) -> np.ndarray:
    """Measured less predicted channels of a piece (M, C)."""
    piece, coefficients, theta, _ = at
    return piece.measured - predicted(measurement, piece, partial(piece.spline.evaluate, coefficients), theta)


def residual_of_coordinates(measurement: Measurement, at: Point) -> np.ndarray:
    """Measured less predicted coordinates of a piece, their zeros included (N, n)."""
    piece, coefficients, theta, _ = at
    predicted = piece.at_coordinates.local.combined(coefficients)[0]
    for j, zero in measurement.zeros.items():
        predicted[:, j] += theta[zero]
    return piece.states - predicted
