"""Components of the coordinates: sets that no channel relates, so that their equations are coupled by θ alone.

With torques alone and a base at rest, the branches of a tree are such sets. Small ones are taken together, because each
costs calls.
"""

from collections.abc import Mapping
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ident.trajectory.algebra.bit_sets import bits_of, indices_of
from ident.trajectory.algebra.spline import LOCAL

CALLED = 1.5e6
"""Operations that take as long as the calls for a component, per interval."""


class Component(NamedTuple):
    """Coordinates that no channel relates to the others.

    Attributes:
        coordinates: Their indices, ascending (k,).
        columns: Indices of the parameters on which their streams depend, ascending (q,).
        channels: Indices of the channels that depend on them, ascending (c,).
    """

    coordinates: np.ndarray
    columns: np.ndarray
    channels: np.ndarray


def components(of_states: np.ndarray, of_theta: np.ndarray, zeros: Mapping[int, int], n: int) -> tuple[Component, ...]:
    """Components of the coordinates.

    Args:
        of_states: Mask of the coordinates on which each channel depends, at least one (C, n).
        of_theta: Mask of the parameters on which it depends (C, p).
        zeros: Indices of the coordinates' zeros among the parameters, by coordinate.
        n: Number of coordinates.
    """
    links = [_Bits(bits_of(a), bits_of(b), 1 << k) for k, (a, b) in enumerate(zip(of_states, of_theta, strict=True))]
    links += [_Bits(1 << j, 1 << zeros[j] if j in zeros else 0, 0) for j in range(n)]
    return _components(tuple(links), of_theta.shape[1])


class _Bits(NamedTuple):
    """Coordinates, parameters and channels as bits."""

    coordinates: int
    columns: int
    channels: int


@lru_cache(maxsize=64)
def _components(links: tuple[_Bits, ...], parameters: int) -> tuple[Component, ...]:
    every = list[_Bits]()
    for link in links:
        related = [one for one in every if one.coordinates & link.coordinates]
        every = [one for one in every if one not in related] + [_union(link, *related)]
    while len(every) > 1:
        pairs = [(_saved(a, b, parameters), a, b) for a, b in combinations(every, 2)]
        saved, a, b = max(pairs, key=lambda pair: pair[0])
        if saved <= 0:
            break
        every = [one for one in every if one not in (a, b)] + [_union(a, b)]
    return tuple(Component(*map(indices_of, one)) for one in sorted(every))


def _union(*parts: _Bits) -> _Bits:
    coordinates = columns = channels = 0
    for part in parts:
        coordinates |= part.coordinates
        columns |= part.columns
        channels |= part.channels
    return _Bits(coordinates, columns, channels)


def _saved(a: _Bits, b: _Bits, parameters: int) -> float:
    """Operations that are saved if two components are taken together."""
    return _operations(a, parameters) + _operations(b, parameters) - _operations(_union(a, b), parameters)


def _operations(component: _Bits, parameters: int) -> float:
    """Operations for a component per interval: factor, inverse, solutions and the covariance of its functions."""
    n, p = component.coordinates.bit_count(), component.columns.bit_count()
    b = LOCAL * n
    return CALLED + (12 * b**3 + 7 * b**2 * p) / LOCAL + 2 * n * p * (p + parameters)
