"""Convex problems over all physical bodies that fit, by Newton's method: those nearest to a prior, and extremes.

    minimise   |A K - ψ|²/2 + μ Σ (tr K - log det K)

    maximise   f·v   or   f·v / d·v    over    |A v - y|² ≤ ρ²,    K_i positive definite,    x ≥ 0

v has the pseudo-inertias K_i of bodies and the rotor inertias x. Minima of the logarithmic barrier for growing
weights t of the objective lead to the maximum, from which the last two are proportionally far. In axes in which K is
the identity, so is the Hessian of the bodies' barrier, and Newton's step needs as many equations as A has rows. Many
parameters are maximised at once.
"""

from functools import cached_property

import numpy as np
from scipy import linalg, special

from ident.geometry.inertia import parameters_from_pseudo_inertia
from ident.tolerances import AT_ONCE, INTERVAL, ROUNDING

FINEST = 0.8
"""The continuation towards the prior's width stops when a step can only reduce the weight by a factor above this."""

NEWTON_STEPS = 80
"""Largest number of Newton steps; 10 are usual for a minimum, 17 for a maximum."""

FACTOR, WEIGHTS = 25.0, 3
"""Factor between successive weights, and their number: the last two lead to bounds that are right to 1e-3 of their
distance."""

CENTRED = 0.3
"""Squared Newton decrement at which a minimum of the barrier is near enough."""

LARGEST, UNBOUNDED, BY_TRACE = 100.0, 30.0, 0.05
"""Largest trace of all bodies together, over that of the start, which keeps what nothing bounds from going on; value,
over the start's size, above which nothing bounds it, as no body is wrong by a factor of thirty; and growth of the value
with the largest trace, over its distance from the start, both relative, above which that alone bounds it."""

LENGTHS = np.array([0.99, 0.97, 0.93, 0.85, 0.7, 0.5, 0.3, 0.15, 0.07, 0.03, 0.01, 0.003])
"""Step lengths that are tried, over the longest one; a whole step is tried as well."""

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


def traces(bodies: int, rotors: int) -> np.ndarray:
    """Traces of the coordinates of bodies and rotors, which are those of K = 1 and x = 1 as well (10 b + k,)."""
    return np.r_[np.tile(np.trace(UNITS, axis1=1, axis2=2), bodies), np.ones(rotors)]


