"""A recording as the joint estimate sees it, set-up corrected and motion smoothed, and the estimate as a fit to it."""

from dataclasses import replace

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.joint_estimate import Joint
from ident.estimation.least_squares import Fit
from ident.estimation.measurement import Measurement
from ident.estimation.piece import Piece, channel_times
from ident.estimation.preparation import Prepared
from ident.estimation.samples import Samples
from ident.estimation.smoothing_start import smoothed
from ident.estimation.spline import Spline
from ident.estimation.trajectory_pieces import cut
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import joined
from ident.recordings.wrench import GROUND


def corrected(prepared: Prepared, estimate: Joint, which: int | None, part: slice | None = None) -> Prepared:
    """A recording with the set-up as it was found, its motion smoothed.

    Args:
        prepared: The recording that was fitted, or another one.
        estimate: The joint estimate.
        which: Its number among those that were fitted, or None.
        part: The part of it that was fitted, where the wrenches have had a say in the motion.
    """
    measurement, theta = estimate.measurement, estimate.parameters_of(which or 0)
    places = _places(prepared, estimate, which, part)
    states = [spline.evaluate(c, channel_times(measurement, piece, theta))[:3] for piece, spline, c in places]
    motion = joined([measurement.motion(x) for x in states])
    channels = [piece_channels(measurement, piece, x, theta) for (piece, *_), x in zip(places, states, strict=True)]
    measured = np.concatenate(channels) + estimate.offsets_beside_first(which or 0)
    if measurement.frame is None and motion.base is not None and measurement.components:
        # Without a ground the channels are in the world's axes; those of equations are in the base's.
        in_base = measured[:, :6].reshape(-1, 2, 3) @ motion.base.T[:, :3, :3]
        measured = np.hstack([in_base.reshape(-1, 6), measured[:, 6:]])
    samples = Samples(motion, measured)
    equations = _equations(measurement, theta, prepared.mechanism)
    frame = prepared.frame @ measurement.displacement(GROUND, theta).astype(float)
    return replace(
        prepared, mechanism=equations.mechanism, equations=equations, samples=samples, frame=frame, cutoff=None
    )


def _places(
    prepared: Prepared, estimate: Joint, which: int | None, part: slice | None
) -> list[tuple[Piece, Spline, np.ndarray]]:
    """Pieces of a recording at its common times, and the trajectories of its streams that run through them."""
    measurement, whole = estimate.measurement, slice(0, len(prepared.samples))
    parts = [whole] if part is None else [slice(0, part.start), slice(part.stop, whole.stop)]
    asked = [(own, 1) for own in parts if own.stop - own.start > 1]

    def pieces_of(recording: Prepared) -> list[Piece]:
        return [p for own, least in asked for p in cut(recording, measurement, own, estimate.step, least=least)]

    pieces = pieces_of(prepared)
    smooth = smoothed(pieces, estimate.fit.noise).coefficients if pieces else []
    trajectories = [(piece.spline, c) for piece, c in zip(pieces, smooth, strict=True)]
    if which is not None and part is not None:
        asked.append((part, estimate.counts[which]))
        trajectories += [(piece.spline, c) for piece, c in estimate.places_of(which)]
    common = pieces_of(replace(prepared, recording=prepared.recording.without_streams))
    places = [(piece, *trajectory) for piece, trajectory in zip(common, trajectories, strict=True)]
    return sorted(places, key=lambda place: place[0].time[0])


def _equations(measurement: Measurement, theta: np.ndarray, mechanism: Mechanism) -> Equations:
    """The equations with the set-up that was found."""
    gravity, tree = measurement.gravity(theta).astype(float), measurement.tilted(theta)
    rows = _rows(measurement, theta) if measurement.components else None
    return replace(measurement.equations, mechanism=replace(mechanism, gravity=gravity, tree=tree), wrench=rows)


def _rows(measurement: Measurement, theta: np.ndarray) -> np.ndarray:
    """What the channels of the wrench read of Γ in the base frame (k, 6)."""
    frame = np.eye(4) if measurement.frame is None else measurement.frame @ measurement.displacement(GROUND, theta)
    gains = np.array(measurement.gains(theta)[: len(measurement.components)], float)
    return gains[:, None] * coAd(inverse(frame.astype(float)))[list(measurement.components)]


def piece_channels(measurement: Measurement, piece: Piece, states: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Channels less what contacts add to them, torques without their gain, which those of a wrench keep (N, C)."""
    measured = piece.measured
    if measurement.contacts:
        without = measurement.values(states, np.zeros_like(piece.wrenches), theta)
        measured = measured + (without - measurement.values(states, piece.wrenches, theta)).T
    gains = np.array(measurement.gains(theta), float)
    gains[: len(measurement.components)] = 1
    offsets = measurement.constants(theta)
    return (measured - offsets) / gains + offsets


def as_fit(estimate: Joint, samples: Samples, equations: Equations, widening: float = 1.0) -> Fit:
    """The joint estimate's parameters as a fit of linear equations at its own trajectory.

    Args:
        estimate: The joint estimate.
        samples: Corrected samples.
        equations: Corrected equations.
        widening: What standard deviations are multiplied by.
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
        method=f"joint estimate of trajectory, parameters and noise, {fit.status} after {len(fit.trace)} rounds",
        noise="on wrenches, torques and joint coordinates, correlated over time or not",
    )
    return replace(out, residual_norms=np.linalg.norm(out.residual(samples), axis=0))


def _root_of_inverse(covariance: np.ndarray) -> np.ndarray:
    """R with `Rᵀ R = covariance⁻¹`; what is known for certain is so to rounding."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30 * np.diag(covariance).max()))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return vectors.T / np.sqrt(np.maximum(values, 1e-15 * values[-1]))[:, None] / scale
