"""Physically consistent full parameters: the bodies closest to a prior that fit estimated base parameters.

    minimise   d²/2 + D/w²    over pseudo-inertias J,

    d² = (Aφ - ψ)ᵀ C⁻¹ (Aφ - ψ),    D = Σ_i tr(J_i P_i⁻¹) - log det(J_i P_i⁻¹) - 4,    φ ~ J,    prior ~ P.

`d` is the Mahalanobis distance from the base parameters ψ with their covariance C, and D the log-determinant
divergence from the prior. w is the width of the prior: bodies scatter around it by w times their own size, as D is half
the squared distance in these units. It is estimated from ψ, whose distance from the prior's own base parameters is
likely for some widths only (empirical Bayes).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.annotations import typed
from ident.display.brief import Brief, listed
from ident.errors import InputError
from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.nearest_bodies import ROOM, NearestBodies, region

LOOSER = 1.0, 2.0, 4.0
"""Factors by which the deviation of hardly identifiable masses is increased if the bodies do not fit ψ otherwise."""


@dataclass(frozen=True, eq=False, repr=False)
class ConsistentParameters(Brief):
    """Full parameters of physical bodies, and their fit to the given base parameters.

    Attributes:
        phi: φ of all bodies, every pseudo-inertia positive definite (10 b,).
        psi: Their base parameters (r,).
        names: Names of the base parameters (r,).
        attainable: True if `psi` is in the 95 % confidence region of the given ψ.
        distance: Mahalanobis distance of `psi` from the given ψ, in the metric of its covariance.
        shift: `psi` less the given ψ, in standard deviations (r,).
        divergence: Divergence of each body from its prior, `tr(J P⁻¹) - log det(J P⁻¹) - 4` (b,).
        mass_std: Standard deviation of each body's mass from ψ, with a prior as wide as the size of each body, so that
            it equals the mass if ψ does not depend on it, kg (b,).
        prior: φ of the prior, made physical (10 b,).
        raised: Bodies, counted from 0, whose prior was not physical and had to be raised.
        bodies: Names of the bodies, if they have any.
    """

    phi: np.ndarray
    psi: np.ndarray
    names: tuple[str, ...]
    attainable: bool
    distance: float
    shift: np.ndarray
    divergence: np.ndarray
    mass_std: np.ndarray
    prior: np.ndarray
    raised: tuple[int, ...]
    bodies: tuple[str, ...] = ()

    @property
    def _in_short(self) -> dict[str, object]:
        names = self.bodies or [f"body {k}" for k in range(1, 1 + len(self.phi) // 10)]
        masses = (f"{name} {mass:.3g}" for name, mass in zip(names, self.phi[::10].tolist(), strict=True))
        moved = f"{self.distance:.1f} standard deviations from the estimate, " + "not " * (not self.attainable)
        return {"masses (kg)": listed(masses), "base parameters": f"{moved}within its 95 % region"}

    @property
    def unseen(self) -> np.ndarray:
        """Mask of bodies whose mass is hardly identifiable: its 95 % interval reaches a factor of two (b,)."""
        return np.asarray(2 * self.mass_std >= np.log(2) * self.phi[::10])

    def moved(self, least: float = 0.01) -> tuple[tuple[str, float], ...]:
        """Names of the base parameters that had to move, and their shifts in standard deviations, largest first.

        Args:
            least: Standard deviations below which a parameter counts as unchanged.
        """
        order = np.argsort(-np.abs(self.shift), kind="stable")
        return tuple((self.names[k], float(self.shift[k])) for k in order if abs(self.shift[k]) >= least)


@typed()
def consistent_parameters(
    psi: np.ndarray,
    covariance: np.ndarray,
    base: BaseParameters,
    prior: np.ndarray,
    *,
    bodies: Sequence[str] | None = None,
    masses: float | None = None,
    widest: bool = False,
) -> ConsistentParameters:
    """Physical φ closest to a prior, for given base parameters.

    Closeness is the log-determinant divergence of the pseudo-inertias J from those of the prior P, which depends
    neither on units nor on the choice of body frames, and grows without bound towards bodies that are not physical
    (Lee, Wensing and Park, T-RO 2020, doi:10.1109/TRO.2019.2926491). Minimising it together with the squared
    Mahalanobis distance of ψ is a convex problem that Newton's method solves exactly: no physical bodies that are as
    near to ψ are closer to the prior, even if ψ itself is not attainable.

    The weight of the prior is estimated from ψ. The likelihood of a prior's width has a 95 % interval. If that contains
    zero, and ψ of the prior lies in the confidence region, ψ does not contradict the prior, which is the result;
    otherwise the result is that of the widest prior in the interval. So noise in combinations that are hardly
    identifiable does not move bodies, and well-identified combinations are kept.

    Args:
        psi: Base parameters ψ, as of an estimate (r,).
        covariance: Their covariance (r, r).
        base: The regrouping behind ψ.
        prior: φ of the prior, as of a model (10 b,), made physical by `physical_prior`.
        bodies: Names of the bodies, for messages; by default they are counted from 1.
        masses: Relative standard deviation of the prior's masses, for hardly identifiable ones (`unseen`): the
            divergence alone would rather change a mass than move a centre of mass. Fitting ψ comes first: if bodies
            with these masses leave its confidence region, the deviation is increased, and finally dropped.
        widest: True for the widest prior that ψ allows, as for a prior that is a guess from the same data; by default
            bodies keep the prior unless ψ contradicts it.

    Returns:
        Full parameters with a report.

    Raises:
        InputError: Shapes do not match, numbers are not finite, the covariance is not symmetric and positive definite,
            or the prior has a negative mass or no mass and extent at all.
    """
    psi, C, prior = (np.array(x, float) for x in (psi, covariance, prior))
    if masses is not None and masses < 0:
        raise InputError(f"masses needs a relative standard deviation of zero or more, got {masses:g}.")
    _check(psi, C, base, prior)
    physical, raised = physical_prior(prior, bodies=bodies)
    std, names = np.sqrt(np.diag(C)), tuple(bodies or ())
    L = np.linalg.cholesky(pseudo_inertia(physical.reshape(-1, 10)))
    root = std[:, None] * np.linalg.cholesky(C / np.outer(std, std))
    problem = NearestBodies.of(psi, base, L, root)
    K = problem.bodies(problem.widest if widest else None)
    closest = _report(problem, K, L, root, psi, base, physical, raised, names)
    for kept in () if masses is None else (masses * factor for factor in LOOSER):
        hidden = closest.unseen & (np.abs(closest.phi - physical)[::10] > masses * physical[::10])
        if not hidden.any():
            break
        with_masses = problem.with_masses(L, np.where(closest.unseen, kept, np.inf) * physical[::10])
        beside = _report(problem, with_masses.bodies(problem.width), L, root, psi, base, physical, raised, names)
        if beside.attainable >= closest.attainable and beside.distance**2 <= closest.distance**2 + ROOM:
            return beside
    return closest


def _report(
    problem: NearestBodies,
    K: np.ndarray,
    L: np.ndarray,
    root: np.ndarray,
    psi: np.ndarray,
    base: BaseParameters,
    physical: np.ndarray,
    raised: tuple[int, ...],
    bodies: tuple[str, ...],
) -> ConsistentParameters:
    """Result for bodies `L K Lᵀ` and the given ψ, whose covariance is `root rootᵀ`."""
    phi = parameters_from_pseudo_inertia(L @ K @ np.swapaxes(L, -1, -2)).ravel()
    regrouped = base.regroup(phi)
    eigenvalues = np.linalg.eigvalsh(K)
    distance = float(np.linalg.norm(linalg.solve_triangular(root, regrouped - psi, lower=True)))
    return ConsistentParameters(
        phi=phi,
        psi=regrouped,
        names=base.names,
        attainable=bool(distance**2 <= region(base.rank)),
        distance=distance,
        shift=(regrouped - psi) / np.linalg.norm(root, axis=1),
        divergence=np.sum(eigenvalues - 1 - np.log(eigenvalues), axis=1),
        mass_std=problem.std(K, L[:, 3]),
        prior=physical,
        raised=raised,
        bodies=bodies,
    )


def physical_prior(
    phi: np.ndarray, *, minimum: float = 1e-2, bodies: Sequence[str] | None = None
) -> tuple[np.ndarray, tuple[int, ...]]:
    """The φ made physical, and the bodies that had to be raised for that.

    Args:
        phi: φ of all bodies (10 b,).
        minimum: Smallest radius of gyration that a body may have, over that of the whole tree; its mass must be at
            least `minimum³` of the whole. Bodies with less, massless ones and those with impossible moments are raised
            to it.
        bodies: Names of the bodies, for messages.

    Returns:
        φ with masses and central second moments raised to the minimum (10 b,), and indices of those bodies.

    Raises:
        InputError: A mass is negative, or all bodies together have neither mass nor extent.
    """
    J = pseudo_inertia(np.reshape(phi, (-1, 10)))
    mass, second = J[:, 3, 3], np.maximum(np.trace(J[:, :3, :3], axis1=1, axis2=2), 0)
    names = [f"{k + 1}" for k in range(len(J))] if bodies is None else list(bodies)
    if (mass < 0).any():
        raise InputError(f"A prior body needs a mass of at least zero; negative: {_chosen(names, mass < 0)}.")
    if not (mass.sum() > 0 and second.sum() > 0):
        raise InputError("A prior needs mass and extent to measure bodies by; all masses or all moments are zero.")
    smallest = minimum**2 * second.sum() / mass.sum() / 3
    raised = []
    for k, m in enumerate(mass):
        com = J[k, :3, 3] / m if m > 0 else np.zeros(3)
        values, axes = np.linalg.eigh(J[k, :3, :3] - m * np.outer(com, com))
        heavy = max(m, minimum**3 * mass.sum())
        if m < heavy or (values < heavy * smallest).any():
            raised.append(k)
            central = (axes * np.maximum(values, heavy * smallest)) @ axes.T
            J[k, :3, :3], J[k, :3, 3] = central + heavy * np.outer(com, com), heavy * com
            J[k, 3, :3], J[k, 3, 3] = heavy * com, heavy
    return parameters_from_pseudo_inertia(J).ravel(), tuple(raised)


def _check(psi: np.ndarray, C: np.ndarray, base: BaseParameters, prior: np.ndarray) -> None:
    r, P = base.rank, len(base.parameters)
    if P % 10:
        raise InputError(f"Full parameters need a regrouping of ten for each body, got {P}; leave drives out of it.")
    if psi.shape != (r,) or C.shape != (r, r) or prior.shape != (P,):
        raise InputError(
            f"This regrouping needs ψ ({r},), its covariance ({r}, {r}) and a prior ({P},), got {psi.shape}, {C.shape} "
            f"and {prior.shape}."
        )
    if not all(np.isfinite(x).all() for x in (psi, C, prior)):
        raise InputError("ψ, its covariance and the prior need finite numbers, got NaN or infinity.")
    std = np.sqrt(np.maximum(np.diag(C), 0))
    if (std == 0).any():
        raise InputError(
            f"Every base parameter needs a positive variance; it is not for {_chosen(base.names, std == 0)}."
        )
    correlation = C / np.outer(std, std)
    if not np.allclose(correlation, correlation.T, atol=1e-9) or np.linalg.eigvalsh(correlation).min() <= 0:
        raise InputError("The covariance of ψ needs to be symmetric and positive definite.")


def _chosen(names: Sequence[str], mask: np.ndarray) -> str:
    return ", ".join(name for name, chosen in zip(names, mask, strict=True) if chosen)
