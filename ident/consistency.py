"""Physically consistent full parameters: the bodies closest to a prior that predict the same wrenches."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.base_parameters import BaseParameters
from ident.inertia import parameters_from_pseudo_inertia, pseudo_inertia

SMALLEST = 1e-8
"""Bodies with an eigenvalue of `J P⁻¹` below this are as good as not physical."""

LARGEST = 1e3
"""Where ψ is unattainable: how many times larger than the prior bodies may grow to come nearer."""

FINEST = 0.8
"""Where ψ is unattainable: the path ends where the divergence's weight could only be lowered by more than this factor
from one minimisation to the next."""

STEPS = 50
"""Newton steps after which a minimisation is given up; ten are usual."""

SHORTEST = 1e-5
"""Fraction of a step towards ψ at which it counts as out of reach."""

CONVERGED = 1e-9
"""Change of a body, relative to itself, from which Newton's method stops; the change after it is below rounding."""

EXCESS = 1e-3
"""Where ψ is unattainable: precision of the smallest squared distance, as a fraction of it."""

ROOM = 3.84
"""How much larger than the smallest the squared distance may be, for bodies closer to the prior: a 95 % interval.
The nearest bodies of all lie on the edge, and may be absurdly large."""


@dataclass(frozen=True, eq=False)
class ConsistentParameters:
    """Full parameters of physical bodies, and how well they have the base parameters asked for.

    Attributes:
        phi: φ of all bodies, every pseudo-inertia positive definite (10 b,).
        psi: Their base parameters (r,).
        names: Names of the base parameters (r,).
        attainable: Whether physical bodies can have the ψ asked for; if so, they have it.
        distance: Mahalanobis distance of `psi` from the ψ asked for, in the metric of its covariance.
        shift: `psi` less the ψ asked for, in standard deviations (r,).
        divergence: How far each body moved from its prior, `tr(J P⁻¹) - log det(J P⁻¹) - 4` (b,).
        prior: φ that the bodies are closest to, physical (10 b,).
        raised: Bodies, counted from 0, whose prior was not physical and had to be raised.
    """

    phi: np.ndarray
    psi: np.ndarray
    names: tuple[str, ...]
    attainable: bool
    distance: float
    shift: np.ndarray
    divergence: np.ndarray
    prior: np.ndarray
    raised: tuple[int, ...]

    def moved(self, least: float = 0.01) -> tuple[tuple[str, float], ...]:
        """Names of the base parameters that had to move, with by how many standard deviations, largest first.

        Args:
            least: Standard deviations below which a parameter counts as kept.
        """
        order = np.argsort(-np.abs(self.shift), kind="stable")
        return tuple((self.names[k], float(self.shift[k])) for k in order if abs(self.shift[k]) >= least)


def consistent_parameters(
    psi: np.ndarray,
    covariance: np.ndarray,
    base: BaseParameters,
    prior: np.ndarray,
    *,
    minimum: float = 1e-2,
    bodies: Sequence[str] | None = None,
) -> ConsistentParameters:
    """The physical φ closest to a prior that has given base parameters, or the nearest that physical bodies can have.

    Closeness is the log-determinant divergence of the pseudo-inertias J from those of the prior P, which depends
    neither on units nor on the choice of body frames, and grows without bound towards bodies that are not physical
    (Lee, Wensing and Park, T-RO 2020): minimise `Σ_i tr(J_i P_i⁻¹) - log det(J_i P_i⁻¹)` with `A φ = ψ`, a convex
    problem that Newton's method solves exactly. Where no physical bodies have ψ the divergence goes to zero weight
    beside the squared Mahalanobis distance `d²`, until `d²` is within `EXCESS` of the smallest one that bodies up to
    `LARGEST` times the prior have; of the bodies on that path those closest to the prior are taken whose `d²`
    exceeds the smallest by at most `ROOM`.

    Args:
        psi: Base parameters ψ to keep, as of an estimate (r,).
        covariance: Their covariance, which tells what moves first when ψ cannot be kept (r, r).
        base: The regrouping behind ψ.
        prior: φ to stay close to, as of a model (10 b,).
        minimum: Smallest radius of gyration that a prior body may have, over that of the whole tree; its mass must be
            at least `minimum³` of the whole. Prior bodies with less, massless ones and those whose moments no mass
            distribution has, are raised to it.
        bodies: Names of the bodies, for messages; by default they are counted from 1.

    Returns:
        Full parameters with a report.

    Raises:
        ValueError: Shapes do not match, numbers are not finite, the covariance is not symmetric and positive definite,
            or the prior has a negative mass or no mass and extent at all.
    """
    psi, C, prior = (np.array(x, float) for x in (psi, covariance, prior))
    _check(psi, C, base, prior)
    physical, raised = physical_prior(prior, minimum=minimum, bodies=bodies)
    std = np.sqrt(np.diag(C))
    P = pseudo_inertia(physical.reshape(-1, 10))
    L = np.linalg.cholesky(P)
    # In these coordinates the prior is the identity and one standard deviation is one.
    A = _whitened(base, L) / std[:, None, None, None]
    problem = _Problem(A, psi / std, C / np.outer(std, std))
    K, attainable = problem.solution()
    phi = parameters_from_pseudo_inertia(L @ K @ np.swapaxes(L, -1, -2)).ravel()
    found = base.regroup(phi)
    shift = (found - psi) / std
    eigenvalues = np.linalg.eigvalsh(K)
    return ConsistentParameters(
        phi=phi,
        psi=found,
        names=base.names,
        attainable=attainable,
        distance=float(np.linalg.norm(linalg.solve_triangular(problem.root, shift, lower=True))),
        shift=shift,
        divergence=np.sum(eigenvalues - 1 - np.log(eigenvalues), axis=1),
        prior=physical,
        raised=raised,
    )


