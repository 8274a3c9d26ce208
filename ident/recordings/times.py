"""The time of a log: repeated samples dropped, gaps refused, jitter resampled."""

from dataclasses import dataclass

import numpy as np

from ident.errors import LogError
from ident.recordings.mapping import Columns
from ident.recordings.table import Table

LEAST_SAMPLES = 10
"""Fewest samples that a log needs."""

GAP, JITTER, UNIFORM = 1.5, 0.2, 1e-3
"""Steps of time in medians: longer ones are gaps, others are resampled; what departs less is as good as uniform."""

LATEST = 1e12
"""No clock shows more, s."""


@dataclass
class Clock:
    """The times of a log, which is read in pieces that overlap by one sample.

    Attributes:
        column: Its column of times.
        zero: What the column holds at the first sample; None before that.
        start: What the recording calls that time, s.
        step: Median step of the first piece, s.
    """

    column: Columns
    zero: float | None = None
    start: float = 0.0
    step: float = 0.0

    def repaired(
        self, table: Table, channels: dict[str, np.ndarray], notes: list[str]
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Uniform times of the samples that were not read before, and the channels at them.

        Args:
            table: The next piece of the file.
            channels: What was measured at these times, by name (N, k).
            notes: Sentences on what was repaired; more are appended.

        Raises:
            LogError: The times have a gap, go back, or repeat one with other values.
        """
        (name,) = self.column.names
        raw = table.column(name, LATEST / self.column.factor)
        if np.isnan(raw).any():
            raise LogError(f"column '{name}' is empty, but a log needs times.")
        read_before = 0 if self.zero is None else 1
        zero = float(raw[0]) if self.zero is None else self.zero
        time = (raw - zero) * self.column.factor
        kept = _increasing(table, name, time, channels, notes)
        time, channels = time[kept], {key: x[kept] for key, x in channels.items()}
        if self.zero is None:
            self._begin(zero, time, notes)
        steps = np.diff(time)
        gaps = steps > GAP * self.step * (1 + 1e-6)
        if gaps.any():
            i = int(gaps.argmax())
            raise LogError(
                f"{table.row(kept[i + 1])}, column '{name}' comes {steps[i]:g} s after the sample before where steps "
                f"are {self.step:g} s; a filter over a gap of {int(gaps.sum())} invents data: cut the log there."
            )
        grid = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / self.step) + 1)
        if len(grid) != len(time) or np.abs(time - grid).max() > UNIFORM * self.step:
            notes.append(_jitter(table, name, steps, self.step, kept))
            channels = {key: _interpolated(grid, time, x) for key, x in channels.items()}
        return self.start + grid[read_before:], {key: x[read_before:] for key, x in channels.items()}

    def _begin(self, zero: float, time: np.ndarray, notes: list[str]) -> None:
        """Takes start and step from the first piece."""
        (name,) = self.column.names
        if len(time) < LEAST_SAMPLES:
            raise LogError(f"a log needs at least {LEAST_SAMPLES} samples at different times, it has {len(time)}.")
        self.zero, self.start, self.step = zero, zero * self.column.factor, float(np.median(np.diff(time)))
        if abs(self.start) > 1e6:
            notes.append(f"Times start at {self.start:.10g} s; they are counted from there.")
            self.start = 0.0
        if self.step < 1e-6 or (self.step >= 1 and not self.column.unit):
            raise LogError(
                f"column '{name}' has steps of {self.step:g} s, which suggests that its unit is not the second; map "
                f'it, as in time = {{ column = "{name}", unit = "ms" }}.'
            )


def _increasing(
    table: Table, name: str, time: np.ndarray, channels: dict[str, np.ndarray], notes: list[str]
) -> np.ndarray:
    """Indices of the samples without those that repeat the one before."""
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


def _jitter(table: Table, name: str, steps: np.ndarray, step: float, kept: np.ndarray) -> str:
    departure = np.abs(steps / step - 1)
    i = int(departure.argmax())
    much = int((departure > JITTER).sum())
    return (
        f"Times in column '{name}' jitter: steps depart from {step:g} s by up to {100 * departure[i]:.2g} % "
        f"({table.row(kept[i + 1])}); all channels were resampled linearly at {1 / step:.6g} Hz."
        + (f" {much} steps depart by more than {100 * JITTER:g} %: doubt the clock." if much else "")
    )


def _interpolated(grid: np.ndarray, time: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(grid, time, column) for column in x.T], axis=1)
