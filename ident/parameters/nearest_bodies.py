"""Physical bodies nearest to a prior that fit, by Newton's method."""

from functools import cached_property

import numpy as np
from scipy import linalg, special

from ident.geometry.inertia import parameters_from_pseudo_inertia
from ident.tolerances import INTERVAL, ROUNDING

FINEST = 0.8
"""The continuation towards the prior's width stops when a step can only reduce the weight by a factor above this."""

NEWTON_STEPS = 80
"""Largest number of Newton steps; 10 are usual."""

PLACES = np.triu_indices(4)

UNITS = np.zeros((10, 4, 4))
"""Orthonormal basis of the symmetric matrices."""
UNITS[range(10), PLACES[0], PLACES[1]] = UNITS[range(10), PLACES[1], PLACES[0]] = np.sqrt(0.5)
UNITS[range(10), PLACES[0], PLACES[1]] **= np.where(PLACES[0] == PLACES[1], 0, 1)


class NearestBodies:
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
    def in_units(cls, rows: np.ndarray, right: np.ndarray, L: np.ndarray, x: np.ndarray) -> "NearestBodies":
        """The problem `|rows [φ; x] - right|²` in coordinates where the prior `L Lᵀ` and rotors are the identity.

        Args:
            rows: Derivatives of independent unit variances by φ and by rotors (r, 10 b + k).
            right: Their values (r,).
            L: Roots of the prior's pseudo-inertias (b, 4, 4).
            x: Prior of the rotors, each of which is an entry of a body of its own (k,).
        """
        b = len(L)
        A = np.zeros((len(rows), b + len(x), 4, 4))
        A[:, :b] = _forms(rows[:, : 10 * b].reshape(-1, b, 10), L)
        A[:, b:, 0, 0] = rows[:, 10 * b :] * x
        return cls(A, right)

    def with_rows(self, other: "NearestBodies") -> "NearestBodies":
        """The problem with the conditions of another one in addition."""
        return NearestBodies(np.concatenate([self.A, other.A]), np.append(self.psi, other.psi))

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
            minimum = self._minimiser(K, multipliers, following)
            if minimum is None:
                ratio = np.sqrt(ratio)
            else:
                (K, multipliers), mu, ratio = minimum, following, max(0.1, ratio**2)
        return K

    @cached_property
    def width(self) -> float:
        """Estimated width of the prior: the largest w in the 95 % interval, for a misfit of covariance `1 + w² A A*`.

        If the interval contains zero, the smallest w whose remaining misfit is in the confidence region: zero, unless a
        few combinations alone contradict the prior.
        """
        misfit = self.psi - np.tensordot(self.A, self.prior, 3)
        values, axes = np.linalg.eigh(np.tensordot(self.A, self.A, ((1, 2, 3), (1, 2, 3))))
        squares = np.append(0, np.geomspace(1e-2 / values[-1], 1e12, 1000))
        variances = 1 + np.outer(squares, np.maximum(values, 0))
        pulls = (axes.T @ misfit) ** 2
        unlikely = np.sum(np.log(variances) + pulls / variances, axis=1)
        allowed = squares[unlikely <= unlikely.min() + region(1)]
        enough = squares[np.sum(pulls / variances**2, axis=1) <= region(len(misfit))]
        return float(np.sqrt(allowed[-1] if allowed[0] or not len(enough) else enough[0]))

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
            if length == 1 and max(np.abs(dK).max(), np.abs(dZ).max()) < ROUNDING:
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


def region(parameters: int) -> float:
    """Largest squared Mahalanobis distance within the region that is as probable as `INTERVAL`: 3.84 for one."""
    return float(special.chdtri(parameters, special.chdtrc(1, INTERVAL**2)))


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


def _forms(rows: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Symmetric matrices (r, b, 4, 4) whose products with K are rows (r, b, 10) times φ of the bodies `L K Lᵀ`."""
    units = np.eye(16).reshape(16, 4, 4)
    units = (units + np.swapaxes(units, -1, -2)) / 2
    phi = parameters_from_pseudo_inertia(L[:, None] @ units @ np.swapaxes(L, -1, -2)[:, None])
    return np.einsum("rbp,bkp->rbk", rows, phi).reshape(len(rows), len(L), 4, 4)
