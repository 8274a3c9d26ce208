"""Largest values that parameters of physical bodies can have, by a primal-dual interior-point method.

    maximise   f·v    over    e·v = 1,    |A v - y h| ≤ ρ h,    K_i positive definite,    x ≥ 0

v has the pseudo-inertias K_i of bodies, rotor inertias x and one, all times h: e·v = h for masses, and h is one; for
centres of mass e·v is the mass. The dual problem bounds the maximum from above,

    minimise   β    over    β e - f = Eᵀz,    z in the same cones as E v,

and the two differ by z·E v. Steps are Mehrotra's, in Nesterov-Todd axes (Vandenberghe, "The CVXOPT linear and quadratic
cone program solvers", 2010). Many objectives are maximised at once.
"""

from typing import NamedTuple

import numpy as np

from ident.parameters.nearest_bodies import NEARLY, UNITS
from ident.tolerances import AT_ONCE, ROUNDING

STEPS = 60
"""Largest number of Newton steps; 12 are usual."""

EXACT, FLOOR = 1e-4, 0.01
"""Largest error of a maximum, over its size or, where that is less, over this share of its distance from the start."""

UNBOUNDED = 30.0
"""Value, over the start's size, above which nothing bounds it, as no body is wrong by a factor of thirty."""


class _Point(NamedTuple):
    """A point or direction in the cones: bodies (N, b, 4, 4), positive numbers (N, k), second-order cone (N, r)."""

    K: np.ndarray
    x: np.ndarray
    q: np.ndarray

    def plus(self, factors: np.ndarray, other: "_Point") -> "_Point":
        """The sum of this one and factors (N,) times another one."""
        return _Point(*(a + (c.T * factors).T for a, c in zip(self, other, strict=True)))

    def product(self, other: "_Point") -> "_Point":
        """Jordan product."""
        K, p, q = self.K @ other.K, self.q, other.q
        dots = np.sum(p * q, axis=1)[:, None]
        tail = p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:]
        return _Point((K + K.swapaxes(-1, -2)) / 2, self.x * other.x, np.concatenate([dots, tail], axis=1))

    def quotient(self, by: "_Point") -> "_Point":
        """The point whose product with another one, whose bodies are diagonal, is this one."""
        s, head, tail = np.diagonal(by.K, axis1=2, axis2=3), by.q[:, :1], by.q[:, 1:]
        first = (head * self.q[:, :1] - np.sum(tail * self.q[:, 1:], axis=1)[:, None]) / _determinant(by.q)
        q = np.concatenate([first, (self.q[:, 1:] - first * tail) / head], axis=1)
        return _Point(2 * self.K / (s[..., :, None] + s[..., None, :]), self.x / by.x, q)

    def identity(self) -> "_Point":
        """Identity of the Jordan product."""
        q = np.zeros_like(self.q)
        q[:, 0] = 1
        return _Point(np.broadcast_to(np.eye(4), self.K.shape), np.ones_like(self.x), q)

    def dot(self, other: "_Point") -> np.ndarray:
        """Inner product (N,)."""
        return np.asarray(sum(np.sum((a * c).reshape(len(a), -1), axis=1) for a, c in zip(self, other, strict=True)))

    def longest(self, along: "_Point") -> np.ndarray:
        """Length of the step from here, where bodies are diagonal, to the edge of the cones (N,)."""
        s, root = np.diagonal(self.K, axis1=2, axis2=3), np.sqrt(_determinant(self.q))
        least = np.linalg.eigvalsh(along.K / np.sqrt(s[..., :, None] * s[..., None, :])).min(axis=(1, 2))
        back = _boosted(_mirrored(self.q / root), (along.q / root)[..., None])[..., 0]
        least = np.minimum(least, back[:, 0] - np.linalg.norm(back[:, 1:], axis=1))
        return 1 / np.maximum(ROUNDING, -np.minimum(least, (along.x / self.x).min(axis=1, initial=np.inf)))


def _mirrored(q: np.ndarray) -> np.ndarray:
    """Points of a second-order cone with the opposite tail."""
    return np.concatenate([q[:, :1], -q[:, 1:]], axis=1)


