"""Agreement of two estimates of one mechanism."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from ident.errors import InputError
from ident.geometry.inertia import with_bodies
from ident.regression.ordinary import Fit


@dataclass(frozen=True, eq=False)
class Comparison:
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

    def __str__(self) -> str:
        order = np.argsort(-np.abs(self.z), kind="stable")[:5]
        named = (with_bodies([self.names[k]], self.bodies) for k in order)
        differ = (f"by {self.difference[k]:+.3g} (z {self.z[k]:+.1f})" for k in order)
        largest = ", ".join(f"{name} {how}" for name, how in zip(named, differ, strict=True))
        return f"χ² {self.chi2:.1f} of {len(self.names)} parameters (p {self.p_value:.2g}); most differ {largest}."


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
