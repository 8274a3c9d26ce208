"""Knowledge of bodies before anything is measured: φ of the model, give or take.

A body is given by its mass, its centre of mass and its inertia about that, which err independently of each other:

    m = m_0 (1 + α ξ),    c = c_0 + s γ,    I_c = I_0 + κ √I_0 E √I_0

with ξ and γ standard normal, and E symmetric with independent normal entries, of variance 1 on the diagonal and 1/2
beside it, so that the moment of inertia about every axis through the centre of mass is known to the share κ. Deviations
of φ follow: with the centre of mass, the first moments and the inertia about the frame's origin change together.
"""

from collections.abc import Mapping

import numpy as np

from ident.arguments import OF_BODIES, checked_deviations
from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters

KNOWN = {"mass": 0.2, "center": 0.05, "inertia": 0.3}
"""How well a model knows its bodies: masses to a fifth, centres of mass to 50 mm, inertias to 30 %."""

LEAST_KNOWN = 1e-6
"""Standard deviations of ψ below this fraction of the largest of their unit are raised to it."""


def body_covariance(phi: np.ndarray, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Mean squares and products of a body's deviations from a model's φ, the matrix C (10, 10).

    They are exact, second order included: around a centre of mass at the origin of the frame the inertia about that
    changes with the square of the centre's deviation alone. With the pseudo-inertia J = [[Σ, 0], [0, 0]] + m x xᵀ of a
    body, x = [c; 1], X = x_0 x_0ᵀ and V = diag(s², s², s², 0), the moments of normal variables (Isserlis, Biometrika
    12, 1918, doi:10.2307/2331932) give

        E[δJ_ij δJ_kl] = m_0² [α² P_ij P_kl + V_ij V_kl + (1 + α²) (P_ik P_jl - X_ik X_jl + P_il P_jk - X_il X_jk)]

    with P = X + V; the inertia about the centre of mass adds κ²/2 (I_ik I_jl + I_il I_jk) to products of inertias. In
    another frame φ_a = A φ_b the matrix is A C Aᵀ. The deviations have a mean, 2 m_0 s² in each moment of inertia;
    C contains its square, as it is about the model's φ, the prior's mean. A body without mass is known to have none.

    Args:
        phi: φ of a body (10,).
        known: α, relative deviation of the mass; s, deviation of the centre of mass along each axis in m; κ, relative
            deviation of inertias about the centre of mass.

    Returns:
        C in products of kg, kg m and kg m² (10, 10).

    Raises:
        InputError: Something else is known, or by no number from zero.
    """
    known = {**KNOWN, **checked_deviations("known", known, OF_BODIES)}
    mass, x = phi[0], np.append(phi[1:4] / phi[0], 1.0) if phi[0] else np.array([0.0, 0, 0, 1])
    X, V = np.outer(x, x), known["center"] ** 2 * np.diag([1.0, 1, 1, 0])
    P, a = X + V, known["mass"] ** 2
    # P_ik P_jl - X_ik X_jl without the difference of what is nearly equal.
    crossed = _crossed(V, P) + _crossed(X, V)
    products = a * _product(P, P) + _product(V, V) + (1 + a) * (crossed + crossed.swapaxes(2, 3))
    moved = parameters_from_pseudo_inertia(np.moveaxis(parameters_from_pseudo_inertia(products), 2, 0))
    return mass**2 * moved + _central(pseudo_inertia(phi) - mass * X, known["inertia"])


def _central(J: np.ndarray, relative: float) -> np.ndarray:
    """Covariance that the inertia about the centre of mass adds, by the pseudo-inertia about that (10, 10)."""
    second = J[:3, :3]
    values, axes = np.linalg.eigh(np.trace(second) * np.eye(3) - second)
    # As large as it is stated, where a model's body is not physical.
    inertia = (axes * np.abs(values)) @ axes.T
    crossed = _crossed(inertia, inertia)
    row, column = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    out = np.zeros((10, 10))
    out[4:, 4:] = relative**2 / 2 * (crossed + crossed.swapaxes(2, 3))[row, column][:, row, column]
    return out


def _product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """`A_ij B_kl`."""
    return A[:, :, None, None] * B


def _crossed(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """`A_ik B_jl`."""
    return A[:, None, :, None] * B[:, None, :]


def known_covariances(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """`body_covariance` of all bodies, with the mechanism's own deviations before those of `known` (b, 10, 10)."""
    known = checked_deviations("known", known, OF_BODIES)
    bodies = zip(mechanism.bodies, mechanism.known.reshape(-1, 10), strict=True)
    return np.array([body_covariance(phi, {**known, **mechanism.prior_known.get(name, {})}) for name, phi in bodies])


def known_deviations(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Standard deviations with which φ of all bodies is known beforehand, in kg, kg m and kg m² (10 b,)."""
    return np.sqrt(np.diagonal(known_covariances(mechanism, known), axis1=1, axis2=2)).ravel()


def known_rows(mechanism: Mechanism, parameters: BaseParameters, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """A root R of what is known of ψ beforehand, `B S Bᵀ = Rᵀ R` with ψ = B φ and S that of φ (10 b, r)."""
    return (known_roots(mechanism, known) @ _of_bodies(parameters)).reshape(-1, parameters.rank)


def known_roots(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Roots of `known_covariances`, C = Rᵀ R (b, 10, 10)."""
    values, axes = np.linalg.eigh(known_covariances(mechanism, known))
    return np.sqrt(np.maximum(values, 0))[:, :, None] * axes.swapaxes(1, 2)


def known_covariance(
    mechanism: Mechanism, parameters: BaseParameters, known: Mapping[str, float] = KNOWN
) -> np.ndarray:
    """Covariance of ψ as it is known beforehand, `B S Bᵀ` with ψ = B φ and S that of φ (r, r)."""
    rows = known_rows(mechanism, parameters, known)
    covariance = rows.T @ rows
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
    S, K = known_covariances(mechanism, known), known_covariance(mechanism, parameters, known)
    G = np.linalg.solve(K, (S @ _of_bodies(parameters)).reshape(-1, parameters.rank).T).T
    phi = mechanism.known + G @ (psi - parameters.regroup(mechanism.known))
    variance = np.diagonal(S, axis1=1, axis2=2).ravel() - np.einsum("pr,rs,ps->p", G, K - covariance, G)
    return phi, np.sqrt(np.maximum(variance, 0))


def updated(
    mechanism: Mechanism,
    parameters: BaseParameters,
    psi: np.ndarray,
    covariance: np.ndarray,
    known: Mapping[str, float] = KNOWN,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate and covariance of ψ once what is known beforehand is put in, as `conditioned` takes them.

    Args:
        mechanism: The mechanism with the prior φ_0.
        parameters: Its base parameters.
        psi: Their estimate from the data alone (r,).
        covariance: Covariance of that (r, r).
        known: How well the prior is known.

    Returns:
        ψ (r,), and its covariance (r, r).
    """
    K, before = known_covariance(mechanism, parameters, known), parameters.regroup(mechanism.known)
    gain = np.linalg.solve(K + covariance, K).T
    return before + gain @ (psi - before), K - gain @ K


def parameters_told(
    mechanism: Mechanism,
    parameters: BaseParameters,
    covariance: np.ndarray,
    known: Mapping[str, float] = KNOWN,
    *,
    included: bool = False,
) -> np.ndarray:
    """Number of its ten parameters that data tell of each body, beyond what is known of it beforehand.

        P = S - G (K - C') Gᵀ,    K = B S Bᵀ,    G = S Bᵀ K⁻¹,    C' = K - K (K + C)⁻¹ K

    S is the covariance of φ beforehand, P that afterwards, C that of ψ = B φ from the data. A body counts the trace of
    1 - S⁻¹ P of its own parameters: nothing where the data leave it as it was, ten where they tell all of it, and all
    bodies together the degrees of freedom for signal of Rodgers (Inverse Methods for Atmospheric Sounding, 2000,
    doi:10.1142/3171), no more than there are base parameters.

    Args:
        mechanism: The mechanism, with a prior.
        parameters: The regrouping behind ψ.
        covariance: Covariance of ψ (r, r).
        known: As for `body_covariance`.
        included: Whether that covariance knows already what is known beforehand, so that it is C'.

    Returns:
        Numbers from 0 to 10 (b,).
    """
    S, K = known_covariances(mechanism, known), known_covariance(mechanism, parameters, known)
    # S⁻¹ G = Bᵀ K⁻¹, also where S is singular.
    B = _of_bodies(parameters)
    gains = np.linalg.solve(K, B.reshape(-1, parameters.rank).T).T.reshape(B.shape)
    after = covariance if included else K - K @ np.linalg.solve(K + covariance, K)
    told = np.einsum("bij,bkj,bki->b", gains @ (K - after), gains, S)
    return np.clip(told, 0, 10)


def _of_bodies(parameters: BaseParameters) -> np.ndarray:
    """Bᵀ of ψ = B φ, body by body (b, 10, r)."""
    return parameters.regroup(np.eye(len(parameters.parameters))).reshape(-1, 10, parameters.rank)
