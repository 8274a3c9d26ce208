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
from functools import cached_property

import numpy as np
from scipy import linalg, special

from ident.errors import InputError
from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia
from ident.parameters.base_parameters import BaseParameters

ROOM = 3.84
"""Excess of minus twice the log-likelihood of a prior's width over its minimum within the 95 % interval."""

CONFIDENCE = 0.95
"""Probability of the confidence region of ψ, within which ψ counts as attained."""

UNPHYSICAL = 1e-8
"""Eigenvalue of `J P⁻¹` below which a body counts as not physical."""

FINEST = 0.8
"""The continuation towards the prior's width stops when a step can only reduce the weight by a factor above this."""

LOOSER = 1.0, 2.0, 4.0
"""Factors by which the deviation of hardly identifiable masses is increased if the bodies do not fit ψ otherwise."""

NEWTON_STEPS = 50
"""Largest number of Newton steps of a minimisation; ten are usual."""

CONVERGED = 1e-9
"""Relative change of a body at which Newton's method has converged; the next change would be below rounding."""


@dataclass(frozen=True, eq=False)
class ConsistentParameters:
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
    _check(psi, C, base, prior)
    physical, raised = physical_prior(prior, bodies=bodies)
    std = np.sqrt(np.diag(C))
    L = np.linalg.cholesky(pseudo_inertia(physical.reshape(-1, 10)))
    root = std[:, None] * np.linalg.cholesky(C / np.outer(std, std))
    problem = _Problem.of(psi, base, L, root)
    K = problem.bodies(problem.widest if widest else None)
    found = _report(problem, K, L, root, psi, base, physical, raised)
    for kept in () if masses is None else (masses * factor for factor in LOOSER):
        hidden = found.unseen & (np.abs(found.phi - physical)[::10] > masses * physical[::10])
        if not hidden.any():
            break
        with_masses = problem.with_masses(L, np.where(found.unseen, kept, np.inf) * physical[::10])
        beside = _report(problem, with_masses.bodies(problem.width), L, root, psi, base, physical, raised)
        if beside.attainable >= found.attainable and beside.distance**2 <= found.distance**2 + ROOM:
            return beside
    return found


