"""Linear response of a piece of the trajectory estimate to noise: the rows of θ, and what the trajectory follows.

    δθ = P⁻¹ (Rᵀ W ε + Mᵀ λP c),       R = T - J (F + M),       F = A⁻¹ B,       M = A⁻¹ λP F

minimises the misfit along the trajectories c(θ). J and T are the derivatives of all streams by the spline coefficients
c and by θ, W the weights, which may be those of autocorrelated noise. R are the rows of θ with the trajectory
eliminated, and M is what the smoothness takes of the motion c. With the penalty in the cost of θ as well, it would take
F: the correction is of second order (twicing; Newey, Hsieh and Robins, Econometrica 72, 2004,
doi:10.1111/j.1468-0262.2004.00518.x).

Of noise of frequency ω the trajectory follows the share

    h = Σ w j I⁻¹ jᴴ,       I = Σ w jᴴ j + λ ω⁶ t,       j = Σ_d (iω)ᵈ ∂f/∂q⁽ᵈ⁾

with derivatives ∂f/∂q⁽ᵈ⁾ of a stream by the coordinates' derivatives and weights w, summed over a part of the piece
of duration t in which the derivatives hardly change.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.estimation.measurement import Measurement
from ident.trajectory.algebra.arrow import Eliminated
from ident.trajectory.algebra.rows import TOGETHER, Nodes
from ident.trajectory.algebra.spline import LOCAL, ORDER, Sampling, Spline, sliding
from ident.trajectory.algebra.whitening import Innovations
from ident.trajectory.fit.piece import Point
from ident.trajectory.fit.piece_equations import normal_equations

CLEAR = 0.5
"""Share of the noise in a sample's variance above which its residual is used to estimate the noise."""

PART, PARTS = 8.0, 12
"""Least length of a part, in samples, and largest number of parts. All channels of a piece together tell more of the
motion than those of any time do: by its mean derivatives, a trajectory of three bodies on a moving base that follows
.91 of a frequency would follow .54, and intervals held for 89 instead of 94 %."""


@dataclass(frozen=True, eq=False)
class Stream:
    """Signals measured at the same times: coordinates, or channels that share a clock.

    Attributes:
        time: Sample times, s (N,).
        at: Spline functions at samples or nodes.
        nodes: Nodes at which channels are evaluated, None for the samples.
        new: Their innovations.
        std: Standard deviations of the noise assumed by the fit (s,).
        slack: Standard deviations of the error in addition to noise (N, s), None for none.
        by_row: Derivatives of channels by coordinates and their derivatives, at M samples or nodes (M, s, 3 n), and by
            θ (M, s, p); None of coordinates.
    """

    time: np.ndarray
    at: Sampling
    nodes: Nodes | None
    new: Innovations
    std: np.ndarray
    slack: np.ndarray | None
    by_row: tuple[np.ndarray, np.ndarray] | None = None

    def at_samples(self, values: np.ndarray) -> np.ndarray:
        """Values at the samples (N, …) from those where the channels are evaluated (M, …)."""
        return values if self.nodes is None else self.nodes.interpolated(values)

    @cached_property
    def by_states(self) -> np.ndarray:
        """Derivatives of channels by coordinates and their derivatives at the samples (N, s, 3 n)."""
        assert self.by_row is not None
        return self.at_samples(self.by_row[0])

    @cached_property
    def clear(self) -> np.ndarray:
        """Mask of the samples from which noise is estimated (N, s): there is little slack, and they are no outliers."""
        return np.asarray(self.new.there & (self.new.clarity > CLEAR) & (self.new.weight == 1))

    @cached_property
    def beyond_noise(self) -> np.ndarray:
        """Standard deviations of the error in addition to noise (N, s): slack, and of outliers what they have more.

        What a motion that jumps leaves between knots is where it is, and no noise of all samples: it counts for the
        parameters that these samples tell (heteroscedasticity-consistent; White, Econometrica 48, 1980,
        doi:10.2307/1912934).
        """
        more = np.where(self.new.weight < 1, np.maximum(self.new.residual**2 - self.std**2, 0), 0)
        return np.asarray(np.sqrt(more if self.slack is None else more + self.slack**2))

    @cached_property
    def scale(self) -> np.ndarray:
        """Factors of innovations (N, s)."""
        return np.asarray(self.new.there * np.sqrt(self.new.weight) / self.new.std)

    def weighted(self, x: np.ndarray, some: slice = slice(None)) -> np.ndarray:
        """Products of signals (N, s, k) with the inverse of the noise covariance assumed by the fit."""
        squares, rho = self.scale[:, some, None] ** 2, self.new.rho[:, some, None]
        z = squares * x
        if not rho.any():
            return z
        z[1:] -= squares[1:] * rho[1:] * x[:-1]
        # Innovations times the transposed matrix of the differences that they are.
        z[:-1] -= rho[1:] * z[1:]
        return z

    @property
    def step(self) -> float:
        """Time between samples, s."""
        return float(np.median(np.diff(self.time)))

    def weight(self, omega: np.ndarray) -> np.ndarray:
        """Weights of noise of some frequencies, rad/s (F,), relative to `scale` squared (F, s)."""
        return np.asarray(np.abs(1 - np.exp(-1j * self.step * omega)[:, None] * self.new.rho.max(axis=0)) ** 2)