def physical_prior(
    phi: np.ndarray, *, minimum: float = 1e-2, bodies: Sequence[str] | None = None
) -> tuple[np.ndarray, tuple[int, ...]]:
    """A φ whose bodies are all physical, and which of them had to be raised for that.

    Args:
        phi: φ of all bodies (10 b,).
        minimum: As for `consistent_parameters`.
        bodies: Names of the bodies, for messages.

    Returns:
        φ with masses and central second moments raised to the minimum (10 b,), and indices of those bodies.

    Raises:
        ValueError: A mass is negative, or all bodies together have neither mass nor extent.
    """
    J = pseudo_inertia(np.reshape(phi, (-1, 10)))
    mass, second = J[:, 3, 3], np.maximum(np.trace(J[:, :3, :3], axis1=1, axis2=2), 0)
    names = [f"{k + 1}" for k in range(len(J))] if bodies is None else list(bodies)
    if (mass < 0).any():
        raise ValueError(f"A prior body needs a mass of at least zero; negative: {_chosen(names, mass < 0)}.")
    if not (mass.sum() > 0 and second.sum() > 0):
        raise ValueError("A prior needs mass and extent to measure bodies by; all masses or all moments are zero.")
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


class _Problem:
    """`min d²/2 + μ Σ (tr K - log det K)`, or for μ = 0 the divergence alone with `A K = ψ`.

    Both have the bodies and multipliers with `A K + μ C λ = ψ` and `K (1 - A*λ) = 1`.

    Attributes:
        A: `A*λ = Σ_k λ_k A_k`, one symmetric matrix for each base parameter and body (r, b, 4, 4).
        psi: ψ in standard deviations (r,).
        root: Lower triangular factor of its correlation C (r, r).
    """

    def __init__(self, A: np.ndarray, psi: np.ndarray, C: np.ndarray) -> None:
        self.A, self.psi = A, psi
        self.root = np.linalg.cholesky(C)

    def solution(self) -> tuple[np.ndarray, bool]:
        """The bodies K (b, 4, 4), and whether they have ψ."""
        size = 4 * self.A.shape[1]
        state = np.tile(np.eye(4), (self.A.shape[1], 1, 1)), np.zeros(len(self.psi))
        path = [(state[0], self._distance(state[0]))]
        weight, ratio = 10 * path[0][1] ** 2 / size, 0.1
        # `A* C⁻¹(ψ - Aφ) = μ (1 - K⁻¹) < μ`: bodies with Σ tr K up to T are at most μ T / d nearer.
        while 2 * weight * LARGEST * size >= EXCESS * path[-1][1] ** 2 and ratio < FINEST:
            exact = self._minimiser(*state, 0.0)
            if exact is not None and np.linalg.eigvalsh(exact[0]).min() >= SMALLEST:
                return exact[0], True
            found = self._minimiser(*state, ratio * weight)
            if found is None:
                ratio = np.sqrt(ratio)
                continue
            if np.linalg.eigvalsh(found[0]).min() < SMALLEST:
                break
            state, weight = found, ratio * weight
            path.append((state[0], self._distance(state[0])))
        # The first that is near enough is closest to the prior.
        return next(K for K, d in path if d**2 <= path[-1][1] ** 2 + ROOM), False

    def _minimiser(self, K: np.ndarray, multipliers: np.ndarray, mu: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Bodies and multipliers at the minimum, or None if Newton's method does not get there.

        Steps are those of Nesterov and Todd: in axes in which K and `Z = 1 - A*λ` are the same diagonal matrix.
        """
        Z = np.eye(4) - np.tensordot(multipliers, self.A, 1)
        length = 1.0
        for _ in range(STEPS):
            G, s = _common_axes(K, Z)
            if not s.all():
                return None
            rows = np.swapaxes(G, -1, -2)[None] @ self.A @ G
            off = (1 / s - s)[..., None] * np.eye(4)
            misfit = self.psi - np.tensordot(self.A, K, 3) - mu * self.root @ (self.root.T @ multipliers)
            stacked = np.vstack([rows.reshape(len(self.psi), -1).T, np.sqrt(mu) * self.root.T])
            triangle = linalg.qr(stacked, mode="r")[0][: len(self.psi)]
            if not np.abs(np.diag(triangle)).all():
                return None
            # Near the edge a step that only makes K and Z each other's inverse comes between two that go on.
            goal = misfit if length > 0.5 or np.abs(s - 1).max() < 0.5 else 0
            whitened = linalg.solve_triangular(triangle, goal - np.tensordot(rows, off, 3), trans="T")
            step = linalg.solve_triangular(triangle, whitened)
            dZ = -np.tensordot(step, rows, 1)
            dK = off - dZ
            length = min(1.0, 0.9 * _longest(dK, s), 0.9 * _longest(dZ, s))
            K = K + length * G @ dK @ np.swapaxes(G, -1, -2)
            K = (K + np.swapaxes(K, -1, -2)) / 2
            multipliers = multipliers + length * step
            Z = np.eye(4) - np.tensordot(multipliers, self.A, 1)
            if mu == 0 and length < SHORTEST:
                return None
            if length == 1 and max(np.abs(dK).max(), np.abs(dZ).max()) < CONVERGED:
                return K, multipliers
        return None

    def _distance(self, K: np.ndarray) -> float:
        misfit = np.tensordot(self.A, K, 3) - self.psi
        return float(np.linalg.norm(linalg.solve_triangular(self.root, misfit, lower=True)))


def _common_axes(K: np.ndarray, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G and s (b, 4) with `K = G diag(s) Gᵀ` and `Gᵀ Z G = diag(s)`; zeros where rounding has broken K or Z."""
    try:
        root = np.linalg.cholesky(K)
        _, s, V = np.linalg.svd(np.swapaxes(np.linalg.cholesky(Z), -1, -2) @ root)
    except np.linalg.LinAlgError:
        return K, np.zeros(K.shape[:2])
    return root @ np.swapaxes(V, -1, -2) / np.sqrt(s)[:, None, :], s


def _longest(change: np.ndarray, s: np.ndarray) -> float:
    """How far `diag(s)` can go along a change before it is singular."""
    least = np.linalg.eigvalsh(change / np.sqrt(s[:, :, None] * s[:, None, :])).min()
    return -1 / least if least < 0 else np.inf


def _whitened(base: BaseParameters, L: np.ndarray) -> np.ndarray:
    """Symmetric matrices (r, b, 4, 4) whose products with K are the base parameters of the bodies `L K Lᵀ`."""
    units = np.eye(16).reshape(16, 4, 4)
    units = (units + np.swapaxes(units, -1, -2)) / 2
    phi = parameters_from_pseudo_inertia(L[:, None] @ units @ np.swapaxes(L, -1, -2)[:, None])
    columns = base.regroup(np.eye(len(base.parameters))).T.reshape(base.rank, len(L), 10)
    return np.einsum("rbp,bkp->rbk", columns, phi).reshape(base.rank, len(L), 4, 4)


def _check(psi: np.ndarray, C: np.ndarray, base: BaseParameters, prior: np.ndarray) -> None:
    r, P = base.rank, len(base.parameters)
    if P % 10:
        raise ValueError(f"Full parameters need a regrouping of ten for each body, got {P}; leave drives out of it.")
    if psi.shape != (r,) or C.shape != (r, r) or prior.shape != (P,):
        raise ValueError(
            f"This regrouping needs ψ ({r},), its covariance ({r}, {r}) and a prior ({P},), got {psi.shape}, {C.shape} "
            f"and {prior.shape}."
        )
    if not all(np.isfinite(x).all() for x in (psi, C, prior)):
        raise ValueError("ψ, its covariance and the prior need finite numbers, got NaN or infinity.")
    std = np.sqrt(np.maximum(np.diag(C), 0))
    if (std == 0).any():
        raise ValueError(
            f"Every base parameter needs a positive variance; it is not for {_chosen(base.names, std == 0)}."
        )
    correlation = C / np.outer(std, std)
    if not np.allclose(correlation, correlation.T, atol=1e-9) or np.linalg.eigvalsh(correlation).min() <= 0:
        raise ValueError("The covariance of ψ needs to be symmetric and positive definite.")


def _chosen(names: Sequence[str], mask: np.ndarray) -> str:
    return ", ".join(name for name, chosen in zip(names, mask, strict=True) if chosen)
