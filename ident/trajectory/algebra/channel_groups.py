"""Groups of channels that depend on the same coordinates and parameters, so that products leave the zeros out.

The torque of a joint depends on the motion of its ancestors and of what it carries, and on the parameters of the bodies
that it carries; a wrench on the base depends on everything. Channels are grouped by coordinates, and within a group by
parameters. Two groups are joined where the products of both together take less time: separate ones cost calls, and the
sums of their blocks.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ident.trajectory.algebra.bit_sets import bits_of, indices_of
from ident.trajectory.algebra.block_tridiagonal import WINDOW

MOVED = 20
"""Operations that take as long as moving one number of a block."""

CALLED = 4e5
"""Operations that take as long as the calls for a group, per interval."""


class ThetaGroup(NamedTuple):
    """Channels that depend on the same parameters.

    Attributes:
        rows: These channels within their `ChannelGroup`, which are adjacent.
        columns: Indices of the parameters, ascending (k,).
    """

    rows: slice
    columns: np.ndarray


class Dependents(NamedTuple):
    """Parameters on which the same channels depend.

    Attributes:
        columns: Indices of the parameters, ascending (k,).
        rows: Positions of the channels within their `ChannelGroup`, ascending.
    """

    columns: np.ndarray
    rows: np.ndarray


class ChannelGroup(NamedTuple):
    """Channels that depend on the same coordinates.

    Attributes:
        channels: Indices of the channels, those of each of the parts adjacent (c,).
        coordinates: Indices of the coordinates, ascending (k,).
        parts: The channels by the parameters on which they depend: for products over rows.
        blocks: The parameters by the channels that depend on them, each parameter once: for products over columns.
    """

    channels: np.ndarray
    coordinates: np.ndarray
    parts: tuple[ThetaGroup, ...]
    blocks: tuple[Dependents, ...]

    @property
    def columns(self) -> np.ndarray:
        """Indices of the parameters on which any of the channels depends, ascending."""
        return np.unique(np.concatenate([part.columns for part in self.parts]))

    @property
    def whole(self) -> bool:
        """True if all channels depend on the same parameters."""
        return len(self.parts) == len(self.blocks) == 1 and len(self.blocks[0].rows) == len(self.channels)


def channel_groups(by_coordinates: np.ndarray, by_theta: np.ndarray, samples: int) -> tuple[ChannelGroup, ...]:
    """Groups of channels.

    Args:
        by_coordinates: Mask of the coordinates on which each channel depends (C, n).
        by_theta: Mask of the parameters on which it depends (C, p).
        samples: Samples per interval.
    """
    rows = tuple((bits_of(a), bits_of(b)) for a, b in zip(by_coordinates, by_theta, strict=True))
    return _groups(rows, by_theta.shape[1], samples)


class _Joined(NamedTuple):
    """Channels and what they depend on together, as bits, or parameters and what depends on any of them."""

    members: tuple[int, ...]
    bits: int


@lru_cache(maxsize=64)
def _groups(rows: Sequence[tuple[int, int]], parameters: int, samples: int) -> tuple[ChannelGroup, ...]:
    every = range(len(rows))

    def of_coordinates(channels: int, width: int) -> float:
        """Operations of the products of a group, with the curvature of its window and with all of θ."""
        r, w = samples * channels, WINDOW * width
        return CALLED + 4 * r * w**2 + 2 * r * w * parameters + MOVED * w * (3 * w + parameters)

    out = []
    for group in _joined([_Joined((c,), rows[c][0]) for c in every], of_coordinates):
        width = WINDOW * group.bits.bit_count()

        def of_theta(channels: int, columns: int) -> float:
            """Operations of the products with the parameters of a part."""
            r = samples * channels
            return CALLED + 2 * r * columns * (parameters + columns) + MOVED * r * columns

        parts, start, order = [], 0, list[int]()
        for part in _joined([_Joined((c,), rows[c][1]) for c in group.members], of_theta):
            parts.append(ThetaGroup(slice(start, start + len(part.members)), indices_of(part.bits)))
            start, order = start + len(part.members), [*order, *part.members]

        def of_block(columns: int, channels: int, width: int = width) -> float:
            """Operations of the products of a window's functions with some parameters."""
            return CALLED + 2 * samples * channels * width * columns

        mine = [sum((rows[c][1] >> k & 1) << at for at, c in enumerate(order)) for k in range(parameters)]
        blocks = _joined([_Joined((k,), bits) for k, bits in enumerate(mine) if bits], of_block)
        dependents = tuple(Dependents(np.array(block.members), indices_of(block.bits)) for block in blocks)
        out.append(ChannelGroup(np.array(order), indices_of(group.bits), tuple(parts), dependents))
    return tuple(out)


def _joined(groups: Sequence[_Joined], operations: Callable[[int, int], float]) -> list[_Joined]:
    """Groups joined pair by pair, the pair first that saves most operations, as long as any does."""
    same: dict[int, tuple[int, ...]] = {}
    for group in groups:
        same[group.bits] = (*same.get(group.bits, ()), *group.members)
    own = [_Joined(members, bits) for bits, members in same.items()]

    def cost(group: _Joined) -> float:
        return operations(len(group.members), group.bits.bit_count())

    def saved(a: _Joined, b: _Joined) -> float:
        return cost(a) + cost(b) - cost(_both(a, b))

    savings = {pair: saved(*pair) for pair in combinations(own, 2)}
    while savings and savings[best := max(savings, key=savings.__getitem__)] > 0:
        both = _both(*best)
        own = [group for group in own if group not in best]
        savings = {(a, b): value for (a, b), value in savings.items() if a not in best and b not in best}
        savings |= {(group, both): saved(group, both) for group in own}
        own.append(both)
    return own


def _both(a: _Joined, b: _Joined) -> _Joined:
    return _Joined(tuple(sorted(a.members + b.members)), a.bits | b.bits)
