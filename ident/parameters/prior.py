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
    std, G, K = _gain(mechanism, parameters, known)
    phi = mechanism.known + std * (G @ (psi - parameters.regroup(mechanism.known)))
    variance = 1 - np.einsum("pr,rs,ps->p", G, K - covariance, G)
    return phi, std * np.sqrt(np.maximum(variance, 0))


def _gain(
    mechanism: Mechanism, parameters: BaseParameters, known: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deviations of φ beforehand (10 b,), G in units of them (10 b, r), and B S Bᵀ (r, r)."""
    std, K = deviations(mechanism, known), known_covariance(mechanism, parameters, known)
    return std, np.linalg.solve(K, parameters.regroup(np.diag(std)).T).T, K


def parameters_told(
    mechanism: Mechanism,
    parameters: BaseParameters,
    covariance: np.ndarray,
    known: Mapping[str, float] = KNOWN,
    *,
    included: bool = False,
) -> np.ndarray:
    """How many of its ten parameters data tell of each body, beyond what is known of it beforehand.

        P = S - G (K - C') Gᵀ,    K = B S Bᵀ,    G = S Bᵀ K⁻¹,    C' = K - K (K + C)⁻¹ K

    S is the covariance of φ beforehand, P that afterwards, C that of ψ = B φ from the data. Each parameter counts
    1 - P_kk / S_kk: nothing where the data leave it as it was, one where they tell all of it, as the degrees of freedom
    for signal of Rodgers (Inverse Methods for Atmospheric Sounding, 2000, doi:10.1142/3171).

    Args:
        mechanism: The mechanism, with a prior.
        parameters: The regrouping behind ψ.
        covariance: Covariance of ψ (r, r).
        known: As for `known_deviations`.
        included: Whether that covariance knows already what is known beforehand, so that it is C'.

    Returns:
        Numbers from 0 to 10 (b,).
    """
    _, G, K = _gain(mechanism, parameters, known)
    after = covariance if included else K - K @ np.linalg.solve(K + covariance, K)
    told = np.einsum("ki,ij,kj->k", G, K - after, G)
    return np.clip(told, 0, 1).reshape(-1, 10).sum(axis=1)