@dataclass(frozen=True, eq=False)
class Response:
    """Piece linearised at an estimate.

    Attributes:
        streams: Coordinates, then channels.
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

    @cached_property
    def smoothed(self) -> np.ndarray:
        """M (size n, p)."""
        return self.eliminated.solved(self.spline.penalised(self.eliminated.by_theta, self.jerk))

    @property
    def scatter_of_motion(self) -> np.ndarray:
        """Covariance `Mᵀ λP M` of the right side of θ due to a motion of covariance `(λP)⁻¹` (p, p)."""
        bent = self.spline.bent(self.smoothed, self.jerk)
        return bent.T @ bent

    @cached_property
    def _moves(self) -> np.ndarray:
        """Coefficients by θ along the trajectories (size, n, p)."""
        return -(self.eliminated.by_theta + self.smoothed).reshape(-1, len(self.jerk), self.smoothed.shape[1])

    def rows(self, which: int, some: slice = slice(None), root: np.ndarray | None = None) -> np.ndarray:
        """Rows R of θ of some signals of a stream, the trajectory eliminated, times a root (p, q) if any (N, c, q)."""
        stream, n = self.streams[which], len(self.jerk)
        at, deal = stream.at.dealt, stream.at.intervals
        moves = self._moves[:, some] if stream.by_row is None else self._moves
        moves = moves if root is None else moves @ root
        size, _, q = moves.shape
        if stream.by_row is None:
            moved = at[..., 0] @ sliding(moves.reshape(size, -1), LOCAL)
            out = deal.gathered(moved).reshape(len(stream.time), -1, q)
            for k, j in enumerate(range(n)[some]):
                if j in self.zeros:
                    out[:, k] += np.eye(1, q, self.zeros[j])[0] if root is None else root[self.zeros[j]]
            return out
        by_states, by_theta = (x[:, some] for x in stream.by_row)
        by_states = deal.dealt_by_stream(by_states.reshape(*by_theta.shape[:2], ORDER, n))
        by_functions = (at[:, None] @ by_states).reshape(len(at), -1, LOCAL * n)
        moved = (by_functions @ sliding(moves.reshape(-1, q), LOCAL * n, n)).reshape(len(at), -1, deal.room, q)
        by_theta = by_theta if root is None else by_theta @ root
        return stream.at_samples(by_theta + deal.gathered(moved.swapaxes(1, 2)))

    def blocks(self, which: int, root: np.ndarray | None = None) -> Iterator[tuple[slice, np.ndarray]]:
        """Yields a few signals of a stream at a time and their `rows` (N, c, q), which stay in the cache."""
        N, number = self.streams[which].new.residual.shape
        size = max(1, 4 * TOGETHER // (8 * N * self._moves.shape[2]))
        every = None if self.streams[which].by_row is None else self.rows(which, root=root)
        for some in (slice(k, k + size) for k in range(0, number, size)):
            yield some, self.rows(which, some, root) if every is None else every[:, some]

    def followed(self, frequency: np.ndarray) -> list[np.ndarray]:
        """Shares h of every stream's noise that the trajectory follows, in parts of the piece (k, F, s).

        Args:
            frequency: Frequencies, Hz (F,).
        """
        time, slowest = self.streams[0].time, max(stream.step for stream in self.streams)
        number = max(int(np.ptp(time) / max(self.spline.step, PART * slowest)), 1)
        borders = np.linspace(time[0], time[-1], number + 1)
        chosen = np.unique(np.linspace(0, number - 1, PARTS).round().astype(int))
        # Splines follow no frequency above half of the knots', and of that one a half.
        ratio = np.minimum(frequency * self.spline.step, 1)
        passed = ((1 - ratio) ** (2 * LOCAL) / ((1 - ratio) ** (2 * LOCAL) + ratio ** (2 * LOCAL)))[:, None]
        parts = [self._followed(2 * np.pi * frequency, *borders[k : k + 2]) for k in chosen.tolist()]
        return [passed * np.array(own) for own in zip(*parts, strict=True)]

    def _followed(self, omega: np.ndarray, first: float, last: float) -> list[np.ndarray]:
        """Shares h of every stream's noise at frequencies, rad/s (F,), from one time to another (F, s) each."""
        powers, n = (1j * omega[:, None]) ** np.arange(ORDER), len(self.jerk)
        information = ((last - first) * omega ** (2 * ORDER))[:, None, None] * np.diag(self.jerk).astype(complex)
        every = []
        for stream in self.streams:
            inside = (stream.time >= first) & (stream.time < last)
            scale, weight = stream.scale[inside], stream.weight(omega)
            if stream.by_row is None:
                own = weight * (scale**2).sum(axis=0)
                information += own[:, None] * np.eye(n)
            else:
                by = (stream.by_states[inside] * scale[..., None]).transpose(1, 2, 0)
                products = (by @ by.swapaxes(1, 2)).reshape(-1, ORDER, n, ORDER, n)
                own = np.einsum("fd,sdjek,fe->fsjk", powers.conj(), products, powers, optimize=True)
                own *= weight[..., None, None]
                information += own.sum(axis=1)
            every.append(own)
        inverse = np.linalg.inv(information)
        alone = np.diagonal(inverse, axis1=1, axis2=2).real
        # Several coordinates together can follow more than a stream's own frequency.
        return [
            np.minimum(own * alone if own.ndim == 2 else np.einsum("fsjk,fkj->fs", own, inverse).real, 1)
            for own in every
        ]


def response(measurement: Measurement, point: Point) -> Response:
    """Linear response of a piece at an estimate, with all entries of θ as columns."""
    piece, noise = point.piece, point.noise
    equations = normal_equations(measurement, point, np.arange(len(point.theta)))
    streams = [Stream(piece.time, piece.at_coordinates, None, equations.states, noise.states, None)]
    for each in equations.channels:
        at = each.at if each.nodes is None else each.nodes.sampling
        std, slack = noise.channels[each.channels], None if piece.slack is None else piece.slack[:, each.channels]
        by_states, by_theta = each.by_sample
        by_row = by_states.reshape(*by_theta.shape[:2], -1), by_theta.copy()
        streams.append(Stream(piece.when, at, each.nodes, each.new, std, slack, by_row))
    return Response(streams, dict(measurement.zeros), equations.eliminated, piece.spline, noise.jerk)