def _determinant(q: np.ndarray) -> np.ndarray:
    """Product of the two eigenvalues of points in a second-order cone (N, 1)."""
    size = np.linalg.norm(q[:, 1:], axis=1)
    return ((q[:, 0] - size) * (q[:, 0] + size))[:, None]


def _boosted(w: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (N, r, c) after the second-order cone's map onto itself that takes `1, 0, …` to w of determinant 1."""
    first, head, tail = columns[:, :1], w[:, :1, None], w[:, 1:, None]
    dots = tail.swapaxes(1, 2) @ columns[:, 1:]
    return np.concatenate([head * first + dots, columns[:, 1:] + (first + dots / (1 + head)) * tail], axis=1)


def traces(bodies: int, numbers: int) -> np.ndarray:
    """Coordinates of bodies K = 1 and numbers x = 1, which are also the traces of the basis (10 b + k,)."""
    return np.r_[np.tile(np.trace(UNITS, axis1=1, axis2=2), bodies), np.ones(numbers)]


def maxima(A: np.ndarray, y: np.ndarray, square: np.ndarray, bodies: int, f: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Maxima of `f·v / d·v` over all physical bodies and rotors with `|A v - y|² ≤ square`.

    Units are such that bodies K = 1 and rotors x = 1 satisfy these conditions.

    Args:
        A: Rows of problems that have the same number of objectives: ten entries in the basis `UNITS` for each body,
            then one for each rotor (c, r, 10 b + k).
        y: Right sides (c, r).
        square: Largest squared distances (c,).
        bodies: Number of bodies b.
        f: Numerators (N, 10 b + k).
        d: Denominators, positive for all physical bodies; zeros for one (N, 10 b + k).

    Returns:
        Upper bounds of the maxima, to `EXACT`, infinite where nothing bounds them or rounding ends the search (N,).
    """
    at_once, own = max(1, AT_ONCE // A.shape[2] ** 2), np.arange(len(f)) * len(A) // max(1, len(f))
    parts = [slice(k, k + at_once) for k in range(0, len(f), at_once)]
    searches = (_Search(A[own[k]], y[own[k]], square[own[k]], bodies, f[k], d[k]) for k in parts)
    return np.concatenate([np.zeros(0), *(search.maxima() for search in searches)])


class _Search:
    """Primal and dual points of several objectives, and their steps towards the maxima.

    Attributes:
        f: Objectives, with h as the last entry (N, n).
        e: Rows of the normalisation `e·v = 1` (N, n).
        rows: Rows of the second-order cone, `ρ h` and `A v - y h` (N, r + 1, n).
        v: Primal points (N, n).
        G: Axes of bodies, `K = G s Gᵀ` and `Z = G⁻ᵀ s G⁻¹` (N, b, 4, 4).
        s: Their diagonals (N, b, 4).
        x: Multipliers of rotors (N, k).
        q: Multipliers of the second-order cone (N, r + 1).
        rest: `f - β e + Eᵀz` (N, n).
    """

    def __init__(self, A: np.ndarray, y: np.ndarray, square: np.ndarray, b: int, f: np.ndarray, d: np.ndarray) -> None:
        N, r, n = A.shape
        start, one = traces(b, n + 1 - 10 * b), np.where(d.any(axis=1), 0.0, 1.0)
        self.f, self.e = np.c_[f, np.zeros(N)], np.c_[d, one]
        self.limit = UNBOUNDED * np.linalg.norm(f, axis=1) / (one + np.linalg.norm(d, axis=1))
        self.rows = np.zeros((N, r + 1, n + 1))
        self.rows[:, 0, -1], self.rows[:, 1:] = np.sqrt(square), np.concatenate([A, -y[:, :, None]], axis=2)
        self.v = start / (self.e @ start)[:, None]
        self.first = np.sum(self.f * self.v, axis=1)
        # The multipliers are inverse to the start, and as large as the objective.
        h = self.v[:, -1]
        mu = np.linalg.norm(f, axis=1) * h
        self.G = np.sqrt(h / np.sqrt(mu))[:, None, None, None] * np.tile(np.eye(4), (N, b, 1, 1))
        x, q = self.cones(np.arange(N))
        self.s = np.tile(np.sqrt(mu)[:, None, None], (1, b, 4))
        self.x, self.q = mu[:, None] / x, mu[:, None] * _mirrored(q) / _determinant(q)
        self.rest = self.f - self.first[:, None] * self.e + (self.q[:, None] @ self.rows)[:, 0]
        self.rest[:, :n] += np.c_[(mu / h)[:, None] * start[: 10 * b], self.x]

    def cones(self, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotors and points of the second-order cone, for some objectives."""
        v = self.v[k]
        return v[:, 10 * self.G.shape[1] : -1], (self.rows[k] @ v[:, :, None])[:, :, 0]

    def maxima(self) -> np.ndarray:
        """Upper bounds of the maxima."""
        out, active = np.full(len(self.f), np.inf), np.arange(len(self.f))
        for _ in range(STEPS):
            _, q = self.cones(active)
            # Rounding may take a point beyond the edge.
            active = active[(np.minimum(_determinant(q), _determinant(self.q[active])) > 0)[:, 0]]
            if not len(active):
                break
            active = self._stepped(active)
            value, gap = self._value(active)
            exact = gap < EXACT * np.maximum(np.abs(value), FLOOR * np.abs(value - self.first[active]))
            out[active[exact]] = (value + gap)[exact]
            active = active[~exact & (value < self.limit[active])]
        return np.where(out < self.limit, out, np.inf)

    def _value(self, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values of some objectives, and by how much larger their maxima are at most."""
        x, q = self.cones(k)
        gap = np.sum(self.s[k] ** 2, axis=(1, 2)) + np.sum(x * self.x[k], axis=1) + np.sum(q * self.q[k], axis=1)
        return np.sum(self.f[k] * self.v[k], axis=1), gap + np.sum(np.abs(self.rest[k] * self.v[k]), axis=1)

    def _stepped(self, k: np.ndarray) -> np.ndarray:
        """Makes a step of some objectives, and returns those for which rounding allows one."""
        try:
            self._step(k)
        except np.linalg.LinAlgError:
            # One of them alone ends, not all that are computed at once.
            half = len(k) // 2
            return np.concatenate([self._stepped(part) for part in (k[:half], k[half:])]) if half else k[:0]
        return k

    def _step(self, k: np.ndarray) -> None:
        """Makes a step of some objectives."""
        axes = _Axes(self, k)
        here, ones = axes.here, np.ones(len(k))
        step, dual, _ = axes.newton(here, ones)
        length = np.minimum(1, np.minimum(here.longest(step), here.longest(dual)))
        # The second step corrects the first one's curvature, and returns to the centre where that one was short.
        left, mean = (1 - length) ** 2, here.dot(here) / (self.s[0].size + here.x.shape[1] + 1)
        goal = here.product(here).plus(ones, step.product(dual)).plus(-mean * left, here.identity())
        step, dual, dv = axes.newton(goal.quotient(here), 1 - left)
        length = np.minimum(1, NEARLY * np.minimum(here.longest(step), here.longest(dual)))
        root = np.linalg.cholesky(here.plus(length, step).K)
        squares, turned = np.linalg.eigh(root.swapaxes(-1, -2) @ here.plus(length, dual).K @ root)
        self.s[k] = np.sqrt(squares)
        self.G[k] = axes.G @ root @ turned / np.sqrt(self.s[k])[..., None, :]
        self.v[k] += length[:, None] * dv
        self.x[k] += length[:, None] * dual.x / axes.w
        self.q[k] += length[:, None] * axes.scaled(dual.q[..., None])[..., 0]
        self.rest[k] *= 1 - (length * (1 - left))[:, None]


class _Axes:
    """Nesterov-Todd axes, in which the point and the multipliers of some objectives are the same, and Newton's steps.

    With rows M of bodies and rotors, m of h, and multipliers λ of the rows, a step `u, h` is the solution of

        u + Mᵀλ + β e = g,    λ = M u + m h - c,    mᵀλ + β ε = γ,    eᵀu + ε h = 0,

    of which `λ = (1 + M Mᵀ)⁻¹ (M (g - β e) + m h - c)` is found by an orthogonal decomposition.

    Attributes:
        here: Point and multipliers, bodies of which are diagonal.
    """

    def __init__(self, search: _Search, k: np.ndarray) -> None:
        (x, q), zx, zq, self.G = search.cones(k), search.x[k], search.q[k], search.G[k]
        one, other, self.w = _determinant(q), _determinant(zq), np.sqrt(x / zx)
        unit, mirror = q / np.sqrt(one), _mirrored(zq / np.sqrt(other))
        middle = (unit + mirror) / np.sqrt(2 + 2 * np.sum(unit * _mirrored(mirror), axis=1))[:, None]
        self.back, self.eta = _mirrored(middle), (one / other)[..., None] ** 0.25
        self.here = _Point(search.s[k][..., None] * np.eye(4), np.sqrt(x * zx), self.scaled(q[..., None])[..., 0])
        moved = self.G.swapaxes(-1, -2)[:, :, None] @ UNITS @ self.G[:, :, None]
        self.frames = moved.reshape(*self.G.shape[:2], 10, 16) @ UNITS.reshape(10, 16).T
        self.M, m = self._moved(self.scaled(search.rows[k]))
        of_v, of_h = self._moved(np.stack([search.e[k], search.rest[k]], axis=1))
        self.rest, self.rest_of_h = of_v[:, 1], of_h[:, 1]
        stacked = np.concatenate([self.M.swapaxes(1, 2), np.tile(np.eye(m.shape[1]), (len(k), 1, 1))], axis=1)
        self.inverse = np.linalg.inv(np.linalg.qr(stacked, mode="r"))
        # β and h change λ and u along these columns.
        self.sides = m[:, None], of_v[:, :1]
        self.along = self._solved(of_v[:, 0, :, None] * [1, 0], m[..., None] * [0, 1])
        self.border = self._bordered(*self.along) - of_h[:, :1, None] * np.eye(2)

    def scaled(self, columns: np.ndarray) -> np.ndarray:
        """Columns of the second-order cone in these axes; of multipliers from these axes."""
        return _boosted(self.back, columns) / self.eta

    def _moved(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Entries for bodies and rotors of rows (N, m, n) in these axes, and those for h."""
        N, b = self.frames.shape[:2]
        of_bodies = rows[:, :, : 10 * b].reshape(N, -1, b, 10).swapaxes(1, 2) @ self.frames
        of_rotors = rows[:, :, 10 * b : -1] * self.w[:, None]
        return np.concatenate([of_bodies.swapaxes(1, 2).reshape(N, -1, 10 * b), of_rotors], axis=2), rows[:, :, -1]

    def _solved(self, g: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns of λ and u for some right sides, without h and β."""
        multipliers, u = np.zeros_like(c), g
        # The second time for what rounding has left.
        for _ in range(2):
            wrong = self.M @ u - c - multipliers
            multipliers = multipliers + self.inverse @ (self.inverse.swapaxes(1, 2) @ wrong)
            u = g - self.M.swapaxes(1, 2) @ multipliers
        return multipliers, u

    def _bordered(self, multipliers: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Left sides of the equations of h and β (N, 2, c)."""
        return np.concatenate([self.sides[0] @ multipliers, self.sides[1] @ u], axis=1)

    def newton(self, wrong: _Point, share: np.ndarray) -> tuple[_Point, _Point, np.ndarray]:
        """Steps of point and multipliers, whose sum takes away what is wrong, and the step of v (N, n)."""
        N, b = self.frames.shape[:2]
        of_bodies = np.tensordot(wrong.K, UNITS, ((2, 3), (1, 2))).reshape(N, -1)
        g = share[:, None] * self.rest - np.c_[of_bodies, wrong.x]
        multipliers, u = self._solved(g[..., None], -wrong.q[..., None])
        right = self._bordered(multipliers, u)
        right[:, 0, 0] -= share * self.rest_of_h
        ends = np.linalg.solve(self.border, right)
        multipliers, u = ((a - c @ ends)[..., 0] for a, c in zip((multipliers, u), self.along, strict=True))
        units = u[:, : 10 * b].reshape(N, b, 10)
        step = _Point(np.tensordot(units, UNITS, 1), u[:, 10 * b :], multipliers - wrong.q)
        dv = np.c_[(self.frames @ units[..., None]).reshape(N, -1), step.x * self.w, ends[:, 1]]
        return step, _Point(*(-a - c for a, c in zip(wrong, step, strict=True))), dv
