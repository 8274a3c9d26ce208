"""The time of a log: repeated samples dropped, gaps refused, jitter resampled."""

import numpy as np

from ident.errors import LogError
from ident.recordings.mapping import Columns
from ident.recordings.table import SAMPLES, Table

GAP, JITTER, ROUNDING = 1.5, 0.2, 1e-3
"""Steps of time in medians: longer ones are gaps, others are resampled; what departs less is as good as uniform."""

LATEST = 1e12
"""No clock shows more, s."""


def repaired(
    table: Table, columns: Columns, channels: dict[str, np.ndarray], notes: list[str]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Uniform times, and the channels at them.

    Args:
        table: The file.
        columns: Its column of times.
        channels: What was measured at these times, by name (N, k).
        notes: Sentences on what was repaired; more are appended.

    Raises:
        LogError: The times have a gap, go back, or repeat one with other values.
    """
    (name,) = columns.names
    raw = table.column(name, "time", LATEST / columns.factor)
    if np.isnan(raw).any():
        raise LogError(f"column '{name}' is empty, but a log needs times.")
    time, start = (raw - raw[0]) * columns.factor, raw[0] * columns.factor
    if abs(start) > 1e6:
        notes.append(f"Times start at {start:.10g} s; they are counted from there.")
        start = 0.0
    kept = _increasing(table, name, time, channels, notes)
    time = time[kept]
    channels = {key: x[kept] for key, x in channels.items()}
    if len(time) < SAMPLES:
        raise LogError(f"a log needs at least {SAMPLES} samples at different times, it has {len(time)}.")
    steps = np.diff(time)
    step = float(np.median(steps))
    if step < 1e-6 or (step >= 1 and not columns.unit_stated):
        raise LogError(
            f"column '{name}' has steps of {step:g} s, which suggests that its unit is not the second; map it, as in "
            f'time = {{ column = "{name}", unit = "ms" }}.'
        )
    gaps = steps > GAP * step * (1 + 1e-6)
    if gaps.any():
        i = int(gaps.argmax())
        raise LogError(
            f"{table.row(kept[i + 1])}, column '{name}' comes {steps[i]:g} s after the sample before where steps are "
            f"{step:g} s; a filter over a gap of {int(gaps.sum())} invents data: cut the log there."
        )
    grid = np.linspace(0, time[-1], round(time[-1] / step) + 1)
    if len(grid) == len(time) and np.abs(time - grid).max() <= ROUNDING * step:
        return start + grid, channels
    notes.append(_jitter(table, name, steps, step, kept))
    return start + grid, {key: _interpolated(grid, time, x) for key, x in channels.items()}


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
