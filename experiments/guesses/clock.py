"""The column of times of a log, and its unit."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from experiments.guesses.words import words
from ident.errors import LogError
from ident.files.column import UNITS, Columns
from ident.recordings.columns.entries import clocks

ROWS = 20_000
"""Largest number of samples that are read."""

SLOWEST = {"s": 0.2, "ms": 200.0, "us": 2e5, "ns": 2e8}
"""Longest steps of times in each unit: nobody records a motion at less than 5 Hz."""


class ClockColumn(NamedTuple):
    """A column of times.

    Attributes:
        entry: Its entry in a mapping: column and unit, or the samples per second of a file without times, Hz.
        why: Reason for this choice.
    """

    entry: dict[str, Any]
    why: str

    @property
    def columns(self) -> Columns:
        """The column of times as `read_log` reads it."""
        return clocks({"time": [self.entry]})[0]


def clock_of(columns: Mapping[str, np.ndarray], rate: float = 0.0) -> ClockColumn:
    """The column of times: an increasing one, chosen by its name or else by its uniform steps.

    Args:
        columns: Columns of numbers by name (N,).
        rate: Samples per second if no column is named like times, Hz; 0 if unknown.

    Raises:
        LogError: No column increases, or several do and none is named like times.
    """
    steps = {name: np.diff(x) for name, x in columns.items()}
    growing = {name: dx for name, dx in steps.items() if len(dx) and (dx >= 0).all() and np.median(dx) > 0}
    named = [name for name in growing if words(name).kind == "time" or words(name).unit in UNITS["time"]]
    if rate and not named:
        return ClockColumn({"rate": rate}, f"no column has times, and --rate says {rate:g} Hz")
    # Counters of samples increase uniformly as well, but by one.
    steady = [name for name, dx in growing.items() if np.median(np.abs(dx / np.median(dx) - 1)) < 0.5]
    candidates = named or [name for name in steady if not (steps[name] == 1).all()] or list(growing)
    if not candidates:
        raise LogError(
            f"no column of it grows as times do, of {', '.join(list(columns)[:20])}; a log needs one, or --rate HZ; "
            "still poses need none where the columns file has poses = true."
        )
    exact = [name for name in candidates if name.lower() in ("time", "t")] or candidates
    exact = [name for name in exact if "_ros" not in name and words(name).core == ()] or exact
    # Columns of times may be the same in other units, or with another origin.
    if not all(np.corrcoef(columns[exact[0]], columns[name])[0, 1] > 1 - 1e-6 for name in exact[1:]):
        raise LogError(f"its times may be any of {', '.join(exact)}; name one of them time, or take the others out.")
    column = exact[0]
    stated, step = words(column).unit, float(np.median(steps[column]))
    by_step = next((unit for unit, slowest in SLOWEST.items() if step <= slowest), "ns")
    unit = stated if stated in UNITS["time"] else by_step
    how = "its name says so" if unit == stated else f"steps of {step:.4g} are {step * UNITS['time'][unit]:.3g} s then"
    what = "named so" if column in named else "it alone grows steadily"
    return ClockColumn({"column": column, "unit": unit}, f"{what}; {unit} since {how}")
