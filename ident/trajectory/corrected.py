"""Recording with set-up corrected and motion smoothed by the trajectory estimate, and the estimate as a fit to it."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import Prepared
from ident.estimation.samples import Samples
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import joined
from ident.recordings.wrench import GROUND
from ident.regression.ordinary import Fit
from ident.trajectory.angles_alone import smoothed
from ident.trajectory.fit.piece import Piece, clocks
from ident.trajectory.from_angles import without_zeros
from ident.trajectory.pieces import coordinates, cut
from ident.trajectory.result import TrajectoryEstimate

Place = tuple[Piece, Callable[[np.ndarray], np.ndarray]]
"""A piece and its trajectory as a function of time."""


def corrected(
    prepared: Prepared, estimate: TrajectoryEstimate, which: int | None, smoothing: float, part: slice | None = None
) -> Prepared:
    """Recording with the estimated set-up and its motion smoothed.

    Args:
        prepared: The recording that was fitted, or another one.
        estimate: The trajectory estimate.
        which: Index of the recording among those that were fitted, or None.
        smoothing: Time constant with which angles alone are smoothed, s, from `chosen_smoothing`.
        part: Part of the recording that was fitted, where the motion was estimated from the wrenches as well.
    """
    measurement, theta = estimate.measurement, estimate.parameters_of(which)
    places = _on_one_clock(measurement, _places(prepared, estimate, which, smoothing, part), theta)
    states = [trajectory(_times(measurement, piece, theta))[:3] for piece, trajectory in places]
    motion = joined([measurement.motion(x) for x in states])
    channels = [piece_channels(measurement, piece, x, theta) for (piece, _), x in zip(places, states, strict=True)]
    measured = np.concatenate(channels)
    if measurement.in_world_axes and motion.base is not None:
        # Channels of `Equations` are in the base's axes.
        in_base = measured[:, :6].reshape(-1, 2, 3) @ motion.base.T[:, :3, :3]
        measured = np.hstack([in_base.reshape(-1, 6), measured[:, 6:]])
    equations = _equations(measurement, theta, prepared.mechanism)
    # A recording's own offsets and friction are replaced by those of the first.
    if (own := (estimate.parameters_of(0) - theta)[: len(equations.names)]).any():
        columns = equations.rows(equations.checked(Samples(motion, np.zeros_like(measured))))
        measured += np.concatenate([np.tensordot(rows[:-1], own, (0, 0)).T for rows in columns])
    samples = Samples(motion, measured)
    frame = prepared.frame @ measurement.displacement(GROUND, theta).astype(float)
    return replace(
        prepared, mechanism=equations.mechanism, equations=equations, samples=samples, frame=frame, cutoff=None
    )


def _places(
    prepared: Prepared, estimate: TrajectoryEstimate, which: int | None, smoothing: float, part: slice | None
) -> list[Place]:
    """Pieces of a recording at its common times, each with its trajectory as a function of time."""
    measurement, common = estimate.measurement, replace(prepared, recording=prepared.recording.without_streams)
    theta, whole = estimate.parameters_of(which), slice(0, len(prepared.samples))

    def pieces_of(own: slice, least: int = 1) -> list[Piece]:
        step = estimate.steps[which or 0]
        return cut(common, measurement, own, step, least=least) if own.stop - own.start > 1 else []

    angles = without_zeros(coordinates(prepared.recording, prepared.mechanism.joints), measurement, theta)
    alone = smoothed(angles, smoothing).evaluate
    if which is None or part is None:
        return [(piece, alone) for piece in pieces_of(whole)]
    fitted = pieces_of(part, estimate.counts[which])
    splines = [partial(piece.spline.evaluate, c) for piece, c in estimate.places_of(which)]
    before, after = pieces_of(slice(0, part.start)), pieces_of(slice(part.stop, whole.stop))
    others = [(piece, alone) for piece in (*before, *after)]
    return sorted([*others, *zip(fitted, splines, strict=True)], key=lambda place: float(place[0].time[0]))


def _times(measurement: Measurement, piece: Piece, theta: np.ndarray) -> np.ndarray:
    """Times of the motion that the samples belong to: on the channels' common clock, or on that of the torques."""
    every = clocks(measurement, piece, theta)
    return every[-1][1]


