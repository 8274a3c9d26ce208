"""Prior of bodies: φ of the model, with a covariance.

A body is given by its mass, its centre of mass and its inertia about that, whose errors are independent:

    m = m_0 (1 + α ξ),    c = c_0 + s γ,    I_c = I_0 + κ √I_0 E √I_0

with ξ and γ standard normal, and E symmetric with independent normal entries, of variance 1 on the diagonal and 1/2
beside it, so that the moment of inertia about every axis through the centre of mass has the relative deviation κ.
Deviations of φ follow: first moments and inertia about the frame's origin both depend on the centre of mass.

Bodies whose mass a model does not state have a guess in its place.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ident.arguments import OF_BODIES, checked_deviations
from ident.geometry.inertia import entries, parameters_from_com, parameters_from_pseudo_inertia, pseudo_inertia
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.model.axes import column_place, stated_values
from ident.parameters.base_parameters import BaseParameters
from ident.tolerances import ROUNDING

SMALLEST = 0.1
"""Size of a body that no model states, in a mechanism without lengths, and typical radius of gyration of a payload and
distance of its centre of mass from the sensor, m."""

UNKNOWN = 100.0
"""Standard deviation of a drive that no model states, over that of all bodies together: as good as no prior."""

OPEN = 3.0
"""Relative standard deviation of the mass and inertia of a body that no model states, over those of the others: wider
by far than data leave them, and narrow enough to leave what is known of other bodies its digits."""

LEAST_KNOWN = 1e-6
"""Standard deviation, relative to the largest, that is added to all of ψ to keep the covariance regular."""


def unstated(mechanism: Mechanism) -> np.ndarray:
    """Mask of the bodies that joints move and whose mass no model states, alone or with what is welded to them (b,).

    Where other moving bodies have mass, a massless one at whose very joint the next one turns is a link of a compound
    joint, whose zero is meant; so is that of welded frames.
    """
    tree, masses = mechanism.tree, mechanism.known[::10]
    carriers, together = _carriers(tree), np.zeros(len(tree.bodies))
    np.add.at(together, [carriers[i] for i in tree.inertial], masses)
    moving = {i for i in tree.inertial if tree.bodies[i].moves}
    compound = {
        carriers[body.parent]
        for body in tree.bodies
        if body.moves and body.parent >= 0 and not np.any(abs(body.home[:3, 3]) > ROUNDING)
    }
    if not any(together[i] for i in moving):
        compound = set()
    return np.array([i in moving and not together[i] and i not in compound for i in tree.inertial])


def _carriers(tree: Tree) -> list[int]:
    """Index of the moving body that each body is welded to, its own if it moves, or of the first on the base (b,)."""
    carriers = list[int]()
    for i, body in enumerate(tree.bodies):
        carriers.append(i if body.moves or body.parent < 0 else carriers[body.parent])
    return carriers


def guessed(mechanism: Mechanism) -> np.ndarray:
    """The model's φ, with balls between their joint and the next for bodies whose mass it does not state (10 b,)."""
    phi, tree = mechanism.known.reshape(-1, 10).copy(), mechanism.tree
    usual = float(np.mean(phi[phi[:, 0] > 0, 0])) if phi[:, 0].any() else 1.0
    lengths = [float(np.linalg.norm(body.home[:3, 3])) for body in tree.bodies]
    typical = max(float(np.mean([x for x in lengths if x > 0] or [0])), SMALLEST)
    for k in np.flatnonzero(unstated(mechanism)).tolist():
        on_it = [each.home[:3, 3] for each in tree.bodies if each.parent == tree.inertial[k]]
        center = max(on_it, key=np.linalg.norm, default=np.zeros(3)) / 2
        size = max(2 * float(np.linalg.norm(center)), typical)
        phi[k] = parameters_from_com(usual, center, usual * size**2 / 10 * np.eye(3))
    return phi.ravel()


KNOWN = {"mass": 0.2, "center": 0.05, "inertia": 0.3}
"""Default standard deviations of a model's bodies: masses 20 %, centres of mass 50 mm, inertias 30 %."""


