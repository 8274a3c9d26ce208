"""Confidence intervals of masses, centres of mass and inertias over all physical bodies that an estimate allows.

An interval has the values of all bodies whose squared Mahalanobis distance from the estimate exceeds the least one of
physical bodies by at most 3.84: the profile likelihood over the cone of physical bodies. It contains the truth in 95 %
or more of cases, also where ψ leaves a parameter free, or the nearest bodies are at the edge of the cone.

A prior of bodies adds what it says of the parameters that ψ leaves free. With φ = φ_0 + Rᵀ z, rotors x = x_0 + σ ζ, and
z and ζ standard normal, ψ = B φ + a x depends on `H [z; ζ]` alone. An estimate of ψ that includes the prior says all of
that; what the prior adds are the combinations across H.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import linalg

from ident.geometry import inertia
from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.extremes import EXACT, maxima, traces
from ident.parameters.nearest_bodies import UNITS, NearestBodies, region
from ident.parameters.prior import KNOWN, LEAST_KNOWN, UNKNOWN, body_covariance, guessed, known_covariances, unstated

NEAREST = 30.0
"""Width of the divergence that keeps the nearest bodies inside the cone; their squared distance is above the least one
by .01 for each unit of divergence."""

SKEWED = 1.25
"""Factor on the excess of 3.84 where a prior is used: normal deviations of a centre of mass are not normal ones of φ,
and intervals of centres of simulated persons had the truth in 92 % of cases without it."""


@dataclass(frozen=True, eq=False)
class Rotors:
    """Rotor inertias without columns of their own, which ψ contains.

    Attributes:
        names: Their names, `Ia(joint)`.
        columns: What a unit of each adds to ψ (r, k).
        stated: The model's values, which the given ψ has already lost (k,).
    """

    names: tuple[str, ...]
    columns: np.ndarray
    stated: np.ndarray

    @classmethod
    def of(cls, absorbed: Mapping[str, np.ndarray], stated: np.ndarray, rank: int) -> "Rotors":
        """Rotors among absorbed drives and the model's values of these (d,)."""
        each = [
            (name, own[:rank], x)
            for (name, own), x in zip(absorbed.items(), stated.tolist(), strict=True)
            if name.startswith("Ia(") and own[:rank].any()
        ]
        columns = np.reshape([own for _, own, _ in each], (-1, rank)).T
        return cls(tuple(name for name, _, _ in each), columns, np.array([x for _, _, x in each]))

    @classmethod
    def none(cls, rank: int) -> "Rotors":
        """No rotors."""
        return cls.of({}, np.zeros(0), rank)


@dataclass(frozen=True, eq=False)
class BodyPrior:
    """Prior of bodies.

    Attributes:
        std: Standard deviations of mass, centre of mass and inertia about the frame's origin, infinite where the model
            states none (b, 10).
        rows: Combinations of φ and of rotors that the prior knows beside ψ, in standard deviations; none if it was not
            used (k, 10 b + rotors).
        right: Their values by the model (k,).
    """

    std: np.ndarray
    rows: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    right: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def used(self) -> bool:
        """True if the estimate includes the prior."""
        return bool(len(self.right))

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        base: BaseParameters,
        known: Mapping[str, float],
        rotors: Rotors,
        *,
        used: bool,
        at: np.ndarray | None = None,
    ) -> "BodyPrior":
        """Prior of a mechanism's bodies.

        Args:
            mechanism: The mechanism.
            base: The regrouping behind ψ.
            known: Standard deviations, as for `body_covariance`.
            rotors: Rotors that ψ contains.
            used: True if the estimate of ψ includes the prior.
            at: φ of the bodies about which it is linear, by default the model's (10 b,).
        """
        own = [{**KNOWN, **known, **mechanism.prior_known.get(name, {})} for name in mechanism.bodies]
        phi, covariances = mechanism.known.reshape(-1, 10), known_covariances(mechanism, known)
        std = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        std[:, 0] = [each["mass"] * mass for each, mass in zip(own, phi[:, 0], strict=True)]
        std[:, 1:4] = [[each["center"]] * 3 for each in own]
        std[phi[:, 0] == 0] = 0
        new = unstated(mechanism)
        std[new] = np.inf
        if not used:
            return cls(std)
        mean = phi.copy()
        for k in np.flatnonzero(~new & (phi[:, 0] > 0)).tolist():
            center = phi if at is None else at.reshape(-1, 10)
            mean[k], covariances[k] = _linearised(phi[k], center[k], own[k])
        roots = _roots(covariances, float(guessed(mechanism)[::10].sum()))
        columns = linalg.block_diag(*roots, np.diag(_rotor_std(base, roots, rotors)))
        H = np.hstack([base.regroup(np.eye(phi.size)).T, rotors.columns]) @ columns
        across = linalg.null_space(H / np.maximum(np.linalg.norm(H, axis=1), 1e-300)[:, None]).T
        rows = linalg.solve(columns.T, across.T).T
        return cls(std, rows, rows @ np.r_[mean.ravel(), rotors.stated])


