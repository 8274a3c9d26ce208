"""Gaps of a recording: times at which a channel is interpolated between samples that are far apart."""

from collections.abc import Iterable

import numpy as np

from ident.recordings.recording import Recording
from ident.recordings.sampled import Sampled, between_samples

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
