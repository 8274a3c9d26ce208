"""Recording with set-up corrected and motion smoothed by the trajectory estimate, and the estimate as a fit to it."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import Prepared
from ident.estimation.samples import Samples
from ident.geometry.se3 import coAd, inverse
from ident.recordings.wrench import GROUND
from ident.regression.ordinary import Fit
from ident.trajectory.angles_alone import Trajectory, smoothed
from ident.trajectory.cut_pieces import LONGEST, coordinates, cut
from ident.trajectory.fit.piece import Piece, clocks
from ident.trajectory.result import TrajectoryEstimate


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A recording at its common times, with a motion smoothed from its angles alone for each time constant.

    Attributes:
        prepared: The recording that was fitted, or another one.
        measurement: Its channels.
        which: Index of the recording among those that were fitted, or None.
    """

    prepared: Prepared
    measurement: Measurement
    which: int | None

    def samples(
        self,
        estimate: TrajectoryEstimate,
        T: float,
        chosen: slice | np.ndarray,
        part: slice | None = None,
        *,
        left_out: bool = False,
    ) -> Samples:
        """Samples with the set-up of an estimate.

        Args:
            estimate: The estimate, or its parameters with the set-up as stated.
            T: Time constant with which angles alone are smoothed, s.
            chosen: The samples.
            part: Part of the recording that was fitted, to be given its estimated motion; then all are chosen.
            left_out: True to take its offsets and friction from the other recordings.
        """
        measurement, theta = self.measurement, estimate.parameters_of(self.which, left_out=left_out)
        whole, when = self._on_one_clock(theta)
        piece = replace(whole, measured=whole.measured[chosen], wrenches=whole.wrenches[chosen])
        states = self._motion(T).evaluate(when[chosen])[:3]
        for j, at in measurement.zeros.items():
            states[0, :, j] -= theta[at]
        if part is not None:
            points = [point for point in estimate.fit.points if point.piece.log == (self.which or 0)]
            borders = np.linspace(part.start, part.stop, len(points) + 1).round().astype(int).tolist()
            for (a, b), point in zip(pairwise(borders), points, strict=True):
                states[:, a:b] = point.piece.spline.evaluate(point.coefficients, when[a:b])[:3]
        motion = measurement.motion(states)
        measured = piece_channels(measurement, piece, states, theta)
        if measurement.in_world_axes and motion.base is not None:
            # Channels of `Equations` are in the base's axes.
            in_base = measured[:, :6].reshape(-1, 2, 3) @ motion.base.T[:, :3, :3]
            measured = np.hstack([in_base.reshape(-1, 6), measured[:, 6:]])
        # A recording's own offsets and friction are replaced by those of the first.
        if (own := (estimate.parameters_of(0) - theta)[: len(measurement.equations.names)]).any():
            equations, nothing = self.equations(estimate), Samples(motion, np.zeros_like(measured))
            measured -= equations.residual(equations.checked(nothing), own)
        return Samples(motion, measured)

    def equations(self, estimate: TrajectoryEstimate) -> Equations:
        """Equations with the set-up of an estimate."""
        measurement, theta = self.measurement, estimate.parameters_of(self.which)
        gravity, tree = measurement.gravity(theta).astype(float), measurement.corrected_tree(theta)
        mechanism = replace(self.prepared.mechanism, gravity=gravity, tree=tree)
        rows = _rows(measurement, theta) if measurement.components else None
        own, changed = measurement.equations, theta[len(measurement.equations.names) :].any()
        return replace(own, mechanism=mechanism, wrench=rows, beside=measurement.beside(theta) if changed else None)

    def corrected(self, estimate: TrajectoryEstimate, T: float, part: slice) -> Prepared:
        """Recording with the set-up and the motion of an estimate, smoothed from angles alone where it was not fitted.

        Args:
            estimate: The estimate.
            T: Time constant of smoothing, s.
            part: Part that was fitted.
        """
        equations, samples = self.equations(estimate), self.samples(estimate, T, slice(None), part)
        moved = self.measurement.displacement(GROUND, estimate.parameters_of(self.which)).astype(float)
        other = replace(self.prepared, equations=equations, samples=samples, cutoff=None)
        return replace(other, mechanism=equations.mechanism, frame=other.frame @ moved)

    def _motion(self, T: float) -> Trajectory:
        """Coordinates smoothed with a time constant, computed once."""
        if T not in self._motions:
            prepared = self.prepared
            self._motions[T] = smoothed(coordinates(prepared.recording, prepared.mechanism.joints), T)
        return self._motions[T]

    @cached_property
    def _motions(self) -> dict[float, Trajectory]:
        return {}

    @cached_property
    def _whole(self) -> Piece:
        """All samples as one piece."""
        common = replace(self.prepared, recording=self.prepared.recording.without_streams)
        pieces = cut(common, self.measurement, slice(0, len(self.prepared.samples)), LONGEST, least=1)
        when, measured, wrenches = (
            np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("when", "measured", "wrenches")
        )
        measured = measured[:, : len(self.measurement.equations.channels)]
        return replace(pieces[0], when=when, measured=measured, wrenches=wrenches)

    def _on_one_clock(self, theta: np.ndarray) -> tuple[Piece, np.ndarray]:
        """All samples, and the times of the motion that they belong to: the channels', or those of torques if measured.

        A delayed wrench beside torques is interpolated at these times.
        """
        piece = self._whole
        every = clocks(self.measurement, piece, theta)
        (own, late, _), (_, when, _) = every[0], every[-1]
        if len(every) > 1:
            channels = piece.measured.copy()
            channels[:, own] = np.stack([np.interp(when, late, column) for column in channels[:, own].T], axis=1)
            piece = replace(piece, measured=channels)
        return piece, when