def _linearised(phi: np.ndarray, at: np.ndarray, known: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a body's φ by a prior with normal mass, centre and central inertia, (10,), (10, 10).

    Args:
        phi: φ by the model.
        at: φ about which first moments and inertias are linear in them.
        known: Standard deviations, as for `body_covariance`.
    """
    model, here = ([np.array(x) for x in inertia.com_from_parameters(each)] for each in (phi, at))
    # φ is cubic in mass, centre and inertia, so that five points give its derivative exactly.
    path = [
        inertia.parameters_from_com(*(x + h * (own - x) for own, x in zip(model, here, strict=True)))
        for h in range(-2, 3)
    ]
    change = (8 * (path[3] - path[1]) - (path[4] - path[0])) / 12
    relative = {key: known[key] for key in KNOWN} | {"mass": known["mass"] * phi[0] / at[0]}
    return at + change, body_covariance(at, relative)


def _roots(covariances: np.ndarray, mass: float) -> np.ndarray:
    """Triangular roots of the covariances of φ, positive definite also for frames and points (b, 10, 10)."""
    least = LEAST_KNOWN * mass * np.repeat([1, 1e-1, 1e-2], [1, 3, 6])
    std = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2) + least**2)
    correlation = covariances / std[:, :, None] / std[:, None]
    correlation[:, range(10), range(10)] = 1 + 1e-10
    return np.asarray(std[:, :, None] * np.linalg.cholesky(correlation))


def _rotor_std(base: BaseParameters, roots: np.ndarray, rotors: Rotors) -> np.ndarray:
    """Standard deviations of rotors: what is stated, else as good as none (k,)."""
    rows = base.regroup(np.eye(len(base.parameters))).T @ linalg.block_diag(*roots)
    open_ = UNKNOWN * np.linalg.norm(rows) / np.maximum(np.linalg.norm(rotors.columns, axis=0), 1e-300)
    return np.where(rotors.stated > 0, rotors.stated, open_)


@dataclass(frozen=True, eq=False)
class Fitting:
    """Conditions on bodies and rotors: an estimate of ψ, and a prior.

    Attributes:
        base: The regrouping behind ψ.
        psi: ψ, without the model's values of the rotors (r,).
        root: Lower triangular root of its covariance (r, r).
        rotors: Rotors that ψ contains.
        prior: Prior of bodies in addition.
        frames: Mask of the parameters of frames, which have no mass (10 b,).
    """

    base: BaseParameters
    psi: np.ndarray
    root: np.ndarray
    rotors: Rotors
    prior: BodyPrior
    frames: np.ndarray

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows of unit variance: derivatives of ψ by φ and rotors, and ψ with all of the rotors (r, 10 b + k + 1)."""
        of_links, rotors = self.base.regroup(np.eye(len(self.frames))).T, self.rotors
        of_links[:, self.frames] = 0
        psi = self.psi + rotors.columns @ rotors.stated
        return linalg.solve_triangular(self.root, np.c_[of_links, rotors.columns, psi], lower=True)

    def bounds(self, phi: np.ndarray) -> np.ndarray:
        """Intervals of mass, centre of mass and inertia about the frame's origin of each body (b, 10, 2).

        They are infinite where nothing bounds a parameter, and NaN where no physical bodies fit.

        Args:
            phi: Physical bodies to start from, zeros for frames, which have no mass (10 b,).
        """
        rows, right, has_mass = self.rows[:, :-1], self.rows[:, -1], phi[::10] > 0
        kept, out = np.repeat(has_mass, 10), np.zeros((len(has_mass), 10, 2))
        if not self.prior.used:
            of_rotors = np.ones(rows.shape[1] - len(phi), bool)
            problem = _InUnits.of(rows[:, np.r_[kept, of_rotors]], right, phi[kept])
            attainable = problem.square <= region(len(right))
            out[has_mass] = _bounds([problem], region(1))[0] if attainable else np.nan
            return out
        mean, covariance = _solved(np.vstack([rows, self.prior.rows]), np.r_[right, self.prior.right])
        own = [slice(10 * k, 10 * k + 10) for k in np.flatnonzero(has_mass).tolist()]
        whitenings = [np.linalg.inv(scaled_root(covariance[k, k])) for k in own]
        problems = [_InUnits.of(root, root @ mean[k], phi[k]) for root, k in zip(whitenings, own, strict=True)]
        out[has_mass] = _bounds(problems, SKEWED * region(1))[:, 0]
        return out


def _solved(rows: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares of independent columns: the solution and its covariance."""
    sizes = np.linalg.norm(rows, axis=0)
    Q, R = np.linalg.qr(rows / sizes)
    inverse = linalg.solve_triangular(R, np.eye(len(R)))
    return inverse @ (Q.T @ right) / sizes, inverse @ inverse.T / np.outer(sizes, sizes)


def scaled_root(covariance: np.ndarray) -> np.ndarray:
    """Lower triangular root of a covariance, computed from its correlation matrix."""
    std = np.sqrt(np.diag(covariance))
    return np.asarray(std[:, None] * np.linalg.cholesky(covariance / np.outer(std, std)))


@dataclass(frozen=True, eq=False)
class _InUnits:
    """Conditions `|rows [φ; x] - right|²` on bodies and rotors in units of those that are nearest.

    Attributes:
        rows: Rows in the basis `UNITS`, then of rotors (r, 10 b + k).
        right: Right sides (r,).
        forms: φ of the bodies of the basis (b, 10, 10).
        square: The squared distance of the nearest ones.
    """

    rows: np.ndarray
    right: np.ndarray
    forms: np.ndarray
    square: float

    @classmethod
    def of(cls, rows: np.ndarray, right: np.ndarray, phi: np.ndarray) -> "_InUnits":
        """Conditions in units of the nearest bodies, for the search of which a start is given."""
        b = len(phi) // 10
        L = np.linalg.cholesky(pseudo_inertia(phi.reshape(-1, 10)))
        x = 1 / np.maximum(np.linalg.norm(rows[:, 10 * b :], axis=0), 1e-300)
        x *= np.maximum(np.abs(rows[:, : 10 * b] @ phi).max(), 1.0)
        K = NearestBodies.in_units(rows, right, L, x).bodies(NEAREST)
        L, x = L @ np.linalg.cholesky(K[:b]), x * K[b:, 0, 0]
        forms = parameters_from_pseudo_inertia(L[:, None] @ UNITS @ np.swapaxes(L, -1, -2)[:, None])
        of_bodies = np.einsum("rbp,bup->rbu", rows[:, : 10 * b].reshape(-1, b, 10), forms)
        A = np.hstack([of_bodies.reshape(len(rows), -1), rows[:, 10 * b :] * x])
        return cls(A, right, forms, float(np.sum((A @ traces(b, len(x)) - right) ** 2)))


def _bounds(problems: Sequence[_InUnits], room: float) -> np.ndarray:
    """Bounds of bodies of some problems with squared distances within some room of the least (c, b, 10, 2)."""
    rows, right = np.array([each.rows for each in problems]), np.array([each.right for each in problems])
    forms, square = np.array([each.forms for each in problems]), np.array([each.square for each in problems])
    c, b = forms.shape[:2]
    f, d = np.zeros((2, c, 2, b, 10, rows.shape[2]))
    for k in range(b):
        own = slice(10 * k, 10 * k + 10)
        f[:, 1, k, :, own] = forms[:, k].swapaxes(1, 2)
        d[:, :, k, 1:4, own] = forms[:, k, None, None, :, 0]
    f[:, 0] = -f[:, 1]
    out = maxima(rows, right, square + room, b, f.reshape(20 * b * c, -1), d.reshape(20 * b * c, -1))
    out = np.moveaxis(out.reshape(c, 2, b, 10), 1, 3) * [-1, 1]
    # Mass and moments of inertia are positive; what is far below that of the nearest body is as good as zero.
    positive, least = [0, 4, 5, 6], EXACT * np.einsum("u,cbuk->cbk", traces(1, 0), forms)
    out[:, :, positive, 0] = np.where(out[..., 0] > least, out[..., 0], 0)[:, :, positive]
    return out
