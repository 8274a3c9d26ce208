"""Start and result of a fit of trajectory, parameters and noise, and the prior of the parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ident.estimation.piece import Noise, Piece
from ident.estimation.precision import LEAST_SCATTER, embedded, inverse_of_precision, sandwich


class Prior(NamedTuple):
    """Gaussian prior of θ.

    Attributes:
        mean: Mean (p,).
        precision: Precision as it counts in the fit, zero where nothing is known (p, p).
        weight: How many times over it counts there: residuals that are slow tell less than a fit takes them for.
    """

    mean: np.ndarray
    precision: np.ndarray
    weight: float = 1.0

    @property
    def known(self) -> np.ndarray:
        """Precision as it is known (p, p)."""
        return self.precision / self.weight

    def weighted(self, weight: float) -> "Prior":
        """The same with another weight."""
        return Prior(self.mean, weight * self.known, weight)


@dataclass(frozen=True, eq=False)
class Start:
    """Starting point of an iteration.

    Attributes:
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
        coefficients: Spline coefficients of every piece (size, n).
        marginal: What θ's marginal likelihood adds, None for not known yet.
    """

    theta: np.ndarray
    noise: Noise
    coefficients: Sequence[np.ndarray]
    marginal: "Marginal | None" = None

    @property
    def pulls(self) -> Sequence[np.ndarray]:
        """Terms of the marginal likelihood of every piece, none where it is not known yet."""
        return self.marginal.pulls if self.marginal else ()


class Marginal(NamedTuple):
    """Terms that the marginal likelihood of θ adds to the gradient.

    Attributes:
        pulls: Of every piece, to be subtracted from its right side (p,).
        theta: Parameters that they were found for (p,).
        noise: Noise that they were found with.
        whole: False where they are on their way to what was found.
    """

    pulls: Sequence[np.ndarray]
    theta: np.ndarray
    noise: Noise
    whole: bool


@dataclass(frozen=True, eq=False)
class JointFit:
    """Trajectory, parameters and noise.

    Attributes:
        names: Names of θ.
        selections: Which entries of θ each piece has.
        prior: What was known of θ beforehand.
        theta: Parameters θ = [ψ, drives, offsets, set-up] (p,).
        shares: Precision of θ and its right side of every piece, trajectory eliminated: (p, p) and (p,).
        free: Which parameters were fitted (p,).
        noise: Standard deviations, correlation and smoothness.
        coefficients: Spline coefficients of every piece (size, n).
        pieces: What was measured.
        trace: Largest step of θ in standard deviations of every round.
        status: `converged`, `stopped` after so many rounds, `stuck` where no step lowers the cost, or `interrupted`.
        scatters: Covariance of every piece's right side under the noise that is really there (p, p); None for that of
            the working model, which is its precision.
        bounded: Parameters that are held at a bound (p,), None for none.
        marginal: What the marginal likelihood of θ adds; the shares have it.
    """

    names: Sequence[str]
    selections: Sequence[np.ndarray]
    prior: Prior
    theta: np.ndarray
    shares: Sequence[tuple[np.ndarray, np.ndarray]]
    free: np.ndarray
    noise: Noise
    coefficients: Sequence[np.ndarray]
    pieces: Sequence[Piece]
    trace: tuple[float, ...]
    status: str
    scatters: Sequence[np.ndarray] | None = None
    bounded: np.ndarray | None = None
    marginal: Marginal | None = None

    @property
    def end(self) -> Start:
        """Where it ended, for another fit of the same pieces to begin."""
        return Start(self.theta, self.noise, self.coefficients, self.marginal)

    @property
    def counted(self) -> np.ndarray:
        """Mask of what counts as fitted: also what is held at a bound (p,)."""
        return self.free if self.bounded is None else self.free | self.bounded

    @property
    def scatter_shares(self) -> Sequence[np.ndarray]:
        """Covariance of every piece's right side, by the working model where no other is known (p, p) each."""
        return [schur for schur, _ in self.shares] if self.scatters is None else self.scatters

    @cached_property
    def scatter(self) -> np.ndarray:
        """Covariance of the gradient, the priors' included (p, p)."""
        return sum(self.scatter_shares, start=self.prior.weight * self.prior.precision)

    @cached_property
    def precision(self) -> np.ndarray:
        """Precision of θ, priors included (p, p)."""
        return sum((schur for schur, _ in self.shares), start=self.prior.precision)

    @cached_property
    def gradient(self) -> np.ndarray:
        """Right side of the equations at θ, zero for what was fitted (p,)."""
        pull = -self.prior.precision @ (self.theta - self.prior.mean)
        return sum((right for _, right in self.shares), start=pull)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of θ from the noise, zero for what was not fitted (p, p).

        What is held at a bound counts as fitted: what trades with it is known no better for that.
        """
        taken = self.counted
        own = np.ix_(taken, taken)
        names = [name for name, one in zip(self.names, taken, strict=True) if one]
        return embedded(sandwich(self.precision[own], self.scatter[own], names), taken)

    def scores(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far θ would go in directions that were not fitted, the others refitted, and the standard deviations.

        Args:
            directions: Directions, one in each row, zero in what was fitted (k, p).

        Returns:
            Distances and their standard deviations, infinite where nothing tells (k,).
        """
        free = self.free
        inside = inverse_of_precision(self.precision[np.ix_(free, free)])
        across = directions @ self.precision
        regressed = across[:, free] @ inside
        curvature = ((across - regressed @ self.precision[free]) * directions).sum(axis=1)
        pull = directions @ self.gradient - regressed @ self.gradient[free]
        told = curvature > 0
        curvature = np.where(told, curvature, 1.0)
        alone = directions.copy()
        alone[:, free] -= regressed
        variance = np.maximum(((alone @ self.scatter) * alone).sum(axis=1), LEAST_SCATTER * curvature)
        return np.where(told, pull / curvature, 0.0), np.where(told, np.sqrt(variance) / curvature, np.inf)
