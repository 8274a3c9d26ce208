"""Physically consistent full parameters: the bodies closest to a prior that fit estimated base parameters.

    minimise   d²/2 + D/w²    over pseudo-inertias J,

    d² = (Aφ - ψ)ᵀ C⁻¹ (Aφ - ψ),    D = Σ_i tr(J_i P_i⁻¹) - log det(J_i P_i⁻¹) - 4,    φ ~ J,    prior ~ P.

`d` is the Mahalanobis distance from the base parameters ψ with their covariance C, and D the log-determinant
divergence from the prior. w is the width of the prior: bodies scatter around it by w times their own size, as D is half
the squared distance in these units. It is estimated from ψ, whose distance from the prior's own base parameters is
likely for some widths only (empirical Bayes).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import linalg

from ident.annotations import typed
from ident.display.brief import QUANTITIES, UNITS, BodyValue, Brief, bodies_frame, bodies_text, comments, listed
from ident.errors import InputError
from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia, with_centers
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.body_bounds import NEAREST, BodyPrior, Fitting, Rotors, scaled_root
from ident.parameters.nearest_bodies import NearestBodies, region
from ident.parameters.prior import KNOWN, body_covariance
from ident.tolerances import INTERVAL, LIKELY

DETERMINED = 0.5
"""Share of the data below which a parameter counts as not determined: the model's word would say more."""

LOOSER = 1.0, 2.0, 4.0
"""Factors by which the deviation of hardly identifiable masses is increased if the bodies do not fit ψ otherwise."""

LEAST_SIZE = 1e-2
"""Least radius of gyration of a prior body over that of the whole tree: divergence measures bodies by their prior."""

