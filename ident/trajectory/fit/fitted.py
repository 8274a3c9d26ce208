"""Fit of trajectory, parameters and noise, and the prior of the parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from ident.errors import ExcitationError
from ident.trajectory.fit.piece import Noise, Piece, Point

TINIEST = 1e-300
"""Lower limit of sums of squares and of precisions, so that nothing is divided by zero."""

LEAST_SCATTER = 0.05
"""Least variance over that of the working model, in any direction: smaller estimates of the noise are chance."""

UNDETERMINED = (
    "recording does not determine all parameters. Move all joints further, take their angles as they were measured, "
    "hold those that rest (--fix), or fit what the model knows as well (--prior on)."
)
"""End of messages on parameters that a recording does not determine."""


def inverse_of_precision(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Inverse of a precision matrix.

    Raises:
        ExcitationError: It is not positive definite; the error carries the names.
    """
    root = root_of_inverse(precision, names)
    return root @ root.T


def sandwich(precision: np.ndarray, scatter: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Covariance `P⁻¹ M P⁻¹` from a precision P and the covariance M of the right side (k, k).

    Raises:
        ExcitationError: The precision is not positive definite; the error carries the names.
    """
    root = root_of_inverse(precision, names)
    values, vectors = np.linalg.eigh(root.T @ scatter @ root)
    wider = root @ vectors * np.sqrt(np.maximum(values, LEAST_SCATTER))
    return np.asarray(wider @ wider.T)


def root_of_inverse(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Root R of the inverse `R Rᵀ` of a precision matrix, which is scaled to unit diagonal first.

    Raises:
        ExcitationError: It is not positive definite or not finite; the error carries the names.
    """
    if not np.isfinite(precision).all():
        raise ExcitationError(f"The fit diverges: the {UNDETERMINED}", tuple(names))
    scale = np.sqrt(np.maximum(np.diag(precision), TINIEST))
    try:
        factor = linalg.cholesky(precision / np.outer(scale, scale))
    except linalg.LinAlgError:
        raise ExcitationError(f"The {UNDETERMINED}", tuple(names)) from None
    # LAPACK complains of matrices without rows.
    inverse = lapack.dtrtri(factor)[0] if len(factor) else factor
    return np.asarray(inverse) / scale[:, None]


def embedded(matrix: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Matrix over some entries of θ embedded in zeros (p, p)."""
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = matrix
    return out


class Prior(NamedTuple):
    """Gaussian prior of θ.

    Attributes:
        mean: Mean (p,).
        precision: Precision in the fit, weight included, zero where nothing is known (p, p).
        weight: Factor on the prior's precision in the fit, because autocorrelated residuals carry less information than
            the fit assumes.
    """

    mean: np.ndarray
    precision: np.ndarray
    weight: float = 1.0

    @property
    def known(self) -> np.ndarray:
        """Precision without the weight (p, p)."""
        return self.precision / self.weight

    def weighted(self, weight: float) -> "Prior":
        """Prior with another weight."""
        return Prior(self.mean, weight * self.known, weight)

    def loosened(self, at: np.ndarray, std: np.ndarray) -> "Prior":
        """Prior with other standard deviations (p,) of set-up parameters, by their indices."""
        precision = self.precision.copy()
        precision[at, at] = self.weight / std[at] ** 2
        return self._replace(precision=precision)


def share(precision: np.ndarray, right: np.ndarray, own: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Precision (p, p) and right side (p,) of all of θ, from those of a piece's own parameters, by their indices."""
    whole, right_side = np.zeros((number, number)), np.zeros(number)
    whole[np.ix_(own, own)], right_side[own] = precision, right
    return whole, right_side


@dataclass(frozen=True, eq=False)
class TrajectoryFit:
    """Fit of trajectory, parameters and noise, and as such the starting point of another one.

    Attributes:
        names: Names of θ.
        of_recording: Indices in θ of the parameters of every recording.
        prior: Prior of θ.
        theta: Parameters θ = [ψ, drives, offsets, set-up] (p,).
        free: Mask of the fitted parameters (p,).
        noises: Standard deviations, correlation and smoothness, of every recording.
        coefficients: Spline coefficients of every piece (size, n).
        pieces: Measured samples.
        shares: Precision and right side of θ from every piece, trajectory eliminated: (p, p) and (p,).
        trace: Largest step of θ of every round, in standard deviations.
        status: `converged`; `near` convergence, for results that only decide; `stopped` after the largest number of
            rounds; `stuck` if no step lowers the cost; or `interrupted`.
        scatters: Covariance of every piece's right side under the estimated noise, and then of what repeats in several
            recordings (p, p); None for that of the working model, which is its precision.
        bounded: Mask of the parameters at a bound (p,), None for none.
    """

    names: Sequence[str]
    of_recording: Sequence[np.ndarray]
    prior: Prior
    theta: np.ndarray
    free: np.ndarray
    noises: Sequence[Noise]
    coefficients: Sequence[np.ndarray]
    pieces: Sequence[Piece]
    shares: Sequence[tuple[np.ndarray, np.ndarray]] = ()
    trace: tuple[float, ...] = ()
    status: str = "stopped"
    scatters: Sequence[np.ndarray] | None = None
    bounded: np.ndarray | None = None

    @property
    def selections(self) -> list[np.ndarray]:
        """Indices in θ of every piece's parameters."""
        return [self.of_recording[piece.log] for piece in self.pieces]

    @property
    def points(self) -> list[Point]:
        """Point of every piece."""
        every = zip(self.pieces, self.coefficients, self.selections, strict=True)
        return [Point(piece, c, self.theta[own], self.noises[piece.log]) for piece, c, own in every]

    @cached_property
    def channel_noise(self) -> np.ndarray:
        """Standard deviations of the channels' noise, root mean square over all samples (C,)."""
        return self._overall([noise.channels for noise in self.noises])

    @cached_property
    def coordinate_noise(self) -> np.ndarray:
        """Standard deviations of the coordinates' noise, root mean square over all samples (n,)."""
        return self._overall([noise.states for noise in self.noises])

    def _overall(self, each: Sequence[np.ndarray]) -> np.ndarray:
        squares = [each[piece.log] ** 2 for piece in self.pieces]
        return np.sqrt(np.average(squares, axis=0, weights=[len(piece.time) for piece in self.pieces]))

    @property
    def bound(self) -> np.ndarray:
        """Mask of the drives held at their bound of zero (p,)."""
        return np.zeros_like(self.free) if self.bounded is None else self.bounded

    @property
    def unbound(self) -> "TrajectoryFit":
        """Fit with these drives free, as a starting point: another fit may find them positive."""
        return replace(self, free=self.free | self.bound)

    @property
    def counted(self) -> np.ndarray:
        """Mask of the parameters that count as fitted, including those at a bound (p,)."""
        return self.free | self.bound

    @property
    def scatter_shares(self) -> Sequence[np.ndarray]:
        """Covariance of every piece's right side, and more, by default of the working model (p, p) each."""
        return [schur for schur, _ in self.shares] if self.scatters is None else self.scatters

    @cached_property
    def scatter(self) -> np.ndarray:
        """Covariance of the gradient, prior included (p, p)."""
        return sum(self.scatter_shares, start=self.prior.weight * self.prior.precision)

    @cached_property
    def precision(self) -> np.ndarray:
        """Precision of θ, prior included (p, p)."""
        return sum((schur for schur, _ in self.shares), start=self.prior.precision)

    @cached_property
    def gradient(self) -> np.ndarray:
        """Right side of the equations at θ, zero for the fitted parameters (p,)."""
        pull = -self.prior.precision @ (self.theta - self.prior.mean)
        return sum((right for _, right in self.shares), start=pull)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of θ due to the noise, zero for parameters that were not fitted (p, p).

        Parameters at a bound count as fitted: the bound does not make those correlated with them more certain.
        """
        taken = self.counted
        own = np.ix_(taken, taken)
        names = [name for name, one in zip(self.names, taken, strict=True) if one]
        return embedded(sandwich(self.precision[own], self.scatter[own], names), taken)

    def scores(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps of θ in directions that were not fitted, with the others refitted, and their standard deviations.

        Args:
            directions: Directions, one in each row, zero for the fitted parameters (k, p).

        Returns:
            Steps and their standard deviations, infinite where the data do not determine a direction (k,).
        """
        free = self.free
        inside = inverse_of_precision(self.precision[np.ix_(free, free)])
        across = directions @ self.precision
        regressed = across[:, free] @ inside
        curvature = ((across - regressed @ self.precision[free]) * directions).sum(axis=1)
        pull = directions @ self.gradient - regressed @ self.gradient[free]
        determined = curvature > 0
        curvature = np.where(determined, curvature, 1.0)
        alone = directions.copy()
        alone[:, free] -= regressed
        variance = np.maximum(((alone @ self.scatter) * alone).sum(axis=1), LEAST_SCATTER * curvature)
        return np.where(determined, pull / curvature, 0.0), np.where(determined, np.sqrt(variance) / curvature, np.inf)
