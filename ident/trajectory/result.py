"""Result of the trajectory estimate: parameters of each recording, and the uncertainty due to the set-up."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import special

from ident.estimation.equations import COMPONENTS
from ident.estimation.measurement import Measurement
from ident.estimation.setup_parameters import SetupParameter
from ident.tolerances import SIGNIFICANT
from ident.trajectory.fit.fitted import TrajectoryFit, inverse_of_precision
from ident.trajectory.reversals import Reversals
from ident.trajectory.setup_search import NEGLIGIBLE, Deviation, Search

ONE_SIDED = 0.95
"""Confidence level of a one-sided interval."""

TINY = 1e-9
"""Part of the scatter's trace added to its diagonal, because directions without data have no scatter."""


@dataclass(frozen=True, eq=False)
class TrajectoryEstimate:
    """A trajectory estimate.

    Attributes:
        measurement: Channels, and the parameters of one recording.
        search: Trajectories, parameters and noise, and the set-up parameters that are not as stated.
        steps: Largest knot spacing of each recording, s.
        known: True if a prior of the model's parameters was used.
        coloured: True if the fit's weights assume noise correlated over time.
        reversals: Slack of the torques at low velocity, None if no joint has friction.
        errors: Root mean squared errors of left-out pieces relative to their signals, without and with each alternative
            that was tried, by its name (2, C).
        setup: Set-up parameters of all recordings by their index among all parameters.
    """

    measurement: Measurement
    search: Search
    steps: tuple[float, ...]
    known: bool
    coloured: bool = False
    reversals: Reversals | None = None
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    setup: Mapping[int, SetupParameter] = field(default_factory=dict)

    @property
    def fit(self) -> TrajectoryFit:
        """Trajectories, parameters and noise."""
        return self.search.fit

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of pieces of each recording."""
        return tuple(np.bincount([piece.log for piece in self.fit.pieces]).tolist())

    def with_fit(self, fit: TrajectoryFit) -> "TrajectoryEstimate":
        """Estimate with another fit."""
        return replace(self, search=replace(self.search, fit=fit))

    @cached_property
    def is_setup(self) -> np.ndarray:
        """Mask of the parameters that belong to the set-up (p,)."""
        return np.isin(np.arange(len(self.fit.names)), list(self.setup))

    @cached_property
    def deviations(self) -> tuple[Deviation, ...]:
        """Set-up errors: those that the search found, and those that tracked poses show."""
        fit, std = self.fit, np.sqrt(np.diag(self.fit.covariance))
        tracked = [k for k, x in self.setup.items() if x.estimated and not (x.constant or x.row.stated)]
        z = -float(special.ndtri(SIGNIFICANT / 2 / max(len(tracked), 1)))
        shown = (k for k in tracked if abs(fit.theta[k]) > max(z * std[k], NEGLIGIBLE * self.setup[k].std))
        return (*self.search.deviations, *(Deviation(k, ()) for k in shown))

    @cached_property
    def covariance_of_setup(self) -> np.ndarray:
        """Covariance of all parameters due to the uncertainty of the set-up (p, p).

        With B the derivative of the fitted parameters by the fixed ones h of the set-up, J and K the precision and the
        scatter of h from the data, and L Lᵀ the covariance of their prior,

            B L Σ Lᵀ Bᵀ + B L m mᵀ Lᵀ Bᵀ,        Σ = (Lᵀ J K⁻¹ J L + 1)⁻¹,        m = Σ Lᵀ J K⁻¹ u

        The step m by which the data would move h counts as uncertainty, because h was not fitted.
        """
        fit = self.fit
        held, free = self.is_setup & ~fit.free, fit.counted
        p, inverse = fit.precision, inverse_of_precision(fit.precision[np.ix_(free, free)])
        B = -inverse @ p[np.ix_(free, held)]
        L = np.linalg.cholesky(self._setup_prior(np.flatnonzero(held)))
        alone = np.zeros((held.sum(), len(held)))
        alone[:, held] = np.eye(held.sum())
        alone[:, free] = B.T
        known, weight = fit.prior.known[np.ix_(held, held)], fit.prior.weight
        J = L.T @ (alone @ p @ alone.T - weight * known) @ L
        K = L.T @ (alone @ fit.scatter @ alone.T - weight**2 * known) @ L
        JK = np.linalg.solve(K + TINY * max(np.trace(K), 1.0) * np.eye(len(K)), J).T
        covariance = np.linalg.inv(JK @ J + np.eye(len(J)))
        by = B @ L
        moves = by @ (covariance @ JK @ (L.T @ (alone @ fit.gradient)))
        out = np.zeros_like(p)
        out[np.ix_(free, free)] = by @ covariance @ by.T + np.outer(moves, moves)
        # Variances may be negative by rounding.
        np.fill_diagonal(out, np.maximum(np.diag(out), 0))
        return out

    @cached_property
    def std_setup(self) -> np.ndarray:
        """Standard deviations of all parameters with the uncertainty of the set-up, zero if not fitted (p,)."""
        return np.sqrt(np.diag(self.fit.covariance + self.covariance_of_setup))

    def _setup_prior(self, fixed: np.ndarray) -> np.ndarray:
        """Prior covariance of set-up parameters by their indices, with what those of one instrument share (h, h)."""
        std = 1 / np.sqrt(np.diag(self.fit.prior.known)[fixed])
        shared = defaultdict[object, list[int]](list)
        for k, each in enumerate(self.setup[at] for at in fixed.tolist()):
            if each.row.common:
                shared[each.kind, each.log, each.place.get("wrenches"), each.of in COMPONENTS].append(k)
        out = np.diag(std**2)
        for own in (several for several in shared.values() if len(several) > 1):
            out[np.ix_(own, own)] += np.outer(std[own], std[own])
        return out

    @cached_property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Drives at their bound of zero: upper limit of the one-sided 95 % interval, and standard deviation if free.

        The unbounded estimate is normal about a value below zero; the limit is that of the distribution truncated at
        zero.
        """
        fit = self.fit
        held = np.flatnonzero(fit.bound)
        values, stds = fit.scores(np.eye(len(fit.theta))[held])
        finite = np.isfinite(stds)
        held, values, stds = held[finite], values[finite], stds[finite]
        limits = values - stds * special.ndtri_exp(np.log(1 - ONE_SIDED) + special.log_ndtr(values / stds))
        return {fit.names[k]: (float(x), float(s)) for k, x, s in zip(held.tolist(), limits, stds, strict=True)}

    def as_stated(self) -> "TrajectoryEstimate":
        """Estimate with the set-up as stated, and with the first recording's offsets and friction for all."""
        theta, columns = np.where(self.is_setup, 0.0, self.fit.theta), len(self.measurement.equations.names)
        for own in self.fit.of_recording:
            theta[own[:columns]] = self.fit.theta[self.fit.of_recording[0][:columns]]
        return replace(self, search=replace(self.search, fit=replace(self.fit, theta=theta), deviations=()))

    def pieces_of(self, which: int) -> slice:
        """Indices of the pieces of one recording."""
        first = sum(self.counts[:which])
        return slice(first, first + self.counts[which])

    def parameters_of(self, which: int | None, *, left_out: bool = False) -> np.ndarray:
        """Parameters of one recording, or, for another one, their means over the recordings.

        Args:
            which: Index of the recording, None for another one.
            left_out: True to take the columns of a recording from the other ones.
        """
        every = self.fit.theta[np.array(self.fit.of_recording)]
        others = np.delete(every, which, axis=0) if left_out and which is not None else every
        # The mean of equal parameters is exact.
        mean = every[0] + (others - every[0]).mean(axis=0)
        if which is None:
            return mean
        columns = len(self.measurement.equations.names)
        return np.r_[mean[:columns], every[which][columns:]] if left_out else every[which]