def maxima(A: np.ndarray, y: np.ndarray, square: float, bodies: int, f: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Maxima of `f·v / d·v` over all physical bodies and rotors with `|A v - y|² ≤ square`.

    Units are those of some of them: K = 1 and x = 1 fit.

    Args:
        A: Rows: ten entries in the basis `UNITS` for each body, then one for each rotor (r, 10 b + k).
        y: Right sides (r,).
        square: Largest squared distance.
        bodies: Number of bodies b.
        f: Numerators (N, 10 b + k).
        d: Denominators, positive for all physical bodies; zeros for one (N, 10 b + k).

    Returns:
        The maxima (N,), infinite where nothing bounds them, or where rounding ends the search.
    """
    at_once = max(1, AT_ONCE // A.size)
    parts = [slice(k, k + at_once) for k in range(0, len(f), at_once)]
    return np.concatenate([np.zeros(0), *(_Search(A, y, square, bodies, f[k], d[k]).maxima() for k in parts)])


class _Search:
    """Newton's method on the barriers of several objectives side by side."""

    def __init__(self, A: np.ndarray, y: np.ndarray, square: float, b: int, f: np.ndarray, d: np.ndarray) -> None:
        self.y, self.square, self.b, self.f, self.d = y, square, b, f, d
        self.one = np.where(d.any(axis=1), 0.0, 1.0)
        size = np.linalg.norm(f, axis=1) / (self.one + np.linalg.norm(d, axis=1))
        self.limit, self.trace = UNBOUNDED * size, traces(b, A.shape[1] - 10 * b)
        self.rows, self.largest = np.vstack([A, self.trace]), LARGEST * float(self.trace @ self.trace)
        self.of_bodies = self.rows[:, : 10 * b].reshape(-1, b, 10).swapaxes(0, 1)
        self.G, self.x = np.tile(np.eye(4), (len(f), b, 1, 1)), np.ones((len(f), A.shape[1] - 10 * b))
        self.t, self.values = np.zeros(len(f)), np.full((len(f), WEIGHTS), np.nan)
        start = self._value(np.arange(len(f)), np.tile(self.trace, (len(f), 1)))
        self.first, self.growth = start, np.zeros(len(f))

    def maxima(self) -> np.ndarray:
        stage, out = np.zeros(len(self.f), int), np.full(len(self.f), np.inf)
        active = np.arange(len(self.f))
        for _ in range(NEWTON_STEPS):
            if not len(active):
                break
            try:
                with np.errstate(all="ignore"):
                    near, value = self._step(active)
            except np.linalg.LinAlgError:
                break
            reached = active[near]
            self.values[reached, stage[reached]] = value[near]
            self.t[reached] *= FACTOR
            stage[reached] += 1
            active = active[(stage[active] < WEIGHTS) & (value < self.limit[active])]
        before, last = self.values[stage == WEIGHTS, -2:].T
        out[stage == WEIGHTS] = last + (last - before) / (FACTOR - 1)
        bounded = (out < self.limit) & (self.growth < BY_TRACE * (out - self.first))
        return np.where(bounded, out, np.inf)

    def _step(self, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Makes a Newton step of some objectives and returns which were near their minimum, and their values."""
        b, G, x = self.b, self.G[k], self.x[k]
        v = self._coordinates(G, x)
        scaled, f = self._in_own_units(k, v)
        reached = v @ self.rows.T
        u, slack = reached[:, :-1] - self.y, self.largest - reached[:, -1]
        uu = np.sum(u**2, axis=1)
        room = self.square - uu
        pull = np.concatenate([2 * u / room[:, None], 1 / slack[:, None]], axis=1)
        centre = self.trace - np.einsum("nr,nrj->nj", pull, scaled)
        both = np.stack([f, centre], axis=2)
        solved = both - scaled.swapaxes(1, 2) @ np.linalg.solve(
            _inverse(u, uu, room, slack) + scaled @ scaled.swapaxes(1, 2), scaled @ both
        )
        own = np.sum(f * solved[:, :, 0], axis=1)
        self.t[k] = np.where(self.t[k] == 0, 1 / np.sqrt(np.maximum(own, 1e-300)), self.t[k])
        t = self.t[k][:, None]
        step = t * solved[:, :, 0] + solved[:, :, 1]
        self.growth[k] = self.largest / (self.t[k] * slack * (self.one[k] + np.sum(self.d[k] * v, axis=1)))
        lost = ~np.isfinite(step).all(axis=1)
        step[lost] = 0
        near = np.sum((t * f + centre) * step, axis=1) < CENTRED
        E = np.tensordot(step[:, : 10 * b].reshape(-1, b, 10), UNITS, 1)
        along = np.einsum("nrj,nj->nr", scaled, step)
        length = _length(
            np.concatenate([np.linalg.eigvalsh(E).reshape(len(k), -1), step[:, 10 * b :]], axis=1),
            (room, np.sum(u * along[:, :-1], axis=1), np.sum(along[:, :-1] ** 2, axis=1)),
            along[:, -1] / slack,
            np.sum(t * f * step, axis=1),
        )
        length = np.nan_to_num(length)
        self.G[k] = G @ np.linalg.cholesky(np.eye(4) + length[:, None, None, None] * E)
        self.x[k] = x * (1 + length[:, None] * step[:, 10 * b :])
        return near & ~lost, np.where(lost, np.inf, self._value(k, self._coordinates(self.G[k], self.x[k])))

    def _in_own_units(self, k: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and gradients of some objectives at v in axes where their bodies are the identity, (N, r, …), (N, …)."""
        b, x, frames = self.b, self.x[k], _frames(self.G[k])
        f = self.f[k] - self._value(k, v)[:, None] * self.d[k]
        of_bodies = (self.of_bodies @ frames).swapaxes(1, 2).reshape(len(k), len(self.rows), -1)
        scaled = np.concatenate([of_bodies, self.rows[:, 10 * b :] * x[:, None]], axis=2)
        of_bodies = (f[:, : 10 * b].reshape(-1, b, 1, 10) @ frames).reshape(len(k), -1)
        return scaled, np.concatenate([of_bodies, f[:, 10 * b :] * x], axis=1)

    def _coordinates(self, G: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Coordinates v of bodies `G Gᵀ` and rotors (N, 10 b + k)."""
        of_bodies = np.tensordot(G @ G.swapaxes(-1, -2), UNITS, ((2, 3), (1, 2)))
        return np.concatenate([of_bodies.reshape(len(G), -1), x], axis=1)

    def _value(self, k: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Values of some objectives (N,)."""
        return np.asarray(np.sum(self.f[k] * v, axis=1) / (self.one[k] + np.sum(self.d[k] * v, axis=1)))


def _inverse(u: np.ndarray, uu: np.ndarray, room: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """Inverse Hessians of the barriers of the squared distance, `-log(ρ² - |u|²)`, and of the trace."""
    count, r = u.shape
    out = np.zeros((count, r + 1, r + 1))
    out[:, :r, :r] = np.eye(r) - (2 / (room + 2 * uu))[:, None, None] * u[:, :, None] * u[:, None]
    out *= room[:, None, None] / 2
    out[:, r, r] = slack**2
    return out


def _frames(G: np.ndarray) -> np.ndarray:
    """Matrices by which rows in the basis `UNITS` are multiplied for bodies `G K Gᵀ` instead of K (N, b, 10, 10)."""
    moved = G.swapaxes(-1, -2)[:, :, None] @ UNITS @ G[:, :, None]
    return np.asarray(moved.reshape(*G.shape[:2], 10, 16) @ UNITS.reshape(10, 16).T)


def _length(
    e: np.ndarray, square: tuple[np.ndarray, np.ndarray, np.ndarray], used: np.ndarray, gain: np.ndarray
) -> np.ndarray:
    """Step length of each objective with the least barrier, of those that are tried (N,).

    Args:
        e: Eigenvalues of the step in axes where bodies are the identity (N, 4 b + k).
        square: Room that is left of the largest squared distance, and what a step takes of it, `2 s, s²`, each (N,).
        used: Share of the trace's room that a step takes (N,).
        gain: Weighted gain of the objective (N,).
    """
    room, linear, quadratic = square
    quadratic = np.maximum(quadratic, 1e-300)
    longest = np.minimum(-1 / np.minimum(e.min(axis=1), -1e-12), 1 / np.maximum(used, 1e-12))
    to_sphere = (np.sqrt(linear**2 + quadratic * room) - linear) / quadratic
    longest = np.minimum(longest, to_sphere)[:, None]
    s = np.concatenate([longest * LENGTHS, np.where(longest > 1, 1.0, 0.5 * longest)], axis=1)
    left = room[:, None] - 2 * s * linear[:, None] - s**2 * quadratic[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        barrier = np.log(left) + np.log1p(-s * used[:, None]) + np.log1p(s[:, :, None] * e[:, None]).sum(axis=2)
    cost = np.where(np.isfinite(barrier), -gain[:, None] * s - barrier, np.inf)
    return np.asarray(s[range(len(s)), cost.argmin(axis=1)])