def _on_one_clock(measurement: Measurement, places: list[Place], theta: np.ndarray) -> list[Place]:
    """Pieces with a delayed wrench interpolated at the times of the torques, if there are both."""
    every = [clocks(measurement, piece, theta) for piece, _ in places]
    if len(every[0]) == 1:
        return places
    late = np.concatenate([when for (_, when), _ in every])
    measured = np.concatenate([piece.measured for piece, _ in places])
    moved = []
    for (piece, trajectory), ((own, _), (_, when)) in zip(places, every, strict=True):
        channels = piece.measured.copy()
        channels[:, own] = np.stack([np.interp(when, late, column) for column in measured[:, own].T], axis=1)
        moved.append((replace(piece, measured=channels), trajectory))
    return moved


def _equations(measurement: Measurement, theta: np.ndarray, mechanism: Mechanism) -> Equations:
    """Equations with the estimated set-up."""
    gravity, tree = measurement.gravity(theta).astype(float), measurement.tilted(theta)
    rows = _rows(measurement, theta) if measurement.components else None
    return replace(measurement.equations, mechanism=replace(mechanism, gravity=gravity, tree=tree), wrench=rows)


def _rows(measurement: Measurement, theta: np.ndarray) -> np.ndarray:
    """Rows that map Γ in the base frame to the channels of the wrench (k, 6)."""
    frame = np.eye(4) if measurement.frame is None else measurement.frame @ measurement.displacement(GROUND, theta)
    gains = np.array(measurement.gains(theta)[: len(measurement.components)], float)
    return gains[:, None] * coAd(inverse(frame.astype(float)))[list(measurement.components)]


def piece_channels(measurement: Measurement, piece: Piece, states: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Channels without the contribution of contacts, torques without their gain; wrenches keep theirs (N, C).

    Commands become the torques that they make.
    """
    measured = piece.measured
    if measurement.contacts:
        without = measurement.values(states, np.zeros_like(piece.wrenches), theta)
        measured = measured + (without - measurement.values(states, piece.wrenches, theta)).T
    if (servos := measurement.equations.servos) is not None:
        motion, which = measurement.motion(states), list(measurement.equations.torques)
        lengths = measurement.encoders(motion.q, theta)[:, which]
        measured = measured.copy()
        measured[:, -len(which) :] -= servos[0] * lengths + servos[1] * motion.dq[:, which]
    gains = np.array(measurement.gains(theta), float)
    gains[: len(measurement.components)] = 1
    offsets = measurement.constants(theta)
    return (measured - offsets) / gains + offsets


def as_fit(estimate: TrajectoryEstimate, samples: Samples, equations: Equations, widening: float = 1.0) -> Fit:
    """Trajectory estimate's parameters as a fit of linear equations at its own trajectory.

    Args:
        estimate: The trajectory estimate.
        samples: Corrected samples.
        equations: Corrected equations.
        widening: Factor on the standard deviations.
    """
    m, fit = len(equations.names), estimate.fit
    covariance = widening**2 * fit.covariance[:m, :m]
    out = Fit(
        equations=equations,
        values=fit.theta[:m],
        covariance=covariance,
        weighted=True,
        root=_root_of_inverse(covariance),
        rows=samples.measured.size,
        samples=len(samples),
        residual_norms=np.zeros(samples.measured.shape[1]),
        method=f"trajectory estimate of trajectory, parameters and noise, {fit.status} after {len(fit.trace)} rounds",
        noise="on wrenches, torques and joint coordinates, correlated over time or not",
    )
    return replace(out, residual_norms=np.linalg.norm(out.residual(samples), axis=0))


def _root_of_inverse(covariance: np.ndarray) -> np.ndarray:
    """R with `Rᵀ R = covariance⁻¹`; zero variances are raised to rounding."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30 * np.diag(covariance).max()))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return vectors.T / np.sqrt(np.maximum(values, 1e-15 * values[-1]))[:, None] / scale
