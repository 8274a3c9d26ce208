"""Linear response of a piece of the trajectory estimate to noise: changes of the estimate, and residuals.

    δc = A⁻¹ (Jᵀ W ε - λP c) - F δθ,         r = ε - J δc - T δθ,        F = A⁻¹ B

J and T are the derivatives of all streams by the spline coefficients c and by θ, W the weights, which may be those of
autocorrelated noise. θ minimises the misfit along the trajectories c(θ):

    δθ = P⁻¹ (Rᵀ W ε + Mᵀ λP c),             R = T - J (F + M),          M = A⁻¹ λP F

R are the rows of θ with the trajectory eliminated, and M is what the smoothness takes of the motion c. With the penalty
in the cost of θ as well, it would take F: the correction is of second order (twicing; Newey, Hsieh and Robins,
Econometrica 72, 2004, doi:10.1111/j.1468-0262.2004.00518.x).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ident.trajectory.algebra.arrow import Eliminated, stacked, transposed
from ident.trajectory.algebra.nodes import Nodes
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.algebra.whitening import Innovations
from ident.trajectory.fit.piece import Noise, Piece, Predictor
from ident.trajectory.fit.piece_equations import normal_equations

CLEAR = 0.5
"""Share of the noise in a sample's variance above which its residual is used to estimate the noise."""


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of streams: products with the inverse of the noise covariance assumed by the fit.

    Attributes:
        scale: Factors of innovations (N, s).
        rho: Part of the preceding sample that innovations subtract (N, s).
    """

    scale: np.ndarray
    rho: np.ndarray

    @classmethod
    def of(cls, new: Innovations) -> "Weights":
        """Weights of a fit's innovations."""
        return cls(new.there * np.sqrt(new.weight) / new.std, new.rho)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Weighted signals (N, s, k)."""
        z = self.scale[..., None] ** 2 * x
        if not self.rho.any():
            return z
        z[1:] -= (self.scale[1:] ** 2 * self.rho[1:])[..., None] * x[:-1]
        # Innovations times the transposed matrix of the differences that they are.
        z[:-1] -= self.rho[1:, :, None] * z[1:]
        return z


@dataclass(frozen=True, eq=False)
class Stream:
    """Signals measured at the same times: coordinates, a derivative of them, or channels that share a clock.

    Attributes:
        which: Order of the derivative, or the channels.
        time: Sample times, s (N,).
        bases: Values of the spline functions at samples or nodes; for channels, of the first two derivatives as well.
        nodes: Nodes at which channels are evaluated, None for the samples.
        weights: Weights of the samples.
        residual: Residuals, zero where a sample is missing (N, s).
        clear: Mask of the samples from which noise is estimated (N, s).
        std: Standard deviations of the noise assumed by the fit (s,).
        slack: Standard deviations of the error in addition to noise (N, s), None for none.
        by_row: Derivatives of channels by coordinates and their derivatives, at M samples or nodes (M, s, 3 n), and by
            θ (M, s, p); None of coordinates.
    """

    which: int | slice
    time: np.ndarray
    bases: Sequence[sparse.csr_matrix]
    nodes: Nodes | None
    weights: Weights
    residual: np.ndarray
    clear: np.ndarray
    std: np.ndarray
    slack: np.ndarray | None
    by_row: tuple[np.ndarray, np.ndarray] | None = None

    def at_samples(self, values: np.ndarray) -> np.ndarray:
        """Values at the samples (N, …) from those where the channels are evaluated (M, …)."""
        return values if self.nodes is None else self.nodes.interpolated(values)

    def gathered(self, signals: np.ndarray) -> np.ndarray:
        """Signals at the samples (N, …) times the transposed matrix of `at_samples` (M, …)."""
        return signals if self.nodes is None else self.nodes.adjoint(signals)

    @property
    def step(self) -> float:
        """Time between samples, s."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True, eq=False)
