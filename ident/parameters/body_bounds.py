"""Confidence intervals of masses, centres of mass and inertias over all physical bodies that an estimate allows.

An interval has the values of all bodies whose squared Mahalanobis distance from the estimate exceeds the least one of
physical bodies by at most 3.84: the profile likelihood over the cone of physical bodies. It contains the truth in 95 %
or more of cases, also where ψ leaves a parameter free, or the nearest bodies are at the edge of the cone.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia
from ident.parameters.body_prior import BodyPrior
from ident.parameters.consistent_set import UNITS, ConsistentSet, traces
from ident.parameters.nearest_bodies import ROOM, NearestBodies, region

NEAREST = 30.0
"""Width of the divergence that keeps the nearest bodies inside the cone; their squared distance is above the least one
by .01 for each unit of divergence."""

SKEWED = 1.25
"""Factor on the excess of 3.84 where a prior is used: normal deviations of a centre of mass are not normal ones of φ,
and intervals of centres of simulated persons had the truth in 92 % of cases without it."""


@dataclass(frozen=True, eq=False)
class Fitting:
    """Conditions on bodies and rotors: an estimate of ψ, and a prior.

    Attributes:
        B: Derivative of ψ by φ and by rotors (r, 10 b + k).
        psi: ψ (r,).
        root: Lower triangular root of its covariance (r, r).
        prior: Prior of bodies in addition.
        rotors: Number of rotors k.
    """

    B: np.ndarray
    psi: np.ndarray
    root: np.ndarray
    prior: BodyPrior
    rotors: int

    def bounds(self, phi: np.ndarray) -> np.ndarray:
        """Intervals of mass, centre of mass and inertia about the frame's origin of each body (b, 10, 2).

        They are infinite where nothing bounds a parameter, and NaN where no physical bodies fit.

        Args:
            phi: Physical bodies to start from, zeros for frames, which have no mass (10 b,).
        """
        rows, right = (
            linalg.solve_triangular(self.root, self.B, lower=True),
            linalg.solve_triangular(self.root, self.psi, lower=True),
        )
        has_mass = phi[::10] > 0
        kept, out = np.repeat(has_mass, 10), np.zeros((len(has_mass), 10, 2))
        if not self.prior.used:
            of_rotors = np.ones(rows.shape[1] - len(phi), bool)
            out[has_mass] = _bounds(rows[:, np.r_[kept, of_rotors]], right, phi[kept], ROOM, region(len(right)))
            return out
        mean, covariance = _solved(np.vstack([rows, self.prior.rows]), np.r_[right, self.prior.right])
        for k in np.flatnonzero(has_mass).tolist():
            own = slice(10 * k, 10 * k + 10)
            whitening = np.linalg.inv(scaled_root(covariance[own, own]))
            out[k] = _bounds(whitening, whitening @ mean[own], phi[own], SKEWED * ROOM, np.inf)[0]
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


def _bounds(rows: np.ndarray, right: np.ndarray, phi: np.ndarray, room: float, largest: float) -> np.ndarray:
    """Bounds of bodies with `|rows [φ; x] - right|²` within some room of the least; NaN if that is too large."""
    b = len(phi) // 10
    L = np.linalg.cholesky(pseudo_inertia(phi.reshape(-1, 10)))
    x = 1 / np.maximum(np.linalg.norm(rows[:, 10 * b :], axis=0), 1e-300)
    x *= np.maximum(np.abs(rows[:, : 10 * b] @ phi).max(), 1.0)
    K = NearestBodies.in_units(rows, right, L, x).bodies(NEAREST)
    L, x = L @ np.linalg.cholesky(K[:b]), x * K[b:, 0, 0]
    forms = _forms(L)
    A = np.hstack(
        [
            np.einsum("rbp,bup->rbu", rows[:, : 10 * b].reshape(-1, b, 10), forms).reshape(len(rows), -1),
            rows[:, 10 * b :] * x,
        ]
    )
    square = float(np.sum((A @ traces(b, len(x)) - right) ** 2))
    if square > largest:
        return np.full((b, 10, 2), np.nan)
    f, d = np.zeros((2, b, 10, A.shape[1]))
    for k in range(b):
        f[k, :, 10 * k : 10 * k + 10] = forms[k].T
        d[k, 1:4, 10 * k : 10 * k + 10] = forms[k][:, 0]
    f, d = f.reshape(10 * b, -1), d.reshape(10 * b, -1)
    maxima = ConsistentSet(A, right, square + room, b).maxima(np.vstack([-f, f]), np.vstack([d, d])).reshape(2, b, 10)
    maxima[0] *= -1
    # Mass and moments of inertia are positive.
    maxima[0][:, [0, 4, 5, 6]] = np.maximum(maxima[0][:, [0, 4, 5, 6]], 0)
    return np.moveaxis(maxima, 0, -1)


def _forms(L: np.ndarray) -> np.ndarray:
    """φ of the bodies `L U Lᵀ` for all U of the basis (b, 10, 10)."""
    return parameters_from_pseudo_inertia(L[:, None] @ UNITS @ np.swapaxes(L, -1, -2)[:, None])