def _report(
    problem: "_Problem",
    K: np.ndarray,
    L: np.ndarray,
    root: np.ndarray,
    psi: np.ndarray,
    base: BaseParameters,
    physical: np.ndarray,
    raised: tuple[int, ...],
) -> ConsistentParameters:
    """Result for bodies `L K Lᵀ` and the given ψ, whose covariance is `root rootᵀ`."""
    phi = parameters_from_pseudo_inertia(L @ K @ np.swapaxes(L, -1, -2)).ravel()
    found = base.regroup(phi)
    eigenvalues = np.linalg.eigvalsh(K)
    distance = float(np.linalg.norm(linalg.solve_triangular(root, found - psi, lower=True)))
    return ConsistentParameters(
        phi=phi,
        psi=found,
        names=base.names,
        attainable=bool(distance**2 <= _region(base.rank)),
        distance=distance,
        shift=(found - psi) / np.linalg.norm(root, axis=1),
        divergence=np.sum(eigenvalues - 1 - np.log(eigenvalues), axis=1),
        mass_std=problem.std(K, L[:, 3]),
        prior=physical,
        raised=raised,
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


class _Problem:
    """`min |A K - ψ|²/2 + μ Σ (tr K - log det K)` with μ = 1/w².

    At the minimum bodies K and multipliers λ satisfy `A K + μ λ = ψ` and `K (1 - A*λ) = 1`.

    Attributes:
        A: `A*λ = Σ_k λ_k A_k`, one symmetric matrix for each base parameter and body (r, b, 4, 4).
        psi: ψ (r,).
        prior: `K = 1` (b, 4, 4).
    """

    def __init__(self, A: np.ndarray, psi: np.ndarray) -> None:
        self.A, self.psi = A, psi
        self.prior = np.tile(np.eye(4), (A.shape[1], 1, 1))

    @classmethod
    def of(cls, psi: np.ndarray, base: BaseParameters, L: np.ndarray, root: np.ndarray) -> "_Problem":
        """The problem in coordinates where the prior `L Lᵀ` is the identity and ψ has independent unit variances.

        Args:
            psi: Base parameters ψ (r,).
            base: The regrouping behind them.
            L: Roots of the prior's pseudo-inertias (b, 4, 4).
            root: Lower triangular root of the covariance of ψ (r, r).
        """
        A = linalg.solve_triangular(root, _forms(base, L).reshape(base.rank, -1), lower=True)
        return cls(A.reshape(base.rank, -1, 4, 4), linalg.solve_triangular(root, psi, lower=True))

    def with_masses(self, L: np.ndarray, std: np.ndarray) -> "_Problem":
        """The problem with additional prior standard deviations of masses, infinite for unknown ones (b,)."""
        known = np.flatnonzero(np.isfinite(std) & (std > 0))
        rows = np.zeros((len(known), *self.A.shape[1:]))
        rows[range(len(known)), known] = np.einsum("bi,bj->bij", L[known, 3], L[known, 3]) / std[known, None, None]
        masses = np.trace(rows.sum(axis=1), axis1=1, axis2=2)
        return _Problem(np.concatenate([self.A, rows]), np.append(self.psi, masses))

    @cached_property
    def width(self) -> float:
        """Estimated width w of the prior."""
        return self._width(self.psi - np.tensordot(self.A, self.prior, 3))

    def bodies(self, width: float | None = None) -> np.ndarray:
        """Bodies K for a prior of some width, by default the estimated one (b, 4, 4)."""
        misfit = self.psi - np.tensordot(self.A, self.prior, 3)
        K, width = self.prior, self.width if width is None else width
        if width == 0:
            return K
        goal, multipliers = width**-2, 0 * misfit
        # The prior is the minimum for an infinite weight, and close to it for one larger than the misfit's gradient.
        mu, ratio, heavy = np.inf, 0.1, 10 * np.abs(np.tensordot(misfit, self.A, 1)).max()
        while mu > goal and ratio < FINEST:
            following = max(goal, ratio * min(mu, heavy))
            found = self._minimiser(K, multipliers, following)
            if found is None:
                ratio = np.sqrt(ratio)
            elif np.linalg.eigvalsh(found[0]).min() < UNPHYSICAL:
                break
            else:
                (K, multipliers), mu, ratio = found, following, max(0.1, ratio**2)
        return K

    @cached_property
    def widest(self) -> float:
        """The largest width that ψ allows."""
        return self._width(self.psi - np.tensordot(self.A, self.prior, 3), least=False)

    def _width(self, misfit: np.ndarray, *, least: bool = True) -> float:
        """Largest w in the 95 % interval, for a misfit of covariance `1 + w² A A*`.

        If the interval contains zero, the smallest w whose remaining misfit is in the confidence region: zero, unless a
        few combinations alone contradict the prior.
        """
        values, axes = np.linalg.eigh(np.tensordot(self.A, self.A, ((1, 2, 3), (1, 2, 3))))
        squares = np.append(0, np.geomspace(1e-2 / values[-1], 1e12, 1000))
        variances = 1 + np.outer(squares, np.maximum(values, 0))
        pulls = (axes.T @ misfit) ** 2
        unlikely = np.sum(np.log(variances) + pulls / variances, axis=1)
        allowed = squares[unlikely <= unlikely.min() + ROOM]
        enough = squares[np.sum(pulls / variances**2, axis=1) <= _region(len(misfit))]
        return float(np.sqrt(allowed[-1] if allowed[0] or not len(enough) or not least else enough[0]))

    def _minimiser(self, K: np.ndarray, multipliers: np.ndarray, mu: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Bodies and multipliers at the minimum, or None if Newton's method does not converge.

        Steps are Nesterov-Todd steps: in axes in which K and `Z = 1 - A*λ` are the same diagonal matrix.
        """
        r = len(self.psi)
        Z = self.prior - np.tensordot(multipliers, self.A, 1)
        length = 1.0
        for _ in range(NEWTON_STEPS):
            G, s = _common_axes(K, Z)
            if not s.all():
                return None
            rows = np.swapaxes(G, -1, -2)[None] @ self.A @ G
            off = (1 / s - s)[..., None] * np.eye(4)
            misfit = self.psi - np.tensordot(self.A, K, 3) - mu * multipliers
            triangle = linalg.qr(np.vstack([rows.reshape(r, -1).T, np.sqrt(mu) * np.eye(r)]), mode="r")[0][:r]
            # After a short step a centring step follows, which only brings K and Z closer to being inverse.
            goal = misfit if length > 0.5 or np.abs(s - 1).max() < 0.5 else 0
            whitened = linalg.solve_triangular(triangle, goal - np.tensordot(rows, off, 3), trans="T")
            step = linalg.solve_triangular(triangle, whitened)
            dZ = -np.tensordot(step, rows, 1)
            dK = off - dZ
            length = min(1.0, 0.9 * _longest(dK, s), 0.9 * _longest(dZ, s))
            K = K + length * G @ dK @ np.swapaxes(G, -1, -2)
            K = (K + np.swapaxes(K, -1, -2)) / 2
            multipliers = multipliers + length * step
            Z = self.prior - np.tensordot(multipliers, self.A, 1)
            if length == 1 and max(np.abs(dK).max(), np.abs(dZ).max()) < CONVERGED:
                return K, multipliers
        return None

    def std(self, K: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Standard deviations (b,) of `xᵀ K x` for vectors (b, 4), from ψ and a prior as wide as K alone."""
        G = np.linalg.cholesky(K)
        rows = (np.swapaxes(G, -1, -2)[None] @ self.A @ G).reshape(len(self.psi), -1)
        triangle = linalg.qr(np.vstack([rows, np.eye(16 * len(K))]), mode="r")[0][: 16 * len(K)]
        y = np.einsum("bi,bij->bj", x, G)
        forms = np.einsum("bc,bi,bj->bcij", np.eye(len(K)), y, y).reshape(len(K), -1)
        return np.linalg.norm(linalg.solve_triangular(triangle, forms.T, trans="T"), axis=0)


def _region(parameters: int) -> float:
    """Largest squared Mahalanobis distance within the confidence region."""
    return float(special.chdtri(parameters, 1 - CONFIDENCE))


def _common_axes(K: np.ndarray, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G and s (b, 4) with `K = G diag(s) Gᵀ` and `Gᵀ Z G = diag(s)`; zeros where rounding has broken K or Z."""
    try:
        root = np.linalg.cholesky(K)
        _, s, V = np.linalg.svd(np.swapaxes(np.linalg.cholesky(Z), -1, -2) @ root)
    except np.linalg.LinAlgError:
        return K, np.zeros(K.shape[:2])
    return root @ np.swapaxes(V, -1, -2) / np.sqrt(s)[:, None, :], s


def _longest(change: np.ndarray, s: np.ndarray) -> float:
    """Step length along a change at which `diag(s)` becomes singular."""
    least = np.linalg.eigvalsh(change / np.sqrt(s[:, :, None] * s[:, None, :])).min()
    return -1 / least if least < 0 else np.inf


def _forms(base: BaseParameters, L: np.ndarray) -> np.ndarray:
    """Symmetric matrices (r, b, 4, 4) whose inner products with K are the base parameters of the bodies `L K Lᵀ`."""
    units = np.eye(16).reshape(16, 4, 4)
    units = (units + np.swapaxes(units, -1, -2)) / 2
    phi = parameters_from_pseudo_inertia(L[:, None] @ units @ np.swapaxes(L, -1, -2)[:, None])
    columns = base.regroup(np.eye(len(base.parameters))).T.reshape(base.rank, len(L), 10)
    return np.einsum("rbp,bkp->rbk", columns, phi).reshape(base.rank, len(L), 4, 4)


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