class Response:
    """Piece linearised at an estimate.

    Attributes:
        streams: Coordinates by order of the derivative, then channels.
        zeros: Columns of the coordinates' zeros, by coordinate.
        eliminated: Normal equations with the trajectory eliminated.
        spline: Spline space of the trajectory.
        jerk: λ of each coordinate (n,).
    """

    streams: Sequence[Stream]
    zeros: dict[int, int]
    eliminated: Eliminated
    spline: Spline
    jerk: np.ndarray

    @property
    def follows(self) -> np.ndarray:
        """F (size n, p)."""
        return self.eliminated.by_theta

    @cached_property
    def stiff(self) -> np.ndarray:
        """λP F (size n, p)."""
        return self.spline.penalised(self.follows, self.jerk)

    @cached_property
    def smoothed(self) -> np.ndarray:
        """M (size n, p)."""
        return self.solved(self.stiff)

    @property
    def scatter_of_motion(self) -> np.ndarray:
        """Covariance `Mᵀ λP M` of the right side of θ due to a motion of covariance `(λP)⁻¹` (p, p)."""
        bent = self.spline.bent(self.smoothed, self.jerk)
        return bent.T @ bent

    def rows(self) -> list[np.ndarray]:
        """Rows R of θ of every stream, the trajectory eliminated (N, s, p)."""
        return self.signals(-self.follows - self.smoothed, None)

    def signals(self, coefficients: np.ndarray, theta: np.ndarray | None) -> list[np.ndarray]:
        """`J c + T θ` of every stream (N, s, k).

        Args:
            coefficients: Coefficients c (size n, k).
            theta: Parameters θ (p, k); None for the unit matrix.
        """
        n, k = len(self.jerk), coefficients.shape[1]
        flat, out = coefficients.reshape(-1, n * k), []
        for stream in self.streams:
            moved = [(basis @ flat).reshape(-1, n, k) for basis in stream.bases]
            if stream.by_row is None:
                out.append(moved[0])
                continue
            by_states, by_theta = stream.by_row
            rows = by_theta.copy() if theta is None else by_theta @ theta
            for by_kind, own in zip(np.split(by_states, len(moved), axis=2), moved, strict=True):
                rows += by_kind @ own
            out.append(stream.at_samples(rows))
        for j, at in self.zeros.items():
            out[0][:, j] += np.eye(k)[at] if theta is None else theta[at]
        return out

    def adjoint(self, signals: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """`Jᵀ y` (size n, k) and `Tᵀ y` (p, k) for signals y (N, s, k) of every stream."""
        n, k = len(self.jerk), signals[0].shape[2]
        size = self.spline.size
        c, theta = np.zeros((size, n * k)), np.zeros((self.follows.shape[1], k))
        for stream, y in zip(self.streams, signals, strict=True):
            pulled = y
            if stream.by_row is not None:
                by_states, by_theta = stream.by_row
                own = stream.gathered(y)
                pulled = transposed(by_states) @ own
                theta += stacked(by_theta).T @ stacked(own)
            # Rows of a derivative follow those of the one before it.
            for basis, own in zip(stream.bases, np.split(pulled, len(stream.bases), axis=1), strict=True):
                c += basis.T @ own.reshape(len(own), -1)
        for j, at in self.zeros.items():
            theta[at] += signals[0][:, j].sum(axis=0)
        return c.reshape(size * n, k), theta

    def weighted(self, signals: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Weighted signals."""
        return [stream.weights(x) for stream, x in zip(self.streams, signals, strict=True)]

    def solved(self, right: np.ndarray) -> np.ndarray:
        """`A⁻¹ right` for right sides (size n, k)."""
        return self.eliminated.solved(right)


def response(
    measurement: Predictor, piece: Piece, coefficients: np.ndarray, theta: np.ndarray, noise: Noise
) -> Response:
    """Linear response of a piece at an estimate, with all entries of θ as columns.

    Args:
        measurement: Channels and parameters.
        piece: Measured samples.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness of the fit.
    """
    every = np.arange(len(theta))
    equations = normal_equations(measurement, piece, coefficients, theta, noise, every)
    streams = []
    for kind, new in equations.states.items():
        bases = [piece.at_coordinates.matrices[kind]]
        streams.append(Stream(kind, piece.time, bases, None, *_of(new), noise.states[kind], None))
    for each in equations.channels:
        bases = (each.at if each.nodes is None else each.nodes.sampling).matrices
        std, slack = noise.channels[each.channels], None if piece.slack is None else piece.slack[:, each.channels]
        by_states, by_theta = each.by_sample
        by_row = by_states.reshape(*by_theta.shape[:2], -1), by_theta.copy()
        streams.append(Stream(each.channels, piece.when, bases, each.nodes, *_of(each.new), std, slack, by_row))
    zeros = dict(measurement.zeros) if 0 in equations.states else {}
    return Response(streams, zeros, equations.eliminated, piece.spline, noise.jerk)


def _of(new: Innovations) -> tuple[Weights, np.ndarray, np.ndarray]:
    return Weights.of(new), new.residual, new.there & (new.clarity > CLEAR)