def body_covariance(phi: np.ndarray, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Matrix C of mean squares and products of a body's deviations from a model's φ (10, 10).

    It is exact, including second order: for a centre of mass at the origin of the frame, the inertia about the origin
    changes with the square of the centre's deviation only. With the pseudo-inertia J = [[Σ, 0], [0, 0]] + m x xᵀ of a
    body, x = [c; 1], X = x_0 x_0ᵀ and V = diag(s², s², s², 0), the moments of normal variables (Isserlis, Biometrika
    12, 1918, doi:10.2307/2331932) give

        E[δJ_ij δJ_kl] = m_0² [α² P_ij P_kl + V_ij V_kl + (1 + α²) (P_ik P_jl - X_ik X_jl + P_il P_jk - X_il X_jk)]

    with P = X + V; the inertia about the centre of mass adds κ²/2 (I_ik I_jl + I_il I_jk) to products of inertias. In
    another frame φ_a = A φ_b the matrix is A C Aᵀ. The deviations have a mean, 2 m_0 s² in each moment of inertia; C
    contains its square, as it is about the model's φ, the prior's mean. For a massless body C is zero.

    Args:
        phi: φ of a body (10,).
        known: α, relative deviation of the mass; s, deviation of the centre of mass along each axis in m; κ, relative
            deviation of inertias about the centre of mass.

    Returns:
        C in products of kg, kg m and kg m² (10, 10).

    Raises:
        InputError: `known` has an unknown key, or a value that is no number from zero.
    """
    known = {**KNOWN, **checked_deviations("known", known, OF_BODIES)}
    mass, x = phi[0], np.append(phi[1:4] / phi[0], 1.0) if phi[0] else np.array([0.0, 0, 0, 1])
    X, V = np.outer(x, x), known["center"] ** 2 * np.diag([1.0, 1, 1, 0])
    P, a = X + V, known["mass"] ** 2
    # P_ik P_jl - X_ik X_jl without cancellation.
    crossed = _crossed(V, P) + _crossed(X, V)
    products = a * np.multiply.outer(P, P) + np.multiply.outer(V, V) + (1 + a) * (crossed + crossed.swapaxes(2, 3))
    moved = parameters_from_pseudo_inertia(np.moveaxis(parameters_from_pseudo_inertia(products), 2, 0))
    return mass**2 * moved + _central(pseudo_inertia(phi) - mass * X, known["inertia"])


def _central(J: np.ndarray, relative: float) -> np.ndarray:
    """Contribution of the inertia about the centre of mass, from the pseudo-inertia about that (10, 10)."""
    second = J[:3, :3]
    values, axes = np.linalg.eigh(np.trace(second) * np.eye(3) - second)
    # Absolute values, for bodies of a model that are not physical.
    inertia = (axes * np.abs(values)) @ axes.T
    crossed = _crossed(inertia, inertia)
    out = np.zeros((10, 10))
    out[4:, 4:] = relative**2 / 2 * entries(np.moveaxis(entries(crossed + crossed.swapaxes(2, 3)), 2, 0))
    return out


def _crossed(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """`A_ik B_jl`."""
    return A[:, None, :, None] * B[:, None, :]


def known_covariances(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """`body_covariance` of all bodies; the mechanism's own deviations take precedence over `known` (b, 10, 10).

    Bodies of which the model states no mass may be several times as heavy as the others, and are not known to be zero.
    """
    known = checked_deviations("known", known, OF_BODIES)
    out, bodies = [], guessed(mechanism).reshape(-1, 10)
    for name, phi, new in zip(mechanism.bodies, bodies, unstated(mechanism), strict=True):
        if new:
            size = float(np.sqrt(phi[4:7].sum() / phi[0]))
            out.append(body_covariance(phi, {"mass": OPEN, "center": size, "inertia": OPEN}) + np.outer(phi, phi))
        else:
            out.append(body_covariance(phi, {**known, **mechanism.prior_known.get(name, {})}))
    return np.array(out)


def known_deviations(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Prior standard deviations of φ of all bodies, in kg, kg m and kg m² (10 b,)."""
    return np.sqrt(np.diagonal(known_covariances(mechanism, known), axis1=1, axis2=2)).ravel()


def known_rows(mechanism: Mechanism, parameters: BaseParameters, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """A root R of the prior covariance of ψ, `B S Bᵀ = Rᵀ R` with ψ = B φ and S that of φ (10 b, r)."""
    return (known_roots(mechanism, known) @ _of_bodies(parameters)).reshape(-1, parameters.rank)


def known_roots(mechanism: Mechanism, known: Mapping[str, float] = KNOWN) -> np.ndarray:
    """Roots of `known_covariances`, C = Rᵀ R (b, 10, 10)."""
    values, axes = np.linalg.eigh(known_covariances(mechanism, known))
    return np.sqrt(np.maximum(values, 0))[:, :, None] * axes.swapaxes(1, 2)


def known_covariance(
    mechanism: Mechanism,
    parameters: BaseParameters,
    known: Mapping[str, float] = KNOWN,
    absorbed: Mapping[str, np.ndarray] | None = None,
) -> np.ndarray:
    """Prior covariance of ψ, `B S Bᵀ` with ψ = B φ and S that of φ (r, r).

    Args:
        mechanism: The mechanism.
        parameters: Its base parameters.
        known: Standard deviations of φ, as for `body_covariance`.
        absorbed: Drives that ψ contains, as `Equations.absorbed`: known to their own size where the model states
            them, as by `drive_precision`, else not at all.
    """
    rows = known_rows(mechanism, parameters, known)
    covariance = rows.T @ rows
    covariance += np.diag(LEAST_KNOWN**2 * np.full(len(covariance), np.diag(covariance).max(initial=1e-12)))
    for name, each in (absorbed or {}).items():
        own, (stated,) = each[: parameters.rank], stated_values(mechanism, [name])
        if not own.any():  # The drive of a joint that rests is in no parameter.
            continue
        unknown = UNKNOWN * float(np.linalg.norm(rows)) / max(float(np.linalg.norm(own)), 1e-300)
        covariance += np.outer(own, own) * (stated or unknown) ** 2
    return covariance


def drive_precision(mechanism: Mechanism, names: Sequence[str], scaled: Collection[str] = ()) -> np.ndarray:
    """Prior precision of the drives of some columns, zero where the model states none (d,).

    Their standard deviations are the model's values, which are often a guess: a Go2's calves have rotors of twice, and
    friction of several times, what its model states. With half of them, weighted up with the bodies' prior, two of them
    are predicted with .24 and .33 of their torques instead of .21 and .27.

    Args:
        mechanism: The mechanism.
        names: Names of the columns.
        scaled: Joints whose torques have an uncertain scale, without a prior: drives that models state are often mere
            guesses, and beside light links they would fix the scale.
    """
    values = stated_values(mechanism, names) * [column_place(name)[1] not in scaled for name in names]
    return np.where(values > 0, 1 / np.where(values > 0, values, 1) ** 2, 0.0)


def conditioned(
    mechanism: Mechanism,
    parameters: BaseParameters,
    psi: np.ndarray,
    covariance: np.ndarray,
    known: Mapping[str, float] = KNOWN,
    *,
    included: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Posterior of all parameters φ, from their prior and an estimate of ψ = B φ.

        φ̂ = φ_0 + G (ψ̂ - B φ_0),     S - G (B S Bᵀ - C) Gᵀ,     G = S Bᵀ (B S Bᵀ)⁻¹

    The bodies may not be physical; `ident.parameters.consistency` ensures that.

    Args:
        mechanism: The mechanism with the prior φ_0.
        parameters: Its base parameters.
        psi: Their estimate ψ̂ (r,).
        covariance: Its covariance C (r, r).
        known: Standard deviations of the prior, for S, as for `body_covariance`.
        included: True if the estimate includes the prior; from one of the data alone follows that first.

    Returns:
        φ̂ (10 b,), and its standard deviations (10 b,).
    """
    S, K = known_covariances(mechanism, known), known_covariance(mechanism, parameters, known)
    G = np.linalg.solve(K, (S @ _of_bodies(parameters)).reshape(-1, parameters.rank).T).T
    before = parameters.regroup(mechanism.known)
    if not included:
        gain = np.linalg.solve(K + covariance, K).T
        psi, covariance = before + gain @ (psi - before), K - gain @ K
    phi = mechanism.known + G @ (psi - before)
    variance = np.diagonal(S, axis1=1, axis2=2).ravel() - np.einsum("pr,rs,ps->p", G, K - covariance, G)
    return phi, np.sqrt(np.maximum(variance, 0))


def parameters_identified(
    mechanism: Mechanism,
    parameters: BaseParameters,
    covariance: np.ndarray,
    known: Mapping[str, float] = KNOWN,
    *,
    included: bool = False,
) -> np.ndarray:
    """Number of the ten parameters of each body that the data determine, beyond the prior.

        P = S - G (K - C') Gᵀ,    K = B S Bᵀ,    G = S Bᵀ K⁻¹,    C' = K - K (K + C)⁻¹ K

    S is the prior covariance of φ, P the posterior one, C that of ψ = B φ from the data. The number of a body is the
    trace of 1 - S⁻¹ P over its own parameters: zero if the data add nothing, ten if they determine all. The sum over
    all bodies is the degrees of freedom for signal of Rodgers (Inverse Methods for Atmospheric Sounding, 2000,
    doi:10.1142/3171), at most the number of base parameters.

    Args:
        mechanism: The mechanism, with a prior.
        parameters: The regrouping behind ψ.
        covariance: Covariance of ψ (r, r).
        known: As for `body_covariance`.
        included: True if that covariance includes the prior, so that it is C'.

    Returns:
        Numbers from 0 to 10 (b,).
    """
    S, K = known_covariances(mechanism, known), known_covariance(mechanism, parameters, known)
    # S⁻¹ G = Bᵀ K⁻¹, also where S is singular.
    B = _of_bodies(parameters)
    gains = np.linalg.solve(K, B.reshape(-1, parameters.rank).T).T.reshape(B.shape)
    after = covariance if included else K - K @ np.linalg.solve(K + covariance, K)
    return np.clip(np.einsum("bij,bkj,bki->b", gains @ (K - after), gains, S), 0, 10)


def _of_bodies(parameters: BaseParameters) -> np.ndarray:
    """Bᵀ of ψ = B φ, body by body (b, 10, r)."""
    return parameters.regroup(np.eye(len(parameters.parameters))).reshape(-1, 10, parameters.rank)
