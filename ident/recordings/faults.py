"""Faults of recorded signals: gaps between samples, limits at which sensors clip, and gross outliers."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ident.recordings.recording import Recording
from ident.recordings.resolution import UNIFORM, quantum, white_noise
from ident.recordings.times import Sampled, between_samples
from ident.tolerances import NORMAL_MAD

AT_ONCE = 1_000_000
"""Numbers of all windows that are in memory at the same time."""

INTERPOLATED = 0.05
"""Longest time between samples that is no gap, s: over it a motion of a few hertz is linear to some per cent of its
size. In a stream with a lower rate one missing sample is no gap."""

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


def runs(samples: np.ndarray) -> np.ndarray:
    """First samples and ends of the runs of true samples in a mask (N,), in order (k, 2)."""
    edges = np.diff(np.concatenate([[False], samples, [False]]).astype(np.int8))
    return np.stack([np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)], axis=1)


def running_median(x: np.ndarray, width: int, at: np.ndarray | None = None) -> np.ndarray:
    """Medians of the windows around samples (N,), or around those `at` indices (n,), beyond the ends of the end values.

    Args:
        x: Samples (N,).
        width: Samples of a window; one of even width begins a sample earlier, and gives the larger middle value.
        at: Indices of the windows' samples; by default all.
    """
    middle = width // 2
    windows = sliding_window_view(np.pad(x, (middle, width - middle - 1), mode="edge"), width)
    wanted = np.arange(len(x)) if at is None else at
    out = np.empty(len(wanted))
    step = max(1, AT_ONCE // width)
    for first in range(0, len(wanted), step):
        part = slice(first, first + step)
        out[part] = np.partition(windows[wanted[part]], middle, axis=1)[:, middle]
    return out


def longest_step(stream: Sampled) -> float:
    """Longest time between samples of a stream that is no gap, s."""
    return max(INTERPOLATED, 2 * float(np.median(np.diff(stream.time)))) if len(stream.time) > 1 else INTERPOLATED


def covered(recording: Recording, channels: Iterable[str]) -> np.ndarray:
    """Mask of the common times that lie in no gap of any of the channels (N,)."""
    inside = np.ones(len(recording.time), bool)
    for name in (name for name in channels if name in recording.streams):
        stream = recording.streams[name]
        there = np.isfinite(stream.columns)
        measured = Sampled(stream.time, stream.columns[:, there.any(axis=0)])
        if measured.values.size:
            inside &= between_samples(measured, recording.time, longest_step(measured))
    return inside


def stretches(time: np.ndarray, inside: np.ndarray) -> list[slice]:
    """Slices of consecutive samples without a gap.

    Args:
        time: Common times, s (N,).
        inside: Mask of the times that lie in no gap (N,).
    """
    at = np.flatnonzero(inside)
    if not len(at):
        return []
    far = np.diff(time[at]) > longest_step(Sampled(time, time))
    breaks = np.flatnonzero(far | (np.diff(at) > 1)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(at, breaks)]


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
