"""Times of a log: repeated samples dropped, gaps refused or kept, jitter resampled, with the streams as measured."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.selection import EPOCH
from ident.files.table import Table
from ident.recordings.sampled import AS_MEASURED, GAP, Sampled, covered, interpolated
from ident.recordings.stated import untracked

LEAST_SAMPLES = 10
"""Fewest samples that a log needs."""

JITTER, UNIFORM = 0.2, 1e-3
"""Relative deviation of time steps from their median above which a clock is doubtful, and up to which it is uniform."""

SPARSE = 1000
"""Number of common times per sample above which a gap is an error of the clock."""

POSES = " If each row is a pose at rest, say poses = true in the columns file."
"""Advice for logs that look like poses, not like motions."""

SLOW = 1.0
"""Time between samples from which they may be poses at rest, s."""

LATEST = 1e12
"""Largest time that is accepted, s."""


class Repaired(NamedTuple):
    """A piece of a log at uniform times.

    Attributes:
        time: Sample times, s (N,).
        channels: Channels by key of the mapping; complete, or NaN in columns that are missing (N, k).
        streams: Channels as they were measured, for those where this differs.
    """

    time: np.ndarray
    channels: dict[str, np.ndarray]
    streams: dict[str, Sampled]


@dataclass
class Clock:
    """The times of a log, which is read in pieces that overlap by one sample.

    Attributes:
        column: Its column of times.
        gaps: True if samples may be missing.
        zero: Value of the column at the first sample; None before the first piece.
        start: Time of that sample in the recording, s.
        step: Median step of the first piece, s.
    """

    column: Columns
    gaps: bool = False
    zero: float | None = None
    start: float = 0.0
    step: float = 0.0

    def repaired(self, table: Table, channels: dict[str, np.ndarray], notes: list[str]) -> Repaired:
        """The new samples of a piece, at uniform times.

        Args:
            table: The next piece of the file.
            channels: Channels at its times, by name (N, k).
            notes: Sentences on what was repaired; more are appended.

        Raises:
            LogError: The times have a gap where samples may not be missing, go back, or repeat one with other values.
        """
        (name,) = self.column.names
        raw = table.column(name, LATEST / self.column.factor)
        if np.isnan(raw).any():
            raise LogError(f"column '{name}' is empty, but a log needs times.")
        read_before = 0 if self.zero is None else 1
        zero = float(raw[0]) if self.zero is None else self.zero
        time = (raw - zero) * self.column.factor
        kept = increasing(table, name, time, channels, notes)
        time, channels = time[kept], {key: x[kept] for key, x in channels.items()}
        if self.zero is None:
            self._begin(zero, time, notes)
        self._check_gaps(table, time, kept, notes)
        check_jumps(f"column '{name}'", time, self.step)
        grid = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / self.step) + 1)
        uniform = len(grid) == len(time) and np.abs(time - grid).max() <= UNIFORM * self.step
        if not uniform:
            notes += self._jitter(table, time, kept)
        own = grid if uniform else time
        streams = {key: Sampled(own, x) for key, x in channels.items() if not uniform or _has_gaps(x)}
        grid = _covered(grid, untracked(streams))
        channels = {key: interpolated(Sampled(own, x), grid) for key, x in channels.items()} if streams else channels
        streams = {key: Sampled(self.start + own[read_before:], x.values[read_before:]) for key, x in streams.items()}
        return Repaired(self.start + grid[read_before:], {k: x[read_before:] for k, x in channels.items()}, streams)

    def _check_gaps(self, table: Table, time: np.ndarray, kept: np.ndarray, notes: list[str]) -> None:
        """Refuses gaps, or notes them if samples may be missing."""
        (name,) = self.column.names
        steps = np.diff(time)
        gaps = self._are_gaps(steps)
        number = int(gaps.sum())
        if number and self.gaps:
            i = int(steps.argmax())
            notes.append(
                f"Times in column '{name}' have gaps: {number}, the longest of {steps[i]:g} s before "
                f"{table.row(kept[i + 1])}. {AS_MEASURED}"
            )
        elif number:
            i = int(steps.argmax())
            others = f"; it is the longest of {number} gaps" if number > 1 else ""
            start, end = self.start + time[i : i + 2]
            raise LogError(
                f"{table.row(kept[i + 1])}, column '{name}' has a gap of {steps[i]:g} s, from {start:g} s "
                f"to {end:g} s, where steps are {self.step:g} s{others}. A filter would "
                "invent what is missing: cut the log there, or say that samples may be missing (--gaps, gaps=True in "
                f"Python), for the trajectory estimate.{POSES if self.step >= SLOW else ''}"
            )

    def _are_gaps(self, steps: np.ndarray) -> np.ndarray:
        return steps > GAP * self.step * (1 + 1e-6)

    def _jitter(self, table: Table, time: np.ndarray, kept: np.ndarray) -> list[str]:
        """Notes on the jitter of steps that are no gaps."""
        (name,) = self.column.names
        steps = np.diff(time)
        departure = np.where(self._are_gaps(steps), 0.0, np.abs(steps / self.step - 1))
        i = int(departure.argmax())
        if self.gaps and departure[i] <= UNIFORM:
            return []
        much = int((departure > JITTER).sum())
        return [
            f"Times in column '{name}' jitter: steps depart from {self.step:g} s by up to {100 * departure[i]:.2g} % "
            f"({table.row(kept[i + 1])}); all channels were resampled linearly at {1 / self.step:.6g} Hz."
            + (f" {much} steps depart by more than {100 * JITTER:g} %: doubt the clock." if much else "")
        ]

    def _begin(self, zero: float, time: np.ndarray, notes: list[str]) -> None:
        """Sets start and step from the first piece."""
        (name,) = self.column.names
        if len(time) < LEAST_SAMPLES:
            raise LogError(f"a log needs at least {LEAST_SAMPLES} samples at different times, it has {len(time)}.")
        self.zero, self.start, self.step = zero, zero * self.column.factor, float(np.median(np.diff(time)))
        if abs(self.start) > EPOCH:
            notes.append(f"Times start at {self.start:.10g} s; they are counted from there.")
            self.start = 0.0
        if self.step < 1e-6 or (self.step >= SLOW and not self.column.unit):
            raise LogError(
                f"column '{name}' has steps of {self.step:g} s, which suggests that its unit is not the second; map "
                f'it, as in time = {{ column = "{name}", unit = "ms" }}.{POSES if self.step >= SLOW else ""}'
            )


def check_jumps(what: str, time: np.ndarray, step: float) -> None:
    """Refuses times so far apart that nearly all common times would be in a gap, as after one wrong time stamp.

    Args:
        what: Name of the times, for the message.
        time: Sample times, s (N,).
        step: Step of the common times, s.

    Raises:
        LogError: They are too far apart.
    """
    if time[-1] - time[0] > SPARSE * len(time) * step:
        i = int(np.diff(time).argmax())
        raise LogError(
            f"{what} jumps from {time[i]:.10g} s to {time[i + 1]:.10g} s where {len(time)} samples have steps of "
            f"{step:g} s; take one side of it ([select] time, in the mapping)."
        )


def increasing(
    table: Table, name: str, time: np.ndarray, channels: dict[str, np.ndarray], notes: list[str]
) -> np.ndarray:
    """Indices of the samples, without those that repeat the one before."""
    steps = np.diff(time)
    if (steps < 0).any():
        i = int((steps < 0).argmax()) + 1
        raise LogError(f"{table.row(i)}, column '{name}' goes back in time by {-steps[i - 1]:g} s; sort the log.")
    repeated = np.append(False, steps == 0)
    for i in map(int, np.flatnonzero(repeated)):
        if not all(np.array_equal(x[i], x[i - 1], equal_nan=True) for x in channels.values()):
            raise LogError(
                f"{table.row(i)}, column '{name}' repeats the time of the sample before, but not its values; "
                "which of them holds is not known."
            )
    if repeated.any():
        first = table.row(int(repeated.argmax()))
        notes.append(f"Samples that repeat the one before were dropped: {int(repeated.sum())}, the first is {first}.")
    return np.flatnonzero(~repeated)


def _has_gaps(x: np.ndarray) -> bool:
    """True if a column lacks some samples, but not all."""
    missing = np.isnan(x)
    return bool((missing.any(axis=0) & ~missing.all(axis=0)).any())


def _covered(grid: np.ndarray, streams: dict[str, Sampled]) -> np.ndarray:
    """The times that all streams cover."""
    if not any(_has_gaps(stream.values) for stream in streams.values()):
        return grid
    first, last = zip(*(span for stream in streams.values() if (span := covered(stream)) is not None), strict=True)
    inside = grid[(grid >= max(first)) & (grid <= min(last))]
    if len(inside) < LEAST_SAMPLES:
        raise LogError(f"a log needs at least {LEAST_SAMPLES} samples that all columns cover, it has {len(inside)}.")
    return inside
