"""Misfit of a piece, and its equations linearised in spline coefficients and parameters."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ident.trajectory.algebra.arrow import Arrow, Eliminated, Posterior
from ident.trajectory.algebra.nodes import NODES, NodeRows, Nodes
from ident.trajectory.algebra.rows import ChannelRows, Factors, StateRows
from ident.trajectory.algebra.spline import ORDER, Local
from ident.trajectory.algebra.whitening import Innovations, Sums, innovations
from ident.trajectory.fit.piece import Noise, Piece, Predictor, clocks


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
        if (nodes := _nodes(measurement, piece, when, noise)) is None:
            predicted = measurement.values(local.combined(coefficients)[:3], piece.wrenches, theta)
        else:
            x = nodes.local.combined(coefficients)
            predicted = nodes.interpolated(measurement.values(x[:3], no_wrenches(x), theta).T).T
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
        when: True times of their samples, s (N,).
        nodes: Nodes at which they are evaluated, None for the samples.
        rows: The rows.
        new: Their innovations.
        by_states: Their derivatives by coordinates and the coordinates' derivatives, there (c, 3, n, M).
        by_theta: Their derivatives by θ (c, k, M).
    """

    channels: slice
    when: np.ndarray
    nodes: Nodes | None
    rows: ChannelRows | NodeRows
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
        nodes = _nodes(measurement, piece, when, noise)
        x = (at if nodes is None else nodes).local.combined(coefficients)
        wrenches = piece.wrenches if nodes is None else no_wrenches(x)
        values, by_states, by_theta = measurement.derivatives(x[:3], wrenches, theta, columns)
        by_states, by_theta = by_states.transpose(3, 0, 1, 2)[:, own], by_theta.transpose(2, 0, 1)[:, own]
        if k == 0:
            rate = np.einsum("mcdj,dmj->mc", by_states, x[1:])
            elapsed = piece.when - piece.origin
            elapsed = elapsed if nodes is None else _along(nodes.time, when, elapsed)
            for entry, shift in measurement.shifts.items():
                by_theta[..., columns == entry] = (rate * shift(elapsed)[:, None])[..., None]
        if nodes is not None:
            values = nodes.interpolated(values.T).T
        new = _channels(piece, own, when, at.local, values, noise)
        factors = Factors.of(new, at.intervals)
        rows: ChannelRows | NodeRows
        if nodes is None:
            dealt = at.intervals.dealt
            rows = ChannelRows(at.intervals, at.dealt, dealt(by_states), dealt(by_theta), factors)
        else:
            by_node = [x.reshape(-1, NODES, *x.shape[1:]) for x in (by_states, by_theta)]
            rows = NodeRows(nodes, by_node[0], by_node[1], factors)
        by = by_states.transpose(1, 2, 3, 0), by_theta.transpose(1, 2, 0)
        yield ChannelEquations(own, when, nodes, rows, new, *by)


def _nodes(measurement: Predictor, piece: Piece, when: np.ndarray, noise: Noise) -> Nodes | None:
    """Nodes at which to evaluate channels; None for every sample, as correlated noise links those of two intervals."""
    return piece.nodes(when) if measurement.smooth and not noise.channels_rho.any() else None


def no_wrenches(states: np.ndarray) -> np.ndarray:
    """Wrenches of no contact at some states (…, N, n): (N, 2, 0)."""
    return np.zeros((states.shape[1], 2, 0))


def _along(time: np.ndarray, true: np.ndarray, elapsed: np.ndarray) -> np.ndarray:
    """Time of the channels' clock at some true times, by a straight line through its ends (N,)."""
    slope = (elapsed[-1] - elapsed[0]) / (true[-1] - true[0])
    return np.asarray(elapsed[0] + slope * (time - true[0]))


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
