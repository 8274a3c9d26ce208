"""Samples that a sensor's range has cut off: a signal with flat ends, at a value that it reads again and again."""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ident.recordings.resolution import white_noise

SHARE, FEWEST = 0.005, 5
"""Share of the samples, and their number, that have to read an extreme value exactly before it is a limit."""

LASTS = 3
"""Samples in a row that have to, once at least: single ones are chance where values are rounded."""

CROWDED = 4.0
"""How many times more samples an extreme value has to have than any of the `NEXT` values beside it. The peak of a
sinusoid that is rounded to a resolution has up to 2.4 times as many, 1 over √2 - 1."""

NEXT = 3
"""Values beside an extreme one that its samples are compared with."""

LEVELS = 10
"""Values that the other samples have to have at least: a channel that goes from one step to the next is not clipped."""

SAME = 1e-9
"""Difference from the extreme value, of the range, up to which a sample reads the same."""

STILL, BY_NOISE = 0.003, 6.0
"""Part of its range, and how many standard deviations of its noise besides, that a coordinate has to cross while a
signal reads a limit: less is a rest, in which sensors read the same value again and again."""


class Limit(NamedTuple):
    """A value beyond which a signal does not go.

    Attributes:
        value: The value.
        samples: Which samples read it (N,).
    """

    value: float
    samples: np.ndarray


def limits(x: np.ndarray) -> list[Limit]:
    """The limits at which a signal is clipped: its smallest value, its largest, both or none.

    Zero is none: a plate on which nobody stands reads it. A signal may also rest at an extreme value, which the motion
    tells apart (`moves`).

    Args:
        x: Samples, NaN where one is missing (N,).
    """
    if not np.nanmax(x, initial=-np.inf) > np.nanmin(x, initial=np.inf):
        return []
    ends = (_limit(x, float(np.nanmin(x))), _limit(x, float(np.nanmax(x))))
    return [each for each in ends if each is not None]


def _limit(x: np.ndarray, extreme: float) -> Limit | None:
    """An extreme value as a limit, None where it is not."""
    same = SAME * np.nanmax(np.abs(x - extreme))
    samples = np.abs(x - extreme) <= same
    count = int(samples.sum())
    if extreme == 0 or count < max(FEWEST, SHARE * len(x)) or max(_runs(samples)) < LASTS:
        return None
    others = np.round(np.abs(x - extreme)[np.isfinite(x) & ~samples] / same)
    _, beside = np.unique(others, return_counts=True)
    alone = len(beside) >= LEVELS and count > CROWDED * beside[:NEXT].max()
    return Limit(extreme, samples) if alone else None


def _runs(samples: np.ndarray) -> list[int]:
    """Lengths of the runs of samples that are true (N,)."""
    labels, number = ndimage.label(samples)
    return np.bincount(labels[samples], minlength=number + 1)[1:].tolist() or [0]


def moves(samples: np.ndarray, q: np.ndarray) -> bool:
    """True where the mechanism moves while a signal reads a limit: otherwise it rests there.

    Args:
        samples: Which samples read it (N,).
        q: Joint coordinates (N, n).
    """
    labels, number = ndimage.label(samples)
    spans = [span for (span,) in ndimage.find_objects(labels, number) if span.stop - span.start >= LASTS]
    enough = STILL * np.ptp(q, axis=0) + BY_NOISE * np.array([white_noise(x) for x in q.T])
    crossed = [(np.ptp(q[span], axis=0) > enough).any() for span in spans]
    # Of several times most have to be clipped.
    return bool(np.mean(crossed or [0.0]) > 1 / 2)
