"""Gaps of a recording: where its channels at common times are straight lines between samples that are far apart."""

from collections.abc import Iterable

import numpy as np

from ident.recordings.recording import Recording
from ident.recordings.sampled import Sampled, between_samples

INTERPOLATED = 0.05
"""Longest time between samples over which a channel may be interpolated, s: motions of people and robots at some hertz
are a straight line over it to some per cent of their size; a stream with fewer samples may miss one."""


def longest_step(stream: Sampled) -> float:
    """Time between samples of a stream from which it has a gap, s."""
    return max(INTERPOLATED, 2 * float(np.median(np.diff(stream.time)))) if len(stream.time) > 1 else INTERPOLATED


def covered(recording: Recording, channels: Iterable[str]) -> np.ndarray:
    """Mask of the common times that lie in no gap of some channels (N,)."""
    inside = np.ones(len(recording.time), bool)
    for name in (name for name in channels if name in recording.streams):
        stream = recording.streams[name]
        there = np.isfinite(stream.columns)
        measured = Sampled(stream.time, stream.columns[:, there.any(axis=0)])
        if measured.values.size:
            inside &= between_samples(measured, recording.time, longest_step(measured))
    return inside


def stretches(time: np.ndarray, inside: np.ndarray) -> list[slice]:
    """Samples that follow one another without a gap.

    Args:
        time: Common times, s (N,).
        inside: Whether each lies in no gap (N,).
    """
    at = np.flatnonzero(inside)
    if not len(at):
        return []
    far = np.diff(time[at]) > longest_step(Sampled(time, time))
    breaks = np.flatnonzero(far | (np.diff(at) > 1)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(at, breaks)]
