"""Normal equations of a trajectory and of θ: banded in time, with a border.

    [A  B ] [δc]   [b]           A = Jᵀ W J + λP = Uᵀ U banded
    [Bᵀ D ] [δθ] = [d]           δc = A⁻¹ b - F δθ,      F = A⁻¹ B

The trajectory minimises misfit plus penalty at every θ, and θ the misfit alone along these trajectories (generalised
profiling: Ramsay, Hooker, Campbell and Cao, JRSS B 69, 2007, doi:10.1111/j.1467-9868.2007.00610.x):

    (D - Bᵀ F - Fᵀ λP F) δθ = d - Bᵀ A⁻¹ b - Fᵀ λP (c + A⁻¹ b)

With the penalty in both, a smaller motion of larger inertia costs less, and θ is biased by several standard deviations.
Each row depends on a window of seven spline functions, so that A and B are sums over windows.

Products leave the zeros out. The torque of a joint depends on the motion of its ancestors and of what it carries, and
on the parameters of the bodies that it carries; a wrench on the base depends on everything. With torques alone and a
base at rest, the branches of a tree are components: no channel relates their coordinates, so that their equations are
coupled by θ alone. Two groups of channels are joined where both together take less time, because each costs calls and
the sums of its blocks.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from itertools import combinations
from math import prod
from operator import or_
from typing import NamedTuple

import numpy as np

from ident.trajectory.algebra.banded import WINDOW, Banded, Factor
from ident.trajectory.algebra.spline import LOCAL, Spline, sliding

MOVED = 20
"""Operations that take as long as moving one number of a block."""

CALLED, CALLED_OF_COMPONENT = 4e5, 1.5e6
"""Operations that take as long as the calls for a group and for a component, per interval."""

_Bits = tuple[int, int, int]
"""The sets of a `Group` as bits of integers, which are hashed and united faster than arrays."""


class Group(NamedTuple):
    """Channels, and what they depend on.

    Attributes:
        coordinates: Indices of the coordinates, ascending (k,).
        columns: Indices of the parameters, ascending (q,).
        channels: Indices of the channels, ascending (c,).
    """

    coordinates: np.ndarray
    columns: np.ndarray
    channels: np.ndarray


def components(of_states: np.ndarray, of_theta: np.ndarray, zeros: Mapping[int, int], n: int) -> tuple[Group, ...]:
    """Components: coordinates that no channel relates to the others, small ones together.

    Args:
        of_states: Mask of the coordinates on which each channel depends, at least one (C, n).
        of_theta: Mask of the parameters on which it depends (C, p).
        zeros: Indices of the coordinates' zeros among the parameters, by coordinate.
        n: Number of coordinates.
    """
    alone = [(1 << j, 1 << zeros[j] if j in zeros else 0, 0) for j in range(n)]
    return _components((*_bits(of_states, of_theta), *alone), of_theta.shape[1])


def channel_groups(of_states: np.ndarray, of_theta: np.ndarray, samples: int) -> tuple[Group, ...]:
    """Groups of channels with similar coordinates and parameters.

    Args:
        of_states: Mask of the coordinates on which each channel depends (C, n).
        of_theta: Mask of the parameters on which it depends (C, p).
        samples: Samples per interval.
    """
    return _groups(_bits(of_states, of_theta), of_theta.shape[1], samples)


def _bits(of_states: np.ndarray, of_theta: np.ndarray) -> tuple[_Bits, ...]:
    """Coordinates and parameters that each channel depends on."""
    states, theta = (np.packbits(mask, axis=1, bitorder="little") for mask in (of_states, of_theta))
    every = range(len(of_states))
    return tuple((_integer(states[k]), _integer(theta[k]), 1 << k) for k in every)


def _integer(packed: np.ndarray) -> int:
    return int.from_bytes(packed.tobytes(), "little")


@lru_cache(maxsize=64)
def _components(links: tuple[_Bits, ...], parameters: int) -> tuple[Group, ...]:
    every = list[_Bits]()
    for link in links:
        related = [one for one in every if one[0] & link[0]]
        every = [one for one in every if one not in related] + [_union(link, *related)]

    def operations(n: int, p: int, _: int) -> float:
        """Operations per interval: factor, inverse, solutions and the covariance of the functions."""
        b = LOCAL * n
        return CALLED_OF_COMPONENT + (12 * b**3 + 7 * b**2 * p) / LOCAL + 2 * n * p * (p + parameters)

    return _joined(every, operations)


@lru_cache(maxsize=64)
def _groups(rows: tuple[_Bits, ...], parameters: int, samples: int) -> tuple[Group, ...]:
    def operations(n: int, p: int, channels: int) -> float:
        """Operations of the products of the rows, and of the covariance with all of θ."""
        r, w = samples * channels, WINDOW * n
        products = 4 * r * w**2 + 2 * r * (w + p) * (parameters + p)
        return CALLED + products + MOVED * (w * (3 * w + p) + r * p)

    same: dict[tuple[int, int], _Bits] = {}
    for row in rows:
        same[row[:2]] = _union(row, same.get(row[:2], row))
    return _joined(same.values(), operations)


def _joined(parts: Iterable[_Bits], operations: Callable[[int, int, int], float]) -> tuple[Group, ...]:
    """Parts joined pair by pair, the pair first that saves most operations, as long as any does.

    Args:
        parts: The parts.
        operations: Number of operations from those of coordinates, parameters and channels.
    """
    own = list(parts)

    def cost(one: _Bits) -> float:
        return operations(*(x.bit_count() for x in one))

    def saved(a: _Bits, b: _Bits) -> float:
        return cost(a) + cost(b) - cost(_union(a, b))

    savings = {pair: saved(*pair) for pair in combinations(own, 2)}
    while savings and savings[best := max(savings, key=savings.__getitem__)] > 0:
        both = _union(*best)
        own = [one for one in own if one not in best]
        savings = {(a, b): value for (a, b), value in savings.items() if a not in best and b not in best}
        savings |= {(one, both): saved(one, both) for one in own}
        own.append(both)
    return tuple(Group(*map(_indices, one)) for one in sorted(own))


def _union(*parts: _Bits) -> _Bits:
    coordinates, columns, channels = (reduce(or_, own) for own in zip(*parts, strict=True))
    return coordinates, columns, channels


def _indices(bits: int) -> np.ndarray:
    """Indices of the bits that are set, ascending."""
    return np.array([k for k in range(bits.bit_length()) if bits >> k & 1], int)


class Eliminated(NamedTuple):
    """Normal equations of θ with the trajectory eliminated.

    Attributes:
        precision: Precision of θ, `D - Bᵀ F - Fᵀ λP F` (p, p).
        gradient: Right side, `d - Bᵀ A⁻¹ b - Fᵀ λP (c + A⁻¹ b)` (p,).
        step: Step of the coefficients at fixed θ, `A⁻¹ b` (size n,).
        by_theta: Decrease of that step by a step of θ, F (size n, p).
        pull: Part of the penalty that the right side leaves out, `Fᵀ λP (c + A⁻¹ b)` (p,).
        bend: The same of the precision, `Fᵀ λP F` (p, p).
        factors: Cholesky factors of A for each component of the coordinates, with its coordinates.
    """

    precision: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    by_theta: np.ndarray
    pull: np.ndarray
    bend: np.ndarray
    factors: tuple[tuple[np.ndarray, Factor], ...]

    def solved(self, right: np.ndarray) -> np.ndarray:
        """`A⁻¹ right` for right sides (size n, k)."""
        n, k = sum(len(coordinates) for coordinates, _ in self.factors), right.shape[1]
        right, out = right.reshape(-1, n, k), np.empty((len(right) // n, n, k))
        for coordinates, factor in self.factors:
            # The first interval's window begins with a function that does not exist.
            padded = np.zeros((len(right) + 1, len(coordinates), k))
            padded[1:] = right[:, coordinates]
            out[:, coordinates] = factor.solve(padded.reshape(-1, k)).reshape(*padded.shape)[1:]
        return out.reshape(-1, k)


def joined(parts: Sequence[tuple[np.ndarray, np.ndarray, Eliminated]], coordinates: int, parameters: int) -> Eliminated:
    """Normal equations of several components of the coordinates.

    Args:
        parts: Coordinates and entries of θ of each component, and its equations.
        coordinates: Number of coordinates of all.
        parameters: Number of parameters of all.
    """
    n, p = coordinates, parameters
    if len(parts) == 1 and len(parts[0][1]) == p:
        return parts[0][2]
    size = len(parts[0][2].step) // len(parts[0][0])
    precision, gradient, step, by_theta = np.zeros((p, p)), np.zeros(p), np.zeros((size, n)), np.zeros((size, n, p))
    pull, bend = np.zeros(p), np.zeros((p, p))
    for own, columns, part in parts:
        precision[np.ix_(columns, columns)] += part.precision
        gradient[columns] += part.gradient
        step[:, own] = part.step.reshape(size, -1)
        by_theta[:, own[:, None], columns] = part.by_theta.reshape(size, len(own), -1)
        pull[columns] += part.pull
        bend[np.ix_(columns, columns)] += part.bend
    factors = tuple((own[inner], factor) for own, _, part in parts for inner, factor in part.factors)
    return Eliminated(precision, gradient, step.ravel(), by_theta.reshape(size * n, p), pull, bend, factors)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Covariance of each window's coefficients and of θ: `A⁻¹ + W Σ Wᵀ`, `-W Σ` and Σ with `W = A⁻¹ B`.

    Attributes:
        inverse: Blocks of `A⁻¹` for every window (S, 7 n, 7 n).
        followed: Rows of `W √Σ` for every window (S, 7 n, q).
        root: A root of the covariance of θ, `√Σ √Σᵀ = Σ` (p, q).
    """

    inverse: np.ndarray
    followed: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, eliminated: Eliminated, root: np.ndarray, intervals: int, coordinates: int) -> "Posterior":
        """Posterior of normal equations, from a root of the covariance of θ (p, q)."""
        n, width = coordinates, WINDOW * coordinates
        # The first interval's window begins with a function that does not exist.
        followed = np.zeros((n + len(eliminated.by_theta), root.shape[1]))
        np.matmul(eliminated.by_theta, root, out=followed[n:])
        ((_, factor),) = eliminated.factors
        return cls(factor.inverse_windows(intervals), sliding(followed, width, n), root)

    @cached_property
    def by_coordinate(self) -> np.ndarray:
        """Covariance of the seven coefficients of every coordinate (S, n, 7, 7)."""
        S, width, _ = self.inverse.shape
        n = width // WINDOW
        out = np.einsum("sujvj->sjuv", self.inverse.reshape(S, WINDOW, n, WINDOW, n)).copy()
        # Two functions are in several windows, of which each has their product.
        every = np.concatenate([self.followed[:, :n], self.followed[-1:, n:].reshape(LOCAL, n, -1)])
        for lag in range(WINDOW):
            products = np.einsum("fjq,fjq->fj", every[: len(every) - lag], every[lag:])
            for u in range(WINDOW - lag):
                for at in {(u, u + lag), (u + lag, u)}:
                    out[:, :, *at] += products[u : u + S]
        return out

    def of_coordinates(self, some: slice, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Blocks of `A⁻¹` (k, 7 c, 7 c) and rows of `W √Σ` (k, 7 c, q) of some coordinates (c,) and intervals."""
        inverse, followed = self.inverse[some], self.followed[some]
        n = followed.shape[1] // WINDOW
        if len(coordinates) == n:
            return inverse, followed
        at = (n * np.arange(WINDOW)[:, None] + coordinates).ravel()
        return inverse[:, at[:, None], at], followed[:, at]

    def followed_of(self, coordinate: int) -> np.ndarray:
        """Rows of `W √Σ` of one coordinate for every window (S, 7, q)."""
        n = self.inverse.shape[1] // WINDOW
        return self.followed[:, coordinate::n]


class Arrow:
    """Normal equations to which rows are added.

    Attributes:
        spline: Spline space of the trajectory, of S intervals.
    """

    def __init__(self, spline: Spline, coordinates: int, parameters: int, *, linked: bool = True) -> None:
        """Begins without rows; `linked` ones depend on the sample before as well."""
        intervals, n, p = spline.intervals, coordinates, parameters
        self.spline, self._first = spline, 0 if linked else 1
        self._normal = Banded(intervals + LOCAL, n, WINDOW - self._first)
        self._border = np.zeros((intervals + LOCAL, n, p))
        self._right = np.zeros((intervals + LOCAL, n))
        self._corner, self._below = np.zeros((p, p)), np.zeros(p)

    def add(
        self,
        some: slice,
        rows: tuple[np.ndarray, np.ndarray],
        weighed: tuple[np.ndarray, np.ndarray],
        right: np.ndarray,
        group: Group,
    ) -> None:
        """Adds rows X with a matrix of weights W, as `Xᵀ W X` and `Xᵀ W y`.

        Args:
            some: The k intervals of the rows.
            rows: X, derivatives by the functions of the coordinates' windows (k, r, 7 c) and by entries of θ (k, r, q).
            weighed: W X, likewise; the same arrays for rows that are weighted already.
            right: W y (k, r).
            group: The coordinates and entries of θ.
        """
        (J, T), (WJ, WT), (coordinates, columns, _) = rows, weighed, group
        k, c, first = len(J), len(coordinates), some.start + self._first
        J, WJ = J[..., self._first * c :], WJ[..., self._first * c :]
        Jt, functions = transposed(J), slice(first, some.stop + LOCAL)
        border, own_right = self._border[functions], np.zeros((functions.stop - first, c))
        # BLAS computes half of a product of a matrix with its transpose.
        self._normal.add(first, (Jt @ WJ).reshape(k, -1, c, WINDOW - self._first, c), coordinates)
        if border.shape[1:] == (c, len(columns)):
            add_windows(border, Jt @ WT)
        else:
            own = np.zeros((len(border), c, len(columns)))
            add_windows(own, Jt @ WT)
            border[:, coordinates[:, None], columns] += own
        add_windows(own_right, (Jt @ right[..., None])[..., 0])
        self._right[functions, coordinates] += own_right
        self._corner[columns[:, None], columns] += stacked(T).T @ stacked(WT)
        self._below[columns] += stacked(T).T @ right.ravel()

    def add_separate(self, J: np.ndarray, T: np.ndarray, right: np.ndarray, columns: Mapping[int, int]) -> None:
        """Adds rows of streams that depend on one coordinate each, in order, and some of them on one entry of θ.

        Args:
            J: Derivatives by the functions of the coordinate's window (S, m, n, 7).
            T: Derivatives by the entry of θ (S, m, n).
            right: Right sides (S, m, n).
            columns: Index of the entry in θ by coordinate.
        """
        J, functions = J.transpose(0, 2, 3, 1)[:, :, self._first :], slice(self._first, None)
        self._normal.add_separate(self._first, (J @ transposed(J)).transpose(0, 2, 3, 1))
        y, t = (x.transpose(0, 2, 1)[..., None] for x in (right, T))
        add_windows(self._right[functions], (J @ y)[..., 0].swapaxes(1, 2))
        for j, at in columns.items():
            add_windows(self._border[functions, j, at], (J[:, j] @ t[:, j])[..., 0])
            self._corner[at, at] += (T[:, :, j] ** 2).sum()
            self._below[at] += (T[:, :, j] * right[:, :, j]).sum()

    def eliminated(self, jerk: np.ndarray, coefficients: np.ndarray) -> Eliminated:
        """Normal equations of θ with the trajectory eliminated.

        Args:
            jerk: λ of each coordinate in the penalty `Σ_j λ_j ∫ x⃛_j² dt` (n,).
            coefficients: Spline coefficients c (size, n).

        Raises:
            numpy.linalg.LinAlgError: Rows and penalty together do not determine the trajectory.
        """
        n = self._right.shape[1]
        self._normal.add_separate(1, (self.spline.penalty[..., None] * jerk)[None])
        factor = self._normal.factored()
        self._right[1:] -= self.spline.penalised(coefficients.reshape(-1, 1), jerk).reshape(-1, n)
        half = factor.solve_lower(
            np.concatenate([self._border, self._right[..., None]], axis=2).reshape(self._right.size, -1)
        )
        gram = half.T @ half
        whole = factor.solve_upper(half)[n:]
        step, by_theta = whole[:, -1].copy(), whole[:, :-1]
        # Squares of jerks: products with P would lose all digits where a resting coordinate's λ is large.
        bent = self.spline.bent(np.column_stack([by_theta, coefficients.ravel() + step]), jerk)
        bend, pull = bent[:, :-1].T @ bent[:, :-1], bent[:, :-1].T @ bent[:, -1]
        return Eliminated(
            precision=self._corner - gram[:-1, :-1] - bend,
            gradient=self._below - gram[:-1, -1] - pull,
            step=step,
            by_theta=by_theta,
            pull=pull,
            bend=bend,
            factors=((np.arange(n), factor),),
        )


def transposed(x: np.ndarray) -> np.ndarray:
    """Matrices transposed (…, a, b) -> (…, b, a)."""
    return np.swapaxes(x, -1, -2)


def stacked(x: np.ndarray) -> np.ndarray:
    """Rows of any shape stacked (…, p) -> (N, p)."""
    return x.reshape(prod(x.shape[:-1]), x.shape[-1])


def add_windows(total: np.ndarray, windows: np.ndarray) -> None:
    """Adds overlapping windows (k, w, …) or (k, w c, …) to the functions from the first window's on (k + w - 1, …)."""
    k, rest = len(windows), total.shape[1:]
    windows = windows.reshape(k, -1, *rest)
    for u in range(windows.shape[1]):
        total[u : u + k] += windows[:, u]
