"""Extremes of parameters over all physical bodies that fit, of many parameters at once, by an interior-point method.

    maximise   f·v   or   f·v / d·v    over    |A v - y|² ≤ ρ²,    K_i positive definite,    x ≥ 0

v has the pseudo-inertias K_i of bodies and the rotor inertias x. Minima of the logarithmic barrier for growing
weights t of the objective lead to the maximum, from which the last two are proportionally far. In axes in which K is
the identity, so is the Hessian of the bodies' barrier, and Newton's step needs as many equations as A has rows.
"""

import numpy as np

FACTOR, WEIGHTS = 25.0, 3
"""Factor between successive weights, and their number: the last two lead to bounds that are right to 1e-3 of their
distance."""

CENTRED, NEWTON_STEPS = 0.3, 80
"""Squared Newton decrement at which a minimum is near enough, and largest number of steps; 17 are usual."""

LARGEST, UNBOUNDED, BY_TRACE = 100.0, 30.0, 0.05
"""Largest trace of all bodies together, over that of the start, which keeps what nothing bounds from going on; value,
over the start's size, above which nothing bounds it, as no body is wrong by a factor of thirty; and growth of the value
with the largest trace, over its distance from the start, both relative, above which that alone bounds it."""

LENGTHS = np.array([0.99, 0.97, 0.93, 0.85, 0.7, 0.5, 0.3, 0.15, 0.07, 0.03, 0.01, 0.003])
"""Step lengths that are tried, over the longest one; a whole step is tried as well."""

AT_ONCE = 2e6
"""Numbers in the scaled rows of the parameters that are maximised together; more would not stay in the cache."""

PLACES = np.triu_indices(4)

UNITS = np.zeros((10, 4, 4))
"""Orthonormal basis of the symmetric matrices."""
UNITS[range(10), PLACES[0], PLACES[1]] = UNITS[range(10), PLACES[1], PLACES[0]] = np.sqrt(0.5)
UNITS[range(10), PLACES[0], PLACES[1]] **= np.where(PLACES[0] == PLACES[1], 0, 1)


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
    at_once = max(1, int(AT_ONCE / A.size))
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
