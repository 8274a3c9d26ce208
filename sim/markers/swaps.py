"""Detection of markers with exchanged labels."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from sim.markers.trial_fit import Postures

NEARER = 0.5
"""Two labels seem exchanged if each marker's distance to the other's place is below this share of that to its own."""


class Swap(NamedTuple):
    """Two labels that seem exchanged.

    Attributes:
        labels: The two labels.
        frames: Number of frames in which they seem exchanged.
    """

    labels: tuple[str, str]
    frames: int


def swaps(postures: Postures, measured: np.ndarray) -> list[Swap]:
    """Pairs of outlying markers that are near each other's fitted positions, most frames first.

    Args:
        postures: Fitted postures.
        measured: Positions that they were fitted to (N, M, 3).
    """
    labels, places, own = postures.marked.labels, measured - postures.residuals, postures.distances
    outlying = postures.outlying
    candidates = []
    for a, b in combinations(np.flatnonzero(outlying.any(axis=0)), 2):
        both = outlying[:, a] & outlying[:, b]
        crossed = [
            np.linalg.norm(measured[both, one] - places[both, other], axis=1) < NEARER * own[both, one]
            for one, other in ((a, b), (b, a))
        ]
        if frames := int((crossed[0] & crossed[1]).sum()):
            candidates.append(Swap((labels[a], labels[b]), frames))
    return sorted(candidates, key=lambda swap: -swap.frames)
