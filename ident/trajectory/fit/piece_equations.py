"""Misfit of a piece, and its equations linearised in spline coefficients and parameters."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.recorded_motion import WIDTH
from ident.trajectory.algebra.arrow import Arrow, Eliminated, Group, Posterior, channel_groups, components, joined
from ident.trajectory.algebra.rows import NODES, ChannelRows, Factors, NodeRows, Nodes, StateRows
from ident.trajectory.algebra.spline import ORDER, Local, Sampling, Spline
from ident.trajectory.algebra.whitening import Innovations, innovations
from ident.trajectory.fit.piece import Noise, Piece, Point, clocks, residual_of_coordinates


class Misfit(NamedTuple):
    """Sums of squares of a piece's residuals, and roughness of its trajectory.

    Streams are the coordinates and the channels: s = n + C.

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
        eliminated: Normal equations of the free entries of θ, without factors.
        taken: Absorbed degrees of freedom of innovations and of their halves; zero for halves where ρ is zero (3, s).
        held: `tr(H⁻¹ λ_j P_j)` of the jerk's penalties (n,).
    """

    cost: float
    eliminated: Eliminated
    taken: np.ndarray
    held: np.ndarray


def misfit(measurement: Measurement, at: Point) -> Misfit:
    """Misfit of a trajectory and θ to the measured samples."""
    piece, coefficients, theta, noise = at
    states, channels = _states(measurement, at), []
    for own, when, _ in clocks(measurement, piece, theta):
        local = piece.at_channels(when).local
        if (nodes := _nodes(measurement, piece, when, noise)) is None:
            predicted = measurement.values(local.combined(coefficients)[:3], piece.wrenches, theta)
        else:
            x = nodes.sampling.local.combined(coefficients)
            predicted = nodes.interpolated(measurement.values(x[:3], no_wrenches(x), theta).T).T
        channels.append(_channels(piece, own, when, local, predicted, noise))
    bends = piece.spline.squared_jerk(coefficients)
    every = [states, *channels]
    squares, number = (np.concatenate(parts, axis=1) for parts in zip(*(new.sums for new in every), strict=True))
    rank = np.full(len(bends), float(piece.spline.size - ORDER))
    return Misfit(_cost(every, noise, bends), squares, number, bends, rank)


def linearised(
    measurement: Measurement, at: Point, *, columns: np.ndarray | None = None, root: np.ndarray | None = None
) -> Linearised:
    """Normal equations of a piece at a trajectory and at θ, the trajectory eliminated.

    Args:
        measurement: Channels and parameters.
        at: Point of linearisation.
        columns: Indices of the free entries of θ, ascending (k,), to which the results refer; by default all are free.
        root: Root of their covariance from all pieces (k, q); by default they absorb no degrees of freedom.

    Raises:
        numpy.linalg.LinAlgError: The trajectory is not determined.
    """
    columns = np.arange(len(at.theta)) if columns is None else columns
    root = np.zeros((len(columns), 0)) if root is None else root
    equations, spline = normal_equations(measurement, at, columns), at.piece.spline
    taken, held = equations.taken(root, spline)
    every = [equations.states, *(each.new for each in equations.channels)]
    cost = _cost(every, at.noise, spline.squared_jerk(at.coefficients))
    return Linearised(cost, equations.eliminated._replace(factors=()), taken, at.noise.jerk * held)


class ChannelEquations(NamedTuple):
    """Linearised channels that share a clock.

    Attributes:
        channels: The channels.
        at: Spline functions at the true times of their samples (N,).
        nodes: Nodes at which they are evaluated, None for the samples.
        new: Their innovations.
        by_sample: Their derivatives by coordinates and the coordinates' derivatives, there (M, c, 3, n), and by θ
            (M, c, k).
    """

    channels: slice
    at: Sampling
    nodes: Nodes | None
    new: Innovations
    by_sample: tuple[np.ndarray, np.ndarray]

    def rows(self, component: Group, of_states: np.ndarray, of_theta: np.ndarray) -> Iterator[ChannelRows | NodeRows]:
        """Yields the rows of the channels in a component, grouped by what they depend on.

        Args:
            component: The component.
            of_states: Mask of the coordinates on which each channel of all clocks depends (C, n).
            of_theta: Mask of the entries of θ on which it depends (C, k).
        """
        coordinates, columns, every = component
        first, number = int(self.channels.start), self.new.values.shape[1]
        own = every[(every >= first) & (every < first + number)]
        masks = of_states[own[:, None], coordinates], of_theta[own[:, None], columns]
        for group in channel_groups(*masks, self.at.intervals.room if self.nodes is None else NODES):
            channels = own[group.channels] - first
            by_states = _picked(self.by_sample[0], channels, coordinates[group.coordinates])
            by_theta = _picked(self.by_sample[1], channels, columns[group.columns])
            given = group._replace(channels=channels), by_states, by_theta, self.new.of_streams(channels)
            yield ChannelRows.of(self.at, *given) if self.nodes is None else NodeRows.of(self.nodes, *given)


class ComponentEquations(NamedTuple):
    """Normal equations of coordinates that no channel relates to the others.

    Attributes:
        component: The coordinates, and the entries of θ on which their streams depend.
        eliminated: The equations, the trajectory eliminated.
        channels: Rows of channels, with the position of their clock.
        states: Rows of measured coordinates.
    """

    component: Group
    eliminated: Eliminated
    channels: list[tuple[int, ChannelRows | NodeRows]]
    states: StateRows


class NormalEquations(NamedTuple):
    """Normal equations of a piece, and their rows.

    Attributes:
        eliminated: The equations, the trajectory eliminated.
        components: The equations of each component of the coordinates.
        channels: The channels, grouped by clock.
        states: Innovations of measured coordinates.
    """

    eliminated: Eliminated
    components: list[ComponentEquations]
    channels: list[ChannelEquations]
    states: Innovations

    def taken(self, root: np.ndarray, spline: Spline) -> tuple[np.ndarray, np.ndarray]:
        """Absorbed degrees of freedom of all streams (3, s), and `tr(H⁻¹ P_j)` of the jerk's penalties (n,).

        Args:
            root: Root of the covariance of θ (k, q).
            spline: Spline space of the trajectory.
        """
        n = sum(len(each.component.coordinates) for each in self.components)
        of_states, held = np.zeros((3, n)), np.zeros(n)
        of_channels = [np.zeros((3, each.new.values.shape[1])) for each in self.channels]
        for (coordinates, columns, _), eliminated, channels, states in self.components:
            posterior = Posterior.of(eliminated, root[columns], spline.intervals, len(coordinates))
            of_states[:, coordinates] = states.taken(posterior)
            for clock, rows in channels:
                of_channels[clock][:, rows.group.channels] = rows.taken(posterior)
            held[coordinates] = np.einsum("sjuv,uv->j", posterior.by_coordinate[:, :, 1:, 1:], spline.penalty)
        return np.concatenate([of_states, *of_channels], axis=1), held


def normal_equations(measurement: Measurement, at: Point, columns: np.ndarray) -> NormalEquations:
    """Normal equations of a piece at a trajectory and at θ, for the free entries of θ by their indices.

    Raises:
        numpy.linalg.LinAlgError: The trajectory is not determined.
    """
    piece, coefficients, theta, noise = at
    channels, states = list(_channel_equations(measurement, at, columns)), _states(measurement, at)
    of_states, of_theta = dependence(measurement, theta, columns)
    zeros = {j: int(np.searchsorted(columns, own)) for j, own in measurement.zeros.items() if own in columns}
    parts = []
    for component in components(of_states, of_theta, zeros, coefficients.shape[1]):
        coordinates, own, _ = component
        rows = [
            (clock, of_group)
            for clock, each in enumerate(channels)
            for of_group in each.rows(component, of_states, of_theta)
        ]
        state_rows = _state_rows(piece, states, component, zeros)
        every = [*(of_group for _, of_group in rows), state_rows]
        arrow = Arrow(piece.spline, len(coordinates), len(own), linked=not all(each.factors.white for each in every))
        for each in every:
            each.add_to(arrow)
        eliminated = arrow.eliminated(noise.jerk[coordinates], coefficients[:, coordinates])
        parts.append(ComponentEquations(component, eliminated, rows, state_rows))
    whole = joined([(*part.component[:2], part.eliminated) for part in parts], coefficients.shape[1], len(columns))
    return NormalEquations(whole, parts, channels, states)


def _picked(derivatives: np.ndarray, channels: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Derivatives (N, C, …, n) of some channels by some of the coordinates or parameters."""
    if len(channels) < derivatives.shape[1]:
        derivatives = derivatives[:, channels]
    return derivatives if len(last) == derivatives.shape[-1] else derivatives[..., last]