def _rows(measurement: Measurement, theta: np.ndarray) -> np.ndarray:
    """Rows that map Γ in the base frame to the channels of the wrench (k, 6)."""
    frame = np.eye(4) if measurement.frame is None else measurement.frame @ measurement.displacement(GROUND, theta)
    gains = np.array(measurement.gains(theta)[: len(measurement.components)], float)
    return gains[:, None] * coAd(inverse(frame.astype(float)))[list(measurement.components)]


def piece_channels(measurement: Measurement, piece: Piece, states: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Channels without the contribution of contacts, torques without their gain; wrenches keep theirs (N, C).

    Commands become the torques that they make; poses are left out.
    """
    own = len(measurement.equations.channels)
    measured = piece.measured[:, :own]
    if measurement.contacts:
        measured = measured - measurement.of_contacts(states, piece.wrenches, theta)[:own].T
    if (servos := measurement.equations.servos) is not None:
        motion, which = measurement.motion(states), list(measurement.equations.torques)
        lengths = measurement.encoders(motion.q, theta)[:, which]
        measured = measured.copy()
        measured[:, -len(which) :] -= servos[0] * lengths + servos[1] * motion.dq[:, which]
    offsets = measurement.constants(theta)
    return (measured - offsets) / measurement.torque_gains(theta) + offsets


def as_fit(estimate: TrajectoryEstimate, samples: Samples, equations: Equations, widening: np.ndarray) -> Fit:
    """Trajectory estimate's parameters as a fit of linear equations at its own trajectory.

    Args:
        estimate: The trajectory estimate.
        samples: Corrected samples.
        equations: Corrected equations.
        widening: Factors on the standard deviations of the columns (m,).
    """
    m, fit = len(equations.names), estimate.fit
    covariance = np.outer(widening, widening) * fit.covariance[:m, :m]
    out = Fit(
        equations=equations,
        values=fit.theta[:m],
        covariance=covariance,
        weighted=True,
        root=_root_of_inverse(covariance),
        rows=samples.measured.size,
        samples=len(samples),
        residual_norms=np.zeros(samples.measured.shape[1]),
    )
    return replace(out, residual_norms=np.linalg.norm(out.residual(samples), axis=0))


def _root_of_inverse(covariance: np.ndarray) -> np.ndarray:
    """R with `Rᵀ R = covariance⁻¹`; zero variances are raised to rounding."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30 * np.diag(covariance).max()))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return vectors.T / np.sqrt(np.maximum(values, 1e-15 * values[-1]))[:, None] / scale
