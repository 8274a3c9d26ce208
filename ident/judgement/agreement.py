"""Agreement of the fitted parts of an estimate, each from its share of the equations, and of two estimates.

To first order, a part alone is off the estimate by δ_k:

    δ_k = P_k⁻¹ g_k,        cov(δ_1 - δ_2) = P_1⁻¹ + P_2⁻¹

P_k and g_k are the precision and the right side of a part at the estimate, its trajectory eliminated.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

import numpy as np
from scipy import special

from ident.display.brief import Worded, html_table
from ident.display.text import rounded
from ident.errors import ExcitationError, InputError
from ident.estimation.noise import unit_of
from ident.geometry.inertia import with_bodies
from ident.regression.ordinary import Fit
from ident.tolerances import SIGNIFICANT
from ident.trajectory import left_out
from ident.trajectory.fit.fitted import embedded, inverse_of_precision, sandwich
from ident.trajectory.result import TrajectoryEstimate

DISAGREE = 2.0
"""Root mean square z of the differences between halves above which they disagree."""

LEAST_ADDED = 0.01
"""Least variance of these differences, over a parameter's own: it is computed as a difference, with rounding errors."""

UNLIKELY = 0.01
"""p-value of χ² below which a difference is called more than noise."""

MOST = 5
"""Number of parameters that a sentence names."""


