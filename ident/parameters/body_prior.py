"""Prior of bodies in addition to an estimate of ψ: what it says of the parameters that ψ leaves free.

With φ = φ_0 + Rᵀ z, rotors x = x_0 + σ ζ, and z and ζ standard normal, ψ = B φ + a x depends on `H [z; ζ]` alone. An
estimate of ψ that includes the prior says all of that; what the prior adds are the combinations across H.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg

from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.prior import DRIVE_KNOWN, KNOWN, UNKNOWN, body_covariance, known_covariances
from ident.parameters.unstated import guessed, unstated

LEAST = 1e-4
"""Least standard deviation of a prior, over the default one, which stands for what is known exactly."""

STEP = 1e-3
"""Step of a central difference, over the difference from the model: φ is cubic in mass, centre and inertia."""

WITHOUT_MASS = 1e-6
"""Standard deviation of a frame's mass, over the mass of all bodies, with lengths of a metre."""


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
    model, here = ([np.array(x) for x in com_from_parameters(each)] for each in (phi, at))
    ahead, behind = (
        parameters_from_com(*(x + h * (own - x) for own, x in zip(model, here, strict=True))) for h in (STEP, -STEP)
    )
    exact = {key: max(known[key], LEAST * KNOWN[key]) for key in KNOWN}
    return at + (ahead - behind) / (2 * STEP), body_covariance(at, {**exact, "mass": exact["mass"] * phi[0] / at[0]})


def _roots(covariances: np.ndarray, mass: float) -> np.ndarray:
    """Triangular roots of the covariances of φ, positive definite also for frames and points (b, 10, 10)."""
    least = WITHOUT_MASS * mass * np.repeat([1, 1e-1, 1e-2], [1, 3, 6])
    std = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2) + least**2)
    correlation = covariances / std[:, :, None] / std[:, None]
    correlation[:, range(10), range(10)] = 1 + 1e-10
    return np.asarray(std[:, :, None] * np.linalg.cholesky(correlation))


def _rotor_std(base: BaseParameters, roots: np.ndarray, rotors: Rotors) -> np.ndarray:
    """Standard deviations of rotors: `DRIVE_KNOWN` of what is stated, else as good as none (k,)."""
    rows = base.regroup(np.eye(len(base.parameters))).T @ linalg.block_diag(*roots)
    open_ = UNKNOWN * np.linalg.norm(rows) / np.maximum(np.linalg.norm(rotors.columns, axis=0), 1e-300)
    return np.where(rotors.stated > 0, DRIVE_KNOWN * rotors.stated, open_)
