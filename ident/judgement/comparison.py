"""Agreement of two estimates of one mechanism."""

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

import numpy as np
from scipy import special

from ident.display.brief import Worded
from ident.display.html import table
from ident.display.text import rounded
from ident.errors import InputError
from ident.estimation.units import unit_of
from ident.geometry.inertia import with_bodies
from ident.regression.ordinary import Fit

UNLIKELY = 0.01
"""p-value of χ² below which a difference is called more than noise."""

MOST = 5
"""Number of parameters that a sentence names."""


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
        return (
            f"<div><p>{escape(str(self).partition(' The largest')[0])}</p>{table(heads, self._rows(), (1, 2, 4))}</div>"
        )


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
