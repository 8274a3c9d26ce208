"""Groups of channels by the coordinates and parameters on which they depend, so that products leave the zeros out.

The torque of a joint depends on the motion of its ancestors and of what it carries, and on the parameters of the bodies
that it carries; a wrench on the base depends on everything. With torques alone and a base at rest, the branches of a
tree are components: no channel relates their coordinates, so that their equations are coupled by θ alone. Two groups
are joined where both together take less time, because each costs calls and the sums of its blocks.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache, reduce
from itertools import combinations
from operator import or_
from typing import NamedTuple

import numpy as np

from ident.trajectory.algebra.banded import WINDOW
from ident.trajectory.algebra.spline import LOCAL

MOVED = 20
"""Operations that take as long as moving one number of a block."""

CALLED, CALLED_OF_COMPONENT = 4e5, 1.5e6
"""Operations that take as long as the calls for a group and for a component, per interval."""


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


_Bits = tuple[int, int, int]
"""The sets of a `Group` as bits of integers, which are hashed and united faster than arrays."""


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
