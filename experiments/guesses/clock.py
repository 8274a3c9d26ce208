"""The column of times of a log, and its unit."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.guesses.words import words
from ident.errors import LogError
from ident.files.column import UNITS, Columns
from ident.files.selection import COUNT, clock_of_rate

ROWS = 20_000
"""Largest number of samples that are read."""

SLOWEST = {"s": 0.2, "ms": 200.0, "us": 2e5, "ns": 2e8}
"""Longest steps of times in each unit: nobody records a motion at less than 5 Hz."""


@dataclass(frozen=True)
class Clock:
    """A column of times.

    Attributes:
        column: Its name.
        unit: Its unit.
        why: Reason for this choice.
        rate: Samples per second of a file without times, Hz; 0 for a file with times.
    """

    column: str
    unit: str
    why: str
    rate: float = 0.0

    @property
    def columns(self) -> Columns:
        """The column of times in a mapping."""
        if self.rate:
            return clock_of_rate("--rate", self.rate)
        return Columns((self.column,), UNITS["time"][self.unit], "s")

    @property
    def entry(self) -> dict[str, Any]:
        """Its entry in a mapping."""
        return {"rate": self.rate} if self.rate else {"column": self.column, "unit": self.unit}


def clock_of(columns: Mapping[str, np.ndarray], rate: float = 0.0) -> Clock:
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
        return Clock(COUNT, "s", f"no column has times, and --rate says {rate:g} Hz", rate)
    # Counters of samples increase uniformly as well, but by one.
    steady = [name for name, dx in growing.items() if np.median(np.abs(dx / np.median(dx) - 1)) < 0.5]
    others = [name for name in steady if not (steps[name] == 1).all()]
    candidates = named or others or list(growing)
    if not candidates:
        raise LogError(
            f"no column of it grows as times do, of {', '.join(list(columns)[:20])}; a log needs one, or --rate HZ; "
            "still poses need none where the columns file has poses = true."
        )
    exact = [name for name in candidates if name.lower() in ("time", "t")] or candidates
    if len(exact) > 1:
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
    return Clock(column, unit, f"{what}; {unit} since {how}")
