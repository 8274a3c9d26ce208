"""What is known of bodies before anything is measured: φ of the model, give or take."""

from collections.abc import Mapping

import numpy as np

from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters

KNOWN = {"mass": 0.2, "center": 0.05, "inertia": 0.3}
"""How well a model knows its bodies: masses to a fifth, centres of mass to 50 mm, inertias to 30 %."""

LEAST_KNOWN = 1e-6
"""Standard deviations of ψ below this fraction of the largest of their unit are raised to it."""


def known_deviations(phi: np.ndarray, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Standard deviations with which a model's φ is known before anything is measured.

    They are a fifth of the mass, 50 mm times the mass, and 30 % of √(I_aa I_bb), products of inertia included; a body
    without mass is known to have none.

    Args:
        phi: φ of the bodies, stacked (10 b,).
        known: Relative deviation of masses, that of centres of mass in m, relative deviation of inertias.

    Returns:
        Standard deviations in kg, kg m and kg m² (10 b,).
    """
    bodies = abs(phi.reshape(-1, 10))
    mass, root = bodies[:, :1], np.sqrt(bodies[:, 4:7])
    inertias = root[:, [0, 1, 2, 0, 0, 1]] * root[:, [0, 1, 2, 1, 2, 2]]
    centers = np.repeat(known["center"] * mass, 3, axis=1)
    return np.hstack([known["mass"] * mass, centers, known["inertia"] * inertias]).ravel()


def known_covariance(
    mechanism: Mechanism, parameters: BaseParameters, known: Mapping[str, float] = KNOWN
) -> np.ndarray:
    """Covariance of ψ as it is known beforehand, `B S Bᵀ` with ψ = B φ and S that of φ (r, r).

    The mechanism's own deviations come before those of `known`.
    """
    std = known_deviations(mechanism.known, known)
    if mechanism.prior_std is not None:
        std = np.where(np.isfinite(mechanism.prior_std), mechanism.prior_std, std)
    B = parameters.regroup(np.diag(std))
    covariance = B.T @ B
    return covariance + np.diag(LEAST_KNOWN**2 * np.full(len(covariance), np.diag(covariance).max(initial=1e-12)))
