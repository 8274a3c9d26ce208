"""The joint estimate as others read it: parameters of each recording, and what is not known of the set-up."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import special

from ident.estimation.joint_fit import JointFit
from ident.estimation.measurement import Measurement
from ident.estimation.piece import Piece
from ident.estimation.precision import inverse_of_precision
from ident.estimation.reversals import Reversals
from ident.estimation.setup_search import Search

ONE_SIDED = 0.95
"""Confidence of an interval that is open below."""

TINY = 1e-9
"""Part of the scatter's trace that is added to its diagonal: directions that no data see have none."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint estimate.

    Attributes:
        measurement: Channels, and the parameters of one recording.
        search: Trajectories, parameters and noise, and the set-up parameters that are not as stated.
        counts: Number of pieces of each recording.
        step: Largest distance of the knots, s.
        known: True where a prior of the model's parameters was put in.
        coloured: True where the fit's weights take noise for correlated over time.
        reversals: Slack of the torques at low velocity, None where no joint rubs.
        errors: Root mean squared errors over the signals of pieces that are left out, for each noise model (C,).
    """

    measurement: Measurement
    search: Search
    counts: tuple[int, ...]
    step: float
    known: bool
    coloured: bool = False
    reversals: Reversals | None = None
    errors: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def fit(self) -> JointFit:
        """Trajectories, parameters and noise."""
        return self.search.fit

    def with_fit(self, fit: JointFit) -> "Joint":
        """The same with another fit."""
        return replace(self, search=replace(self.search, fit=fit))

    @cached_property
    def is_setup(self) -> np.ndarray:
        """Mask of the parameters that belong to the set-up (p,)."""
        return is_setup(self.measurement, self.fit.names)

    @cached_property
    def covariance_of_setup(self) -> np.ndarray:
        """Covariance of all parameters that what is not known of the set-up adds (p, p).

        With B the change of the fitted parameters by the held ones h of the set-up, and with the precision J and the
        scatter K of what the data say of h, and Λ that of their prior,

            B Σ Bᵀ + B m mᵀ Bᵀ,        Σ = (J K⁻¹ J + Λ)⁻¹,        m = Σ J K⁻¹ u

        To the uncertainty of h belongs how far the data would move them, m: they were not fitted.
        """
        fit = self.fit
        held, free = self.is_setup & ~fit.free, fit.counted
        p, inverse = fit.precision, inverse_of_precision(fit.precision[np.ix_(free, free)])
        B = -inverse @ p[np.ix_(free, held)]
        prior, weight = np.sqrt(np.diag(fit.prior.known)[held]), fit.prior.weight
        alone = np.zeros((held.sum(), len(held)))
        alone[:, held] = np.eye(held.sum())
        alone[:, free] = B.T
        known = np.outer(prior, prior)
        J = (alone @ p @ alone.T) / known - weight * np.eye(len(prior))
        K = (alone @ fit.scatter @ alone.T) / known - weight**2 * np.eye(len(prior))
        u = (alone @ fit.gradient) / prior
        JK = np.linalg.solve(K + TINY * max(np.trace(K), 1.0) * np.eye(len(K)), J).T
        covariance = np.linalg.inv(JK @ J + np.eye(len(J)))
        moves = B @ ((covariance @ JK @ u) / prior)
        out = np.zeros_like(p)
        out[np.ix_(free, free)] = B @ (covariance / known) @ B.T + np.outer(moves, moves)
        return out

    @cached_property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Drives at their bound of zero: upper limit of the one-sided 95 % interval, and standard deviation if free.

        The drive that the data ask for is normal about a value below zero; of that distribution what is above zero
        counts.
        """
        fit = self.fit
        held = np.flatnonzero(np.zeros(0) if fit.bounded is None else fit.bounded)
        values, stds = fit.scores(np.eye(len(fit.theta))[held])
        finite = np.isfinite(stds)
        held, values, stds = held[finite], values[finite], stds[finite]
        limits = values - stds * special.ndtri_exp(np.log(1 - ONE_SIDED) + special.log_ndtr(values / stds))
        return {fit.names[k]: (float(x), float(s)) for k, x, s in zip(held.tolist(), limits, stds, strict=True)}

    def as_stated(self) -> "Joint":
        """The same with the set-up as it was stated."""
        fit = replace(self.fit, theta=np.where(self.is_setup, 0.0, self.fit.theta))
        return replace(self, search=replace(self.search, fit=fit, deviations=()))

    def pieces_of(self, which: int) -> slice:
        """Indices of the pieces of one recording."""
        first = sum(self.counts[:which])
        return slice(first, first + self.counts[which])

    def parameters_of(self, which: int) -> np.ndarray:
        """Parameters of one recording."""
        return self.fit.theta[self.fit.selections[self.pieces_of(which).start]]

    def places_of(self, which: int) -> list[tuple[Piece, np.ndarray]]:
        """Pieces and spline coefficients of one recording."""
        own = self.pieces_of(which)
        return list(zip(self.fit.pieces[own], self.fit.coefficients[own], strict=True))

    def offsets_beside_first(self, which: int) -> np.ndarray:
        """By how much constant offsets of the first recording exceed those of another one (C,)."""
        constants = self.measurement.constants
        return constants(self.parameters_of(0)) - constants(self.parameters_of(which))


def is_setup(measurement: Measurement, names: Sequence[str]) -> np.ndarray:
    """Mask of the parameters that belong to the set-up (p,)."""
    own = {each.name for each in measurement.setup}
    return np.array([name.partition(" of log ")[0] in own for name in names], bool)


def is_drive(measurement: Measurement, parameters: int) -> np.ndarray:
    """Mask of the parameters that are friction or rotor inertia (p,)."""
    first = measurement.equations.parameters.rank
    out = np.zeros(parameters, bool)
    out[first : first + len(measurement.equations.drives)] = True
    return out