def dependence(measurement: Measurement, theta: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the coordinates (C, n), at least one, and of entries of θ (C, k) on which channels depend."""
    of_states, of_theta = measurement.dependence(theta, columns)
    of_states[~of_states.any(axis=1), :1] = True
    first_pose = len(of_theta) - WIDTH * len(measurement.tracked)
    moved = np.asarray(of_states.any(axis=1))
    of_channels = {**measurement.shifts, **measurement.torque_shifts}
    for own, shifts in ((slice(first_pose), of_channels), (slice(first_pose, None), measurement.pose_shifts)):
        of_theta[own, np.isin(columns, [*shifts])] |= moved[own, None]
    return of_states, of_theta


def _cost(every: Iterable[Innovations], noise: Noise, bends: np.ndarray) -> float:
    """Cost of a piece, from the innovations of all its streams and the `∫ x⃛² dt` of its trajectory (n,)."""
    return sum(new.cost for new in every) + float(noise.jerk @ bends)


def _channels(
    piece: Piece, own: slice, when: np.ndarray, local: Local, predicted: np.ndarray, noise: Noise
) -> Innovations:
    """Innovations of some channels, from predictions (C, M); a delay may put samples beyond the trajectory."""
    residual = np.where(piece.spline.holds(when)[:, None], (piece.measured - predicted.T)[:, own], np.nan)
    slack = None if piece.slack is None else piece.slack[:, own]
    return innovations(residual, local.interval, noise.channels[own], noise.channels_rho[own], slack)


def _channel_equations(measurement: Measurement, point: Point, columns: np.ndarray) -> Iterator[ChannelEquations]:
    """Yields the derivatives by coordinates and free θ, and innovations, of the channels on each clock."""
    piece, coefficients, theta, noise = point
    for own, when, shifts in clocks(measurement, piece, theta, columns.tolist()):
        at = piece.at_channels(when)
        nodes = _nodes(measurement, piece, when, noise)
        x = (at if nodes is None else nodes.sampling).local.combined(coefficients)
        wrenches = piece.wrenches if nodes is None else no_wrenches(x)
        values, by_states, by_theta = measurement.derivatives(x[:3], wrenches, theta, columns)
        by_states, by_theta = by_states.transpose(3, 0, 1, 2)[:, own], by_theta.transpose(2, 0, 1)[:, own]
        if shifts:
            rate = np.einsum("mcdj,dmj->mc", by_states, x[1:])
            elapsed = piece.when - piece.origin
            elapsed = elapsed if nodes is None else _along(nodes.time, when, elapsed)
            for entry, shift in shifts.items():
                by_theta[..., columns == entry] = (rate * shift(elapsed)[:, None])[..., None]
        if nodes is not None:
            values = nodes.interpolated(values.T).T
        new = _channels(piece, own, when, at.local, values, noise)
        yield ChannelEquations(own, at, nodes, new, (by_states, by_theta))


def _nodes(measurement: Measurement, piece: Piece, when: np.ndarray, noise: Noise) -> Nodes | None:
    """Nodes at which to evaluate channels; None for every sample, as correlated noise links those of two intervals."""
    smooth = measurement.smooth and not noise.channels_rho.any()
    return piece.nodes(when, measurement.turning) if smooth else None


def no_wrenches(states: np.ndarray) -> np.ndarray:
    """Wrenches of no contact at some states (…, N, n): (N, 2, 0)."""
    return np.zeros((states.shape[1], 2, 0))


def _along(time: np.ndarray, true: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
    """Time of the channels' clock at some true times, by a straight line through its ends (N,)."""
    slope = (elapsed[-1] - elapsed[0]) / (true[-1] - true[0])
    return np.asarray(elapsed[0] + slope * (time - true[0]))


def _states(measurement: Measurement, point: Point) -> Innovations:
    """Innovations of measured coordinates."""
    interval, noise = point.piece.at_coordinates.local.interval, point.noise
    return innovations(residual_of_coordinates(measurement, point), interval, noise.states, noise.states_rho)


def _state_rows(piece: Piece, new: Innovations, component: Group, zeros: Mapping[int, int]) -> StateRows:
    """Rows of the coordinates, which depend on one coordinate each and on its zero if that is free."""
    coordinates, columns, _ = component
    own = {j: zeros[at] for j, at in enumerate(coordinates.tolist()) if at in zeros}
    own = {j: int(np.searchsorted(columns, at)) for j, at in own.items()}
    intervals = piece.at_coordinates.intervals
    return StateRows(intervals, piece.windows, own, Factors.of(new.of_streams(coordinates), intervals))
