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


def deviations(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Standard deviations of a mechanism's φ: its own where it has any, otherwise as `known_deviations` (10 b,)."""
    std = known_deviations(mechanism.known, known)
    return std if mechanism.prior_std is None else np.where(np.isfinite(mechanism.prior_std), mechanism.prior_std, std)


def known_covariance(
    mechanism: Mechanism, parameters: BaseParameters, known: Mapping[str, float] = KNOWN
) -> np.ndarray:
    """Covariance of ψ as it is known beforehand, `B S Bᵀ` with ψ = B φ and S that of φ (r, r).

    The mechanism's own deviations come before those of `known`.
    """
    B = parameters.regroup(np.diag(deviations(mechanism, known)))
    covariance = B.T @ B
    return covariance + np.diag(LEAST_KNOWN**2 * np.full(len(covariance), np.diag(covariance).max(initial=1e-12)))


def conditioned(
    mechanism: Mechanism,
    parameters: BaseParameters,
    psi: np.ndarray,
    covariance: np.ndarray,
    known: Mapping[str, float] = KNOWN,
) -> tuple[np.ndarray, np.ndarray]:
    """All parameters φ from what was known of them and what an estimate that had it for a prior says of ψ = B φ.

        φ̂ = φ_0 + G (ψ̂ - B φ_0),     S - G (B S Bᵀ - C) Gᵀ,     G = S Bᵀ (B S Bᵀ)⁻¹

    Nothing keeps bodies physical; `ident.parameters.consistency` does.

    Args:
        mechanism: The mechanism with the prior φ_0.
        parameters: Its base parameters.
        psi: Their estimate, the prior included (r,).
        covariance: C of that (r, r).
        known: How well the prior is known, which makes S.

    Returns:
        φ̂ (10 b,), and its standard deviations (10 b,).
    """
    std = deviations(mechanism, known)
    SB = (std**2)[:, None] * parameters.regroup(np.eye(len(std)))
    whole = known_covariance(mechanism, parameters, known)
    G = np.linalg.solve(whole, SB.T).T
    phi = mechanism.known + G @ (psi - parameters.regroup(mechanism.known))
    variance = std**2 - np.einsum("pr,rs,ps->p", G, whole - covariance, G)
    return phi, np.sqrt(np.maximum(variance, 0))
