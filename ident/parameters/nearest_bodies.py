"""Physical bodies nearest to a prior that fit, by a primal-dual interior-point method."""

from functools import cached_property

import numpy as np
from scipy import linalg, special

from ident.geometry.inertia import parameters_from_pseudo_inertia
from ident.tolerances import INTERVAL, ROUNDING

NEWTON_STEPS = 80
"""Largest number of Newton steps; 5 to 15 are usual."""

START, NEARLY = 0.1, 0.95
"""Multipliers at the start over the misfit's largest gradient, and length of a step over the one to the cone's edge: of
values from .03 to 10 and .9 to .97 those with which the fewest of 250 problems, some of them far from all physical
bodies, ended by rounding."""

PLACES = np.triu_indices(4)

UNITS = np.zeros((10, 4, 4))
"""Orthonormal basis of the symmetric matrices."""
UNITS[range(10), PLACES[0], PLACES[1]] = UNITS[range(10), PLACES[1], PLACES[0]] = np.sqrt(0.5)
UNITS[range(10), PLACES[0], PLACES[1]] **= np.where(PLACES[0] == PLACES[1], 0, 1)


class NearestBodies:
    """`min |A K - ψ|²/2 + μ Σ (tr K - log det K)` with μ = 1/w².

    At the minimum bodies K and multipliers λ satisfy `A K + λ = ψ` and `K Z = μ` with `Z = μ - A*λ`. Steps towards it
    are those of Mehrotra, in Nesterov-Todd axes, in which K and Z are the same diagonal matrix.

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
        width = self.width if width is None else width
        if width == 0:
            return self.prior
        mu, K, inside = width**-2, self.prior, self.prior
        multipliers = self.psi - np.tensordot(self.A, K, 3)
        Z = max(mu, START * np.abs(np.tensordot(multipliers, self.A, 1)).max()) * K
        for _ in range(NEWTON_STEPS):
            G, s = _common_axes(K, Z)
            if not s.all():
                return inside
            inside = K
            rest = mu * self.prior - np.tensordot(multipliers, self.A, 1) - Z
            axes = _Axes(self.A, G, self.psi - np.tensordot(self.A, K, 3) - multipliers, rest)
            dK, dZ, _ = axes.newton(_diagonal(mu / s - s), 1.0)
            length = min(1.0, _longest(dK, s), _longest(dZ, s))
            # The second step corrects the first one's curvature, and returns to the centre where that one was short.
            left = (1 - length) ** 2
            aim, bent = mu + left * (np.mean(s**2) - mu), dK @ dZ
            goal = _diagonal(aim / s - s) - (bent + np.swapaxes(bent, -1, -2)) / (s[:, :, None] + s[:, None])
            dK, dZ, step = axes.newton(goal, 1 - left)
            length = min(1.0, NEARLY * _longest(dK, s), NEARLY * _longest(dZ, s))
            K = K + length * G @ dK @ np.swapaxes(G, -1, -2)
            K = (K + np.swapaxes(K, -1, -2)) / 2
            Z = Z + length * ((1 - left) * rest - np.tensordot(step, self.A, 1))
            multipliers = multipliers + length * step
            # Errors are squared by a step.
            if length == 1 and max(np.abs(dK).max(), np.abs(dZ).max()) ** 2 < ROUNDING * mu:
                break
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


def _diagonal(s: np.ndarray) -> np.ndarray:
    return np.asarray(s[..., None] * np.eye(4))


class _Axes:
    """Newton's steps in axes in which K and Z are the same diagonal matrix.

    Attributes:
        rows: A in these axes (r, b, 4, 4).
        misfit: `ψ - A K - λ` (r,).
        rest: `μ - A*λ - Z` in these axes (b, 4, 4).
        triangle: Root of `rows rows* + 1` (r, r).
    """

    def __init__(self, A: np.ndarray, G: np.ndarray, misfit: np.ndarray, rest: np.ndarray) -> None:
        self.rows, self.misfit, self.rest = np.swapaxes(G, -1, -2) @ A @ G, misfit, np.swapaxes(G, -1, -2) @ rest @ G
        of_units = np.tensordot(self.rows, UNITS, ((2, 3), (1, 2))).reshape(len(A), -1)
        stacked = np.vstack([of_units.T, np.eye(len(A))])
        self.triangle = linalg.qr(stacked, mode="r", overwrite_a=True, check_finite=False)[0][: len(A)]

    def newton(self, goal: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Steps of K, Z and λ, the first two with a sum of `goal`, that leave out all but a share of the residuals."""
        right = share * self.misfit - np.tensordot(self.rows, goal - share * self.rest, 3)
        step = linalg.solve_triangular(self.triangle, linalg.solve_triangular(self.triangle, right, trans="T"))
        dZ = share * self.rest - np.tensordot(step, self.rows, 1)
        return goal - dZ, dZ, step


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