def differences(joint: TrajectoryEstimate) -> np.ndarray | None:
    """Differences of the base parameters between two halves, of the recordings if there are more, as z (r,).

    Each half is combined with half of the prior's precision. None if a half does not determine the parameters.
    """
    fit, counts = joint.fit, joint.counts
    pieces = len(fit.shares)
    first = sum(counts[: len(counts) // 2]) if len(counts) > 1 else pieces // 2
    rank = joint.measurement.equations.parameters.rank
    steps, covariances = [], []
    for half in (slice(0, first), slice(first, pieces)):
        part = fit.shares[half]
        scatter = sum(fit.scatter_shares[half], start=fit.prior.weight * fit.prior.precision / 2)
        precision = sum((schur for schur, _ in part), start=fit.prior.precision / 2)
        right = sum((g for _, g in part), start=-fit.prior.precision @ (fit.theta - fit.prior.mean) / 2)
        # What only the other half has, as an offset of its own, is not fitted.
        free = fit.free & (np.diag(precision) > 0)
        if not free[:rank].all():
            return None
        own = np.ix_(free, free)
        try:
            covariance = sandwich(precision[own], scatter[own])
        except ExcitationError:
            return None
        steps.append((inverse_of_precision(precision[own]) @ right[free])[:rank])
        covariances.append(covariance[:rank, :rank])
    return np.asarray((steps[0] - steps[1]) / np.sqrt(np.diag(covariances[0] + covariances[1])))


def widening(disagreement: float | None) -> float:
    """Factor on the standard deviations from the noise, max(1, z), for halves that differ by z; 1 without halves.

    This is Birge's ratio (Phys. Rev. 40, 207, 1932, doi:10.1103/PhysRev.40.207). For errors whose variance is φ times
    the stated one, and twelve independent differences, 95 % intervals hold in 96, 94, 93 and 93 % for φ = 1, 1.5, 2.5
    and 4: it costs 7 % of width where nothing is wrong.
    """
    return max(1.0, disagreement or 0.0)


def widenings(z: np.ndarray | None, wider: float, columns: int) -> np.ndarray:
    """Factors on the standard deviations of columns from the noise (m,).

    Halves of a parameter that differ beyond chance widen it by their own difference, if that is more: a moment that
    drifts moves the first moment of a base at rest and nothing else.

    Args:
        z: Differences of the first ones, the base parameters, as from `differences` (r,); None without halves.
        wider: Factor for the others, from `widening`.
        columns: Number m of columns.
    """
    out = np.full(columns, wider)
    if z is not None:
        beyond = -special.ndtri(SIGNIFICANT / 2 / len(z))
        out[: len(z)] = np.where(np.abs(z) > max(beyond, wider), np.abs(z), wider)
    return out


def disagreements(joint: TrajectoryEstimate) -> tuple[float, ...]:
    """Root mean square z of each recording's base parameters against those of the others; empty for one or two.

    The estimate θ of all and θ_k of all but one differ by `θ_k - θ = -(P - P_k)⁻¹ g_k`, and the right side g_k of the
    one at θ is `(1 - P_k P⁻¹) s_k - P_k P⁻¹ Σ_j≠k s_j`, with the right sides s of the recordings at the truth, whose
    covariance is that of their noise. What a recording has of its own passes for its noise, so that z is in standard
    deviations of the noise that the others have, if it has more. Empty as well if the parameters are not determined
    without one of the recordings.
    """
    if len(joint.counts) < 3:
        return ()
    rank, out = joint.measurement.equations.parameters.rank, []
    noise = np.log([each.channels for each in joint.fit.noises])
    for which in range(len(joint.counts)):
        try:
            theta, covariance = _difference(joint, which)
        except ExcitationError:
            return ()
        variances = np.maximum(np.diag(covariance)[:rank], LEAST_ADDED * np.diag(joint.fit.covariance)[:rank])
        louder = np.exp(max((noise[which] - np.median(np.delete(noise, which, axis=0), axis=0)).mean(), 0.0))
        out.append(float(louder * np.sqrt(((theta - joint.fit.theta)[:rank] ** 2 / variances).mean())))
    return tuple(out)


def without(joint: TrajectoryEstimate, which: int) -> np.ndarray:
    """Parameters without one of the recordings (p,).

    Raises:
        ExcitationError: The others do not determine them.
    """
    return left_out.without(joint.fit, joint.pieces_of(which))[0]


def _difference(joint: TrajectoryEstimate, which: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters without one of the recordings (p,), and the covariance of their difference from those of all (p, p).

    Raises:
        ExcitationError: The others do not determine them.
    """
    fit, own = joint.fit, joint.pieces_of(which)
    theta, inverse, free = left_out.without(fit, own)
    each = np.ix_(free, free)
    schur = np.sum([schur for schur, _ in fit.shares[own]], axis=0)[each]
    scatter = np.sum(fit.scatter_shares[own], axis=0)[each]
    # The recording's right side is its own noise's, less what all noise has moved the estimate by. Of recordings alike,
    # what repeats in all of them cancels.
    moved = schur @ inverse_of_precision(fit.precision[each])
    apart, others = np.eye(len(moved)) - moved, fit.scatter - sum(fit.scatter_shares[len(fit.shares) :])
    noise = apart @ scatter @ apart.T + moved @ (others[each] - scatter) @ moved.T
    return theta, embedded(inverse @ noise @ inverse, free)


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Worded):
    """The difference between two estimates from recordings of their own.

    Attributes:
        names: Names of the r base parameters.
        difference: First less second ψ (r,).
        covariance: Its covariance, the sum of both (r, r).
        bodies: Names of the bodies.
    """

    names: tuple[str, ...]
    difference: np.ndarray
    covariance: np.ndarray
    bodies: tuple[str, ...] = ()

    @property
    def z(self) -> np.ndarray:
        """Each difference in its standard deviations (r,)."""
        return self.difference / np.sqrt(np.diag(self.covariance))

    @property
    def chi2(self) -> float:
        """Squared Mahalanobis distance, distributed as χ² with r degrees of freedom if nothing but noise differs."""
        return float(self.difference @ np.linalg.solve(self.covariance, self.difference))

    @property
    def p_value(self) -> float:
        """Chance of a distance at least as large, if nothing but noise differs."""
        return float(special.chdtrc(len(self.names), self.chi2))

    @property
    def order(self) -> np.ndarray:
        """Parameters in descending order of |z| (r,)."""
        return np.argsort(-np.abs(self.z), kind="stable")

    @property
    def differs(self) -> bool:
        """True if the difference is more than noise."""
        return self.p_value < UNLIKELY

    def __str__(self) -> str:
        largest = "; ".join(f"{name} by {by} ± {std} {unit} (z {z})" for name, by, std, unit, z in self._rows(MOST))
        p = f"p {self.p_value:.2g}" if self.p_value else "p below 1e-300"
        how = "more" if self.differs else "no more"
        return (
            f"χ² is {self.chi2:.1f} of {len(self.names)} parameters ({p}), {how} than noise explains. "
            f"The largest differences, ± one standard deviation: {largest}."
        )

    def _rows(self, most: int | None = None) -> Iterator[tuple[str, ...]]:
        """Parameter, difference, its standard deviation, unit and z, the largest first."""
        for k in self.order[:most]:
            by, std = rounded(self.difference[k], float(np.sqrt(self.covariance[k, k])))
            by = by if by.startswith("-") else f"+{by}"
            unit = unit_of(self.names[k]) or ""
            yield with_bodies([self.names[k]], self.bodies), by, std, unit, f"{self.z[k]:+.1f}"

    def _repr_html_(self) -> str:
        heads = ("parameter", "difference", "s.d.", "unit", "z")
        sentence = escape(str(self).partition(" The largest")[0])
        return f"<div><p>{sentence}</p>{html_table(heads, self._rows(), (1, 2, 4))}</div>"


def compared(first: Fit, second: Fit) -> Comparison:
    """Compares the base parameters of two fits.

    Raises:
        InputError: They are not of the same base parameters.
    """
    names = first.parameters.names
    if names != second.parameters.names:
        raise InputError(
            f"Estimates of the same base parameters can be compared, got {', '.join(names)} and "
            f"{', '.join(second.parameters.names)}."
        )
    r = len(names)
    covariance = first.covariance[:r, :r] + second.covariance[:r, :r]
    return Comparison(names, first.psi - second.psi, covariance, first.equations.mechanism.bodies)