HELD = 1e-4
"""Relative standard deviation of a mass that is held, or stated without one: what scales resolve."""


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
        bodies: Names of the bodies (b,).
        model: The prior φ as given (10 b,).
        rotors: Rotor inertias that the bodies cannot take up, by their names; those that ψ lost beforehand included.
        fitting: What the bodies are to fit.
    """

    phi: np.ndarray
    psi: np.ndarray
    names: tuple[str, ...]
    attainable: bool
    distance: float
    shift: np.ndarray
    divergence: np.ndarray
    mass_std: np.ndarray
    bodies: tuple[str, ...]
    model: np.ndarray
    rotors: Mapping[str, float]
    fitting: Fitting

    @cached_property
    def values(self) -> np.ndarray:
        """Mass, centre of mass and inertia about the frame's origin of each body (b, 10)."""
        return with_centers(self.phi)

    @cached_property
    def intervals(self) -> np.ndarray:
        """95 % intervals of `values`, which are among them, over all physical bodies that ψ allows (b, 10, 2).

        Where nothing bounds a value the limit is infinite; all are NaN where no physical bodies have ψ.
        """
        if self.fitting.prior.used and not self.attainable:
            return np.full((*self.values.shape, 2), np.nan)
        limits = self.fitting.bounds(self.phi)
        each = np.stack([np.minimum(limits[..., 0], self.values), np.maximum(limits[..., 1], self.values)], axis=-1)
        return np.where(np.isnan(limits), np.nan, each)

    @cached_property
    def share(self) -> np.ndarray:
        """Share that data have in what is known of each value: 1 less its variance over that of the prior (b, 10).

        Where there is no prior, the default one of a model with these values stands for it.
        """
        half, prior = np.diff(self.intervals)[..., 0] / 2 / INTERVAL, self.fitting.prior.std
        usual = np.sqrt([np.diag(body_covariance(phi)) for phi in self.phi.reshape(-1, 10)])
        usual[:, :4] = np.c_[KNOWN["mass"] * self.phi[::10], np.full((len(usual), 3), KNOWN["center"])]
        prior = np.where(np.isinf(prior), usual, prior)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(half > 0, half / prior, 0) ** 2
            share = 1 - ratio if self.fitting.prior.used else 1 / (1 + ratio)
        return np.where(np.isfinite(half) & (prior > 0), np.clip(share, 0, 1), 0)

    @cached_property
    def rows(self) -> tuple[BodyValue, ...]:
        """Each quantity of each body with its interval, the model's value and the data's share."""
        models, std, out = with_centers(self.model), self.fitting.prior.std, list[BodyValue]()
        for k, body in enumerate(self.bodies):
            for j, (quantity, unit) in enumerate(zip(QUANTITIES, UNITS, strict=True)):
                (lower, upper), share = self.intervals[k, j].tolist(), float(self.share[k, j])
                model = float(models[k, j]) if models[k, 0] else None
                used = self.fitting.prior.used
                how = (
                    share >= DETERMINED,
                    used and bool(np.isfinite(std[k, j])),
                    not std[k, j] and (used or model is None),
                )
                out.append(BodyValue(body, quantity, unit, float(self.values[k, j]), lower, upper, model, share, *how))
        return tuple(out)

    @property
    def comments(self) -> dict[str, str]:
        """Comment on each body for a model's file, by name."""
        return comments(self.rows)

    def to_frame(self) -> Any:
        """Values of all bodies as a pandas data frame, with their 95 % intervals and the data's share.

        Raises:
            InputError: pandas is not installed (extra `pandas`).
        """
        return bodies_frame(self.rows)

    def __str__(self) -> str:
        return bodies_text(self.rows)

    @property
    def _in_short(self) -> dict[str, object]:
        rows = self.rows[::10]
        masses = (f"{x.body} {x.estimate:.3g}{'' if x.determined else ' (not determined)'}" for x in rows)
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
    width: float | None = None,
    known: BodyPrior | None = None,
    rotors: Rotors | None = None,
) -> ConsistentParameters:
    """Physical φ closest to a prior, for given base parameters.

    Closeness is the log-determinant divergence of the pseudo-inertias J from those of the prior P, which depends
    neither on units nor on the choice of body frames, and grows without bound towards bodies that are not physical
    (Lee, Wensing and Park, T-RO 2020, doi:10.1109/TRO.2019.2926491). Minimising it together with the squared
    Mahalanobis distance of ψ is a convex problem, solved exactly: no physical bodies that are as
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
            with these masses leave its confidence region, the deviation is increased, and finally dropped. Where no
            physical bodies fit, masses beyond a factor of `LIKELY` of the prior's are held at the prior's.
        width: Width of the prior, for a guess from the same data, whose agreement with ψ says nothing; by default it
            is estimated, and bodies keep the prior unless ψ contradicts it.
        known: What is known of the bodies beside ψ, and how well, for `intervals` and the data's share; by default
            nothing is. If the estimate of ψ includes it, so do the bodies, and `masses` is not used.
        rotors: Rotors of which ψ has lost the model's values. If links cannot take up the difference, which no body
            could have, the rotors get it.

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
    physical = physical_prior(prior, bodies=bodies)
    rotors = rotors or Rotors.none(base.rank)
    known = known or BodyPrior(np.full((len(prior) // 10, 10), np.inf))
    frames = ~np.repeat(prior.reshape(-1, 10).any(axis=1), 10)
    names = tuple(f"{k + 1}" for k in range(len(prior) // 10)) if bodies is None else tuple(bodies)
    links = _Nearest(Fitting(base, psi, scaled_root(C), rotors, known, frames), physical, names, prior)
    problem = links.problem(of_rotors=False)
    width = problem.width if width is None else width
    if known.used:
        with_prior = links.problem(of_rotors=False, with_prior=True)
        closest = links.report(with_prior.bodies(max(width, NEAREST) if width else 0.0))
    else:
        closest = links.report(problem.bodies(width))
    for kept in () if masses is None or known.used else (masses * factor for factor in LOOSER):
        hidden = closest.unseen & (np.abs(closest.phi - physical)[::10] > masses * physical[::10])
        if not hidden.any():
            break
        with_masses = problem.with_rows(links.of_masses(np.where(closest.unseen, kept, np.inf) * physical[::10]))
        beside = links.report(with_masses.bodies(problem.width))
        if beside.attainable >= closest.attainable and beside.distance**2 <= closest.distance**2 + region(1):
            closest = beside
            break
    if rotors.names and not closest.attainable:
        turning = links.problem(of_rotors=True, with_prior=known.used)
        apart = links.report(turning.bodies(NEAREST if known.used else turning.width))
        closest, problem = (apart, turning) if apart.distance < closest.distance else (closest, problem)
    unlikely = np.abs(np.log(closest.phi[::10] / physical[::10])) > np.log(LIKELY)
    if masses is not None and not (known.used or closest.attainable) and unlikely.any():
        held = links.of_masses(np.where(unlikely, HELD, np.inf) * physical[::10], of_rotors=bool(closest.rotors))
        closest = links.report(problem.with_rows(held).bodies(problem.width))
    return closest


@dataclass(frozen=True, eq=False)
class _Nearest:
    """Problems of finding bodies `L K Lᵀ` and rotors, and reports on them."""

    fitting: Fitting
    physical: np.ndarray
    names: tuple[str, ...]
    model: np.ndarray

    @cached_property
    def L(self) -> np.ndarray:
        """Roots of the physical prior's pseudo-inertias (b, 4, 4)."""
        return np.linalg.cholesky(pseudo_inertia(self.physical.reshape(-1, 10)))

    @property
    def _sizes(self) -> np.ndarray:
        """Prior of the rotors: the model's, or as much as the model's bodies have of what the rotors add to (k,)."""
        own, rotors = self.fitting.base.regroup(self.physical), self.fitting.rotors
        links = np.abs(own @ rotors.columns) / np.maximum(np.sum(rotors.columns**2, axis=0), 1e-300)
        return np.where(rotors.stated > 0, rotors.stated, np.maximum(links, 1e-9))

    def problem(self, *, of_rotors: bool, with_prior: bool = False) -> NearestBodies:
        """Problem of ψ, with rotors as stated or free, and of the prior."""
        rows, prior, bodies = self.fitting.rows, self.fitting.prior, 10 * len(self.L)
        if with_prior:
            rows = np.vstack([rows, np.c_[prior.rows, prior.right]])
        if of_rotors:
            return NearestBodies.in_units(rows[:, :-1], rows[:, -1], self.L, self._sizes)
        right = rows[:, -1] - rows[:, bodies:-1] @ self.fitting.rotors.stated
        return NearestBodies.in_units(rows[:, :bodies], right, self.L, np.zeros(0))

    def of_masses(self, std: np.ndarray, *, of_rotors: bool = False) -> NearestBodies:
        """Prior of masses with standard deviations, infinite for unknown ones (b,)."""
        known, sizes = np.flatnonzero(np.isfinite(std) & (std > 0)), self._sizes[: None if of_rotors else 0]
        rows = np.zeros((len(known), 10 * len(std) + len(sizes)))
        rows[range(len(known)), 10 * known] = 1 / std[known]
        return NearestBodies.in_units(rows, rows @ np.r_[self.physical, 0 * sizes], self.L, sizes)

    def report(self, K: np.ndarray) -> ConsistentParameters:
        """Result for bodies `L K Lᵀ`, after which those of rotors may come."""
        fit, rotors, b = self.fitting, self.fitting.rotors, len(self.L)
        phi = parameters_from_pseudo_inertia(self.L @ K[:b] @ np.swapaxes(self.L, -1, -2)).ravel()
        x = K[b:, 0, 0] * self._sizes if len(K) > b else rotors.stated
        psi, eigenvalues = fit.base.regroup(phi) + rotors.columns @ (x - rotors.stated), np.linalg.eigvalsh(K[:b])
        distance = float(np.linalg.norm(linalg.solve_triangular(fit.root, psi - fit.psi, lower=True)))
        return ConsistentParameters(
            phi=phi,
            psi=psi,
            names=fit.base.names,
            attainable=bool(distance**2 <= region(fit.base.rank)),
            distance=distance,
            shift=(psi - fit.psi) / np.linalg.norm(fit.root, axis=1),
            divergence=np.sum(eigenvalues - 1 - np.log(eigenvalues), axis=1),
            mass_std=self.problem(of_rotors=False).std(K[:b], self.L[:, 3]),
            bodies=self.names,
            model=self.model,
            rotors=dict(zip(rotors.names, x.tolist(), strict=True)) if len(K) > b else {},
            fitting=fit,
        )


def physical_prior(phi: np.ndarray, *, bodies: Sequence[str] | None = None) -> np.ndarray:
    """The φ made physical (10 b,).

    Masses and central second moments of bodies with less, of massless ones and of those with impossible moments are
    raised to those of a body of `LEAST_SIZE` of the whole tree.

    Args:
        phi: φ of all bodies (10 b,).
        bodies: Names of the bodies, for messages.

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
    smallest, lightest = LEAST_SIZE**2 * second.sum() / mass.sum() / 3, LEAST_SIZE**3 * mass.sum()
    for k, m in enumerate(mass.tolist()):
        com, heavy = (J[k, :3, 3] / m if m > 0 else np.zeros(3)), max(m, lightest)
        values, axes = np.linalg.eigh(J[k, :3, :3] - m * np.outer(com, com))
        if m < heavy or (values < heavy * smallest).any():
            central = (axes * np.maximum(values, heavy * smallest)) @ axes.T
            J[k] = heavy * np.outer(*2 * [np.append(com, 1)])
            J[k, :3, :3] += central
    return parameters_from_pseudo_inertia(J).ravel()


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
