"""Detection of clipped signals: a sensor at the limit of its range repeats one extreme value."""

from typing import NamedTuple

import numpy as np

from ident.recordings.resolution import white_noise
from ident.recordings.runs import runs

SHARE, FEWEST = 0.005, 5
"""Least share and least number of samples at an extreme value for it to be a limit."""

LASTS = 3
"""Least length of the longest run of such samples: with rounded values single ones occur by chance."""

CROWDED = 4.0
"""Least ratio of the samples at an extreme value to those at any of the `NEXT` adjacent values. At the peak of a
rounded sinusoid the ratio is up to 2.4, 1 over √2 - 1."""

NEXT = 3
"""Number of values adjacent to the extreme one that are compared."""

LEVELS = 10
"""Least number of distinct other values: a channel that switches between few levels is not clipped."""

SAME = 1e-9
"""Difference from the extreme value, relative to the range, up to which a sample counts as equal to it."""

STILL, BY_NOISE = 0.003, 6.0
"""A coordinate moves during a run at a limit if it changes by more than this share of its range plus this many standard
deviations of its noise. During a rest sensors repeat a value without being clipped."""


class Limit(NamedTuple):
    """A value beyond which a signal does not go.

    Attributes:
        value: The value.
        samples: Mask of the samples at it (N,).
    """

    value: float
    samples: np.ndarray


def limits(x: np.ndarray) -> list[Limit]:
    """Limits at which a signal is clipped: its smallest value, its largest, both or none.

    Zero is no limit: an unloaded force plate reads it. A signal may also rest at an extreme value; `moves` tells the
    two apart by the motion.

    Args:
        x: Samples, NaN where one is missing (N,).
    """
    if not np.nanmax(x, initial=-np.inf) > np.nanmin(x, initial=np.inf):
        return []
    ends = (_limit(x, float(np.nanmin(x))), _limit(x, float(np.nanmax(x))))
    return [each for each in ends if each is not None]


def _limit(x: np.ndarray, extreme: float) -> Limit | None:
    """The extreme value as a limit, None if it is none."""
    same = SAME * np.nanmax(np.abs(x - extreme))
    samples = np.abs(x - extreme) <= same
    count = int(samples.sum())
    if extreme == 0 or count < max(FEWEST, SHARE * len(x)) or _longest(samples) < LASTS:
        return None
    others = np.round(np.abs(x - extreme)[np.isfinite(x) & ~samples] / same)
    _, beside = np.unique(others, return_counts=True)
    alone = len(beside) >= LEVELS and count > CROWDED * beside[:NEXT].max()
    return Limit(extreme, samples) if alone else None


def _longest(samples: np.ndarray) -> int:
    """Length of the longest run of true samples in a mask (N,)."""
    return int(np.diff(runs(samples)).max(initial=0))


def moves(samples: np.ndarray, q: np.ndarray) -> bool:
    """True if the mechanism moves while a signal is at a limit; otherwise the signal rests there.

    Args:
        samples: Mask of the samples at the limit (N,).
        q: Joint coordinates (N, n).
    """
    spans = [slice(first, end) for first, end in runs(samples) if end - first >= LASTS]
    enough = STILL * np.ptp(q, axis=0) + BY_NOISE * np.array([white_noise(x) for x in q.T])
    crossed = [(np.ptp(q[span], axis=0) > enough).any() for span in spans]
    # The mechanism has to move in most of the runs.
    return bool(np.mean(crossed or [0.0]) > 1 / 2)
