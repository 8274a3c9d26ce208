"""Runs of samples, running medians, and gaps: a few lines of numpy each, where scipy.ndimage takes long to import."""

from collections.abc import Iterable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ident.recordings.recording import Recording
from ident.recordings.sampled import Sampled, between_samples

AT_ONCE = 1_000_000
"""Numbers of all windows that are in memory at the same time."""


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


INTERPOLATED = 0.05
"""Longest time between samples that is no gap, s: over it a motion of a few hertz is linear to some per cent of its
size. In a stream with a lower rate one missing sample is no gap."""


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
