"""Measured channels compared with predictions from the motion smoothed from angles alone."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ident.estimation.channel_scales import LEAST, beside_others
from ident.estimation.measurement import Measurement
from ident.recordings.sampled import Sampled
from ident.trajectory.angles_alone import Trajectory, smoothed
from ident.trajectory.fit.piece import Piece, clocks

REWEIGHTED = 3
"""Number of least-squares fits, each with the channels weighted by the residuals of the one before."""

TINY = 1e-150
"""Least size of residuals and of columns, so that logarithms and scales of zeros are finite."""


class Compared(NamedTuple):
    """Samples of a piece that are compared.

    Attributes:
        residual: Measured less predicted channels (M, C).
        columns: Derivatives of channels by the columns' parameters (M, C, k).
    """

    residual: np.ndarray
    columns: np.ndarray


@dataclass(frozen=True, eq=False)
class FromAngles:
    """Piece with its motion smoothed from angles alone.

    Attributes:
        measurement: Channels and parameters.
        piece: Measured samples.
        share: Step k: every k-th sample is compared.
    """

    measurement: Measurement
    piece: Piece
    share: int
    _trajectories: dict[float, Trajectory] = field(default_factory=dict)

    def compared(self, T: float, theta: np.ndarray) -> Compared:
        """Residuals and columns of samples neither missing nor near the ends.

        Args:
            T: Time constant of smoothing, s.
            theta: Parameters (p,).
        """
        measurement, piece = self.measurement, self.piece
        trajectory, every = self._trajectory(T, theta), clocks(measurement, piece, theta)
        settled = np.all([trajectory.settled(when) for _, when in every], axis=0)
        taken = np.flatnonzero(np.isfinite(piece.measured).all(axis=1) & settled)[:: self.share]
        residual, by_theta = piece.measured[taken], list[np.ndarray]()
        chosen = np.arange(len(measurement.equations.names))
        if not len(taken):
            return Compared(residual, np.zeros((*residual.shape, len(chosen))))
        for own, when in every:
            states, wrenches = trajectory.evaluate(when[taken])[:3], piece.wrenches[taken]
            predicted, _, derivatives = measurement.derivatives(states, wrenches, theta, chosen)
            by_theta.append(derivatives[own])
            residual[:, own] -= predicted[own].T
        return Compared(residual, np.concatenate(by_theta).transpose(2, 0, 1))

    def _trajectory(self, T: float, theta: np.ndarray) -> Trajectory:
        """Smoothed motion less the zeros of the joints, cached by T because the zeros do not change."""
        if T not in self._trajectories:
            angles = Sampled(self.piece.time, self.piece.states[0])
            self._trajectories[T] = smoothed(without_zeros(angles, self.measurement, theta), T)
        return self._trajectories[T]


def without_zeros(coordinates: Sampled, measurement: Measurement, theta: np.ndarray) -> Sampled:
    """Measured coordinates less their estimated zeros."""
    values = coordinates.values.copy()
    for j, at in measurement.zeros.items():
        values[:, j] -= theta[at]
    return Sampled(coordinates.time, values)


def unexplained_anew(compared: Sequence[Compared], channels: Sequence[str]) -> float:
    """Mean logarithm of the channels' RMS residuals after the columns are fitted again, infinite without samples.

    Each channel is weighted by its residual.
    """
    A = np.concatenate([own.columns for own in compared])
    b = np.concatenate([own.residual for own in compared])
    rms, columns = _rms(b), A.transpose(1, 2, 0)
    least = LEAST * beside_others(rms, channels)
    normals, rights = columns @ A.swapaxes(0, 1), (columns @ b.T[:, :, None])[..., 0]
    for _ in range(REWEIGHTED if len(b) else 0):
        weights = np.maximum(rms, least) ** -2
        normal, right = np.tensordot(weights, normals, axes=1), weights @ rights
        scale = np.sqrt(np.maximum(np.diag(normal), TINY))
        step = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
        rms = _rms(b - A @ step)
    return float(np.log(np.maximum(rms, TINY)).mean())


def _rms(residual: np.ndarray) -> np.ndarray:
    """Root mean square of residuals (M, C), infinite without samples (C,)."""
    return np.sqrt(np.square(residual).mean(axis=0)) if len(residual) else np.full(residual.shape[1], np.inf)
