"""Faults of single channels: gross outliers, removed before a filter spreads them, and samples at a sensor's limit."""

from typing import NamedTuple

import numpy as np

from ident.recordings.resolution import UNIFORM, quantum, white_noise
from ident.recordings.runs import running_median, runs
from ident.tolerances import NORMAL_MAD

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

WINDOW = 11
"""Samples of the running median."""

GROSS = 8.0
"""Multiple of the typical deviation from the running median beyond which a sample is an outlier, if it also exceeds
the channel's own spread."""

ISOLATED = 2
"""Longest run of samples that counts as an outlier; an impact lasts longer."""


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


def despiked(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Channels with their isolated gross outliers interpolated (Hampel's filter).

    A step of the resolution is no outlier, not even in a channel that is constant for a while.

    Args:
        x: Channels (N, C); those with NaN stay as they are.

    Returns:
        The channels (N, C), and the number of samples replaced in each (C,).
    """
    out, counts = np.array(x, float), np.zeros(x.shape[1], int)
    for c in np.flatnonzero(np.isfinite(out).all(axis=0)):
        bad = _isolated(_gross(out[:, c]))
        counts[c] = bad.sum()
        if bad.any() and not bad.all():
            out[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), out[~bad, c])
    return out, counts


def _gross(x: np.ndarray) -> np.ndarray:
    """Mask of the samples of a channel that are far from the running median (N,)."""
    deviation = np.abs(x - running_median(x, WINDOW))
    usual = max(np.median(deviation), UNIFORM * quantum(x))
    least = NORMAL_MAD * max(GROSS * usual, np.median(np.abs(x - np.median(x))))
    # The typical deviation around a sample matters for few of them, and takes most of the time.
    out = deviation > least
    far = np.flatnonzero(out)
    out[far] = deviation[far] > NORMAL_MAD * GROSS * running_median(deviation, 5 * WINDOW, far)
    return out


def _isolated(samples: np.ndarray) -> np.ndarray:
    """Mask without its longer runs (N,)."""
    out = samples.copy()
    for first, end in runs(samples):
        out[first:end] = end - first <= ISOLATED
    return out
