"""The contents of a log before any mapping: layout of text, column of times, and columns of numbers at common times."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.guesses.words import words
from ident.display.brief import listed
from ident.errors import LogError
from ident.files.arrays import STAMPS
from ident.files.csv_file import Layout
from ident.files.limits import LIMIT
from ident.files.readers import TEXT, files_of, has_several_clocks, name_of, read_clocks, read_files, read_tables
from ident.files.table import COUNT, FAR, TIME, TRUE, UNITS, Columns, Table, is_number
from ident.recordings.channels import rate_factor, rate_factors, with_continuous_angles
from ident.recordings.mapping import clocks
from ident.recordings.times import (
    GAP,
    Sampled,
    check_samples,
    going_back,
    interpolated,
    rate_of,
    streams_of,
    uniform_times,
)

ROWS = 20_000
"""Largest number of samples that are read."""

SLOWEST = {"s": 0.2, "ms": 200.0, "us": 2e5, "ns": 2e8}
"""Longest steps of times in each unit: nobody records a motion at less than 5 Hz."""

TRIAL = ".trc"
"""Suffix of files that hold only markers."""

ROUND = 2 * np.pi + 0.5
"""Largest angle of a joint that is plausible in radians."""


class ClockColumn(NamedTuple):
    """A column of times.

    Attributes:
        entry: Its entry in a mapping: column and unit, columns that are added, or the samples per second of a file
            without times, Hz.
        why: Reason for this choice.
    """

    entry: dict[str, Any]
    why: str

    @property
    def columns(self) -> Columns:
        """The column of times as `read_log` reads it."""
        return clocks({"time": [self.entry]})[0]


def clock_of(table: Table, rate: float = 0.0) -> ClockColumn:
    """The column of times: an increasing one, chosen by its name or else by its uniform steps.

    Args:
        table: The table.
        rate: Samples per second if no column is named like times, Hz; 0 if unknown.

    Raises:
        LogError: There are too few samples, no column increases, or several do and none is named like times.
    """
    check_samples(len(table.rows))
    columns, unread = _numbers(table)
    steps = {name: np.diff(x) for name, x in columns.items()}
    growing = {name: dx for name, dx in steps.items() if (dx >= 0).all() and np.median(dx) > 0}
    named = [name for name in growing if _is_named_time(name)]
    if not named and (stamp := _stamp_of(table, columns)):
        return stamp
    if rate and not named:
        return ClockColumn({"rate": rate}, f"no column has times, and --rate says {rate:g} Hz")
    # Counters of samples increase uniformly as well, but by one.
    counters = [name for name, dx in growing.items() if (dx == 1).all()]
    steady = [name for name, dx in growing.items() if np.median(np.abs(dx / np.median(dx) - 1)) < 0.5]
    candidates = named or [name for name in steady or growing if name not in counters]
    if not candidates:
        meant = next((name for name in table.cells if _is_named_time(name)), None)
        if meant in columns and (steps[meant] < 0).any():
            raise LogError(f"its times do not grow: {going_back(table, meant, columns[meant], words(meant).unit)}")
        why = f", of {listed(columns)}" if meant is None else f": {_fault_of_times(table, meant, columns, unread)}"
        why = f": '{counters[0]}' counts samples" if counters and meant is None else why
        raise LogError(
            f"no column of it grows as times do{why}; a log needs one, or --rate HZ; still poses need none where the "
            "columns file has poses = true."
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


def _stamp_of(table: Table, columns: Mapping[str, np.ndarray]) -> ClockColumn | None:
    """ROS's whole seconds and the nanoseconds beside them; None without such columns.

    Raises:
        LogError: They go back.
    """
    ends = ((name, end, beside) for name in columns for end, beside in STAMPS if name.endswith(end))
    pairs = [(name, name.removesuffix(end) + beside) for name, end, beside in ends]
    for pair in (pair for pair in pairs if pair[1] in columns):
        entry = {"columns": list(pair), "weights": [1, 1e-9], "unit": "s"}
        clock = ClockColumn(entry, "whole seconds, and nanoseconds beside them")
        (total,) = clock.columns.sums
        time = total.of([columns[name] for name in pair], len(table.rows))
        if (np.diff(time) < 0).any():
            raise LogError(f"its times do not grow: {going_back(table, total.name, time)}")
        if np.median(np.diff(time)) > 0:
            return clock
    return None


def _is_named_time(name: str) -> bool:
    return words(name).kind == "time" or words(name).unit in UNITS["time"]


def _fault_of_times(table: Table, name: str, columns: Mapping[str, np.ndarray], unread: Mapping[str, str]) -> str:
    """Reason for which a column that is named like times has none."""
    if name in unread:
        return unread[name].rstrip(".")
    empty = np.isnan(columns[name])
    if empty.any():
        return f"{table.row(int(empty.argmax()))}, column '{name}' is empty"
    return f"column '{name}' repeats most of its times"


OWN_TIMES = ClockColumn({"column": TIME, "unit": "s"}, "the file knows its times")
"""Clock of a file that has several."""

WHOLE_TURNS = (2 * np.pi, 360.0)
"""Jumps of wrapped angles, which are taken out as `read_log` does."""


@dataclass(frozen=True, eq=False)
class LogContents:
    """The contents of a log.

    Attributes:
        path: The file, or several as `FILE+FILE`.
        layouts: Layout of each file's text.
        clocks: Column of times of each file; empty for a single file that stores the times of its columns.
        time: Common times of the columns, uniform, s (N,).
        samples: Columns of numbers at these times (N,).
        unread: Errors of columns without numbers, by name.
        units: Units stated by the file, by column.
        has_gaps: True if cells or rows are missing, or times repeat with other values, in files with one clock.
        labels: Words of columns that hold one word throughout.
        markers: Labels of markers, whose columns are left out.
        notes: Sentences on what was repaired.
    """

    path: Path
    layouts: tuple[Layout, ...] = (Layout(),)
    clocks: tuple[ClockColumn, ...] = ()
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    samples: dict[str, np.ndarray] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    has_gaps: bool = False
    labels: dict[str, str] = field(default_factory=dict)
    markers: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Samples per second, Hz."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    @cached_property
    def columns(self) -> dict[str, np.ndarray]:
        """Columns that change (N,)."""
        return {name: x for name, x in self.samples.items() if np.ptp(x) > 0}

    @cached_property
    def constant(self) -> dict[str, float]:
        """Values of columns that never change."""
        return {name: float(x[0]) for name, x in self.samples.items() if name not in self.columns}

    @property
    def names(self) -> list[str]:
        """Columns with numbers, including constant ones."""
        return [*self.columns, *self.constant]

    @property
    def times(self) -> set[str]:
        """Columns of times."""
        return {name for clock in self.clocks for name in clock.columns.read} - {COUNT}

    def largest(self, name: str) -> float:
        """Largest size of a column."""
        return float(np.abs(self.samples.get(name, 0.0)).max())

    def states_unit(self, names: Collection[str]) -> bool:
        """True if the file states the unit of one of some columns."""
        return not self.units.keys().isdisjoint(names)

    def table(self, names: Sequence[str]) -> np.ndarray:
        """Columns side by side, zeros for those that are not in the log (N, k)."""
        columns = [self.samples.get(name, np.zeros(len(self.time))) for name in names]
        return np.reshape(columns, (len(names), len(self.time))).T

    def rate_factor(self, x: np.ndarray, rate: str) -> float:
        """Factor of a column to the derivative of a quantity (N,); 0 if they are hardly correlated."""
        return rate_factor(self.time, x, self.columns[rate])

    def are_rates(self, positions: Sequence[str], rates: Sequence[str]) -> np.ndarray:
        """True where columns may be derivatives of others, in any unit and of either sign (k, l)."""
        size = rate_factors(self.time, self.table(positions), self.table(rates))
        return np.any([is_one(size / unit) for unit in (1.0, 180 / np.pi, np.pi / 180)], axis=0)

    def summary(self, most: int) -> list[str]:
        """Lines on the file and on at most so many of its columns, those that change first."""
        changing, names = dict(islice(self.columns.items(), most)), [f"{k} ({x:g})" for k, x in self.constant.items()]
        size = max((len(name) for name in changing), default=0)
        headed = "" if all(each.header for each in self.layouts) else "; no header, so columns go by their numbers"
        lines = [
            f"{self.path}: {len(self.names)} columns of numbers, {self.time[-1] - self.time[0]:.4g} s at "
            f"{self.rate:.4g} Hz{headed}."
        ]
        lines += [f"Lines before the table that are left out: {each.skip}." for each in self.layouts if each.skip]
        lines += self.notes
        lines += [f"  {name:{size}}  {x.min():.5g} to {x.max():.5g}" for name, x in changing.items()]
        lines += [f"  and {len(self.columns) - most} more that change"] if len(self.columns) > most else []
        if self.markers:
            lines.append(f"  positions of {len(self.markers)} markers: {listed(self.markers, most)}")
        lines += [f"  never changing: {listed(names, most)}"] if names else []
        lines += [f"  not read: {why}" for why in islice(self.unread.values(), most)]
        return lines + ([f"  and {len(self.unread) - most} more not read"] if len(self.unread) > most else [])

    def without_markers(self, sites: Collection[str]) -> "LogContents":
        """The contents without positions of markers: of a file that holds markers, or named like sites of the model."""
        of_markers = any(file.suffix.lower() == TRIAL for file in files_of(self.path))
        axes: dict[str, list[str]] = {}
        for name in self.names:
            label, _, axis = name.rpartition(".")
            if label and axis.lower() in "xyz" and (of_markers or label.rpartition(":")[2] in sites):
                axes.setdefault(label, []).append(name)
        markers = {label: names for label, names in axes.items() if len(names) == 3}
        # Fewer show no body's pose.
        if len(markers) < 3:
            return self
        gone = {name for names in markers.values() for name in names}
        samples = {name: x for name, x in self.samples.items() if name not in gone}
        return replace(self, samples=samples, markers=tuple(markers))


def is_one(ratio: np.ndarray | float) -> np.ndarray:
    """True where the ratio of a rate to the derivative is that of one unit, of either sign, to a quarter."""
    most = 1.25
    return (np.abs(ratio) > 1 / most) & (np.abs(ratio) < most)


def log_contents(path: Path, limit: int = LIMIT, rate: float = 0.0) -> LogContents:
    """Reads a log, or the first `ROWS` samples of a long one, with times, gaps and turns as `read_log` reads them.

    Args:
        path: The log.
        limit: Bytes that an archive may take in memory.
        rate: Samples per second of files without a column named like times, Hz.

    Raises:
        LogError: The file is missing or damaged, has no numbers, or none of its columns can be times.
        InputError: The library that reads such files is not installed.
    """
    try:
        files = files_of(path)
        if len(files) == 1 and has_several_clocks(path):
            return _at_common_times(LogContents(path), read_clocks(path, limit=limit))
        layouts, own, tables = zip(*(_opened(file, limit, rate, len(files) == 1) for file in files), strict=True)
        if len(files) > 1:
            tables = tuple(read_files(files, layouts, [each.columns for each in own], limit=limit))
        return _at_common_times(LogContents(path, layouts, own), tables)
    except (LogError, OSError) as error:
        raise LogError(f"{path}: {error}") from None


def _opened(path: Path, limit: int, rate: float, alone: bool) -> tuple[Layout, ClockColumn, Table]:
    """Layout of a file, its column of times, and its first `ROWS` samples."""
    try:
        if has_several_clocks(path):
            return Layout(), OWN_TIMES, Table({}, (), "")
        layout = _layout(path, limit)
        table = next(read_tables(path, ROWS, limit=limit, layout=layout), None)
        if table is None:
            raise LogError("it has no rows of numbers.")
        clock = clock_of(table, rate)
        table = replace(table, sums={each.name: each for each in clock.columns.sums})
        return layout, clock, table.counted(clock.columns)
    except (LogError, OSError) as error:
        raise error if alone else LogError(f"{path.name}: {error}") from None


def _layout(path: Path, limit: int) -> Layout:
    """Layout of a text file: the first with which it can be read, of at most 40 lines before the table."""
    if not path.name.lower().endswith(TEXT) or not path.is_file():
        return Layout()
    errors = [LogError("a log needs a table with two columns of numbers or more.")]
    for skip in range(40):
        try:
            rows = next(read_tables(path, 2, limit=limit, layout=Layout(False, skip)), None)
            if rows is None:
                break
            layout = Layout(_is_header([[str(cell[0]), str(cell[-1])] for cell in rows.cells.values()]), skip)
            table = next(read_tables(path, 50, limit=limit, layout=layout), None)
            if table and len(_numbers(table)[0]) > 1:
                return layout
        except LogError as error:
            errors += [error] if not skip else []
    raise errors[-1]


def _is_header(cells: Sequence[Sequence[str]]) -> bool:
    """True if the first of two rows has names: no number, or a word above a number, as in `time,1,2,3`."""
    words_above = any(first and not is_number(first) and is_number(second) for first, second in cells)
    return words_above or not any(is_number(first) for first, _ in cells)


def _numbers(table: Table) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Columns with numbers, NaN where missing (N,), and errors of the others."""
    numbers, unread = dict[str, np.ndarray](), dict[str, str]()
    for name in (name for name in table.cells if not name.startswith(TRUE)):
        try:
            if not name.isprintable() or name != name.strip():
                raise LogError(f"column {name!r} has a name that a mapping cannot hold.")
            x = table.column(name, FAR, gaps=True)
            if not np.isfinite(x).any():
                raise LogError(f"column '{name}' is empty.")
            numbers[name] = x
        except LogError as error:
            unread[name] = str(error)
    return numbers, unread


def _at_common_times(log: LogContents, tables: Sequence[Table]) -> LogContents:
    """The log with columns of all tables at uniform times that all of them cover."""
    clock = log.clocks[0].columns if len(log.clocks) == 1 else OWN_TIMES.columns
    streams, notes, has_gaps = dict[str, Sampled](), list[str](), False
    for table in tables:
        own = table.column(clock.names[0])
        again = np.flatnonzero(np.diff(own) == 0)
        has_gaps |= any((x[again] != x[again + 1]).any() for x in _numbers(table)[0].values())
        # If times repeat or go back, the first ones are kept.
        table = table.where(own > np.maximum.accumulate(np.append(-np.inf, own[:-1])))
        numbers, errors = _numbers(table)
        names = [name for name in numbers if name not in clock.read]
        table, _ = with_continuous_angles(table, dict.fromkeys(names, WHOLE_TURNS), notes)
        channels = {name: table.column(name, FAR, gaps=True)[:, None] for name in names}
        streams |= streams_of(table, clock, channels, notes, gaps=bool(log.clocks) or None)
        texts = {name: {str(cell).strip() for cell in table.cells[name]} for name in errors}
        log.labels.update({name: next(iter(own)) for name, own in texts.items() if len(own) == 1})
        log.unread.update(errors)
        log.units.update(table.units)
    if not streams:
        raise LogError("it has times, but no other column of numbers.")
    time = uniform_times(streams, max(map(rate_of, streams.values())))[:ROWS]
    check_samples(len(time), " that all columns cover")
    for name, stream in streams.items():
        missing, steps = np.isnan(stream.values).mean(), np.diff(stream.time)
        log.samples[name] = interpolated(stream, time)[:, 0]
        notes += [f"Column '{name}' lacks {100 * missing:.2g} % of its samples."] if missing else []
        has_gaps = has_gaps or bool(missing or (steps > GAP * np.median(steps) * (1 + 1e-6)).any())
    return replace(log, time=time, notes=tuple(notes), has_gaps=has_gaps and bool(log.clocks))


def check_same_columns(
    first: LogContents, others: Sequence[Path], used: set[str], limit: int = LIMIT, rate: float = 0.0
) -> None:
    """Raises an error for logs that lack columns of the mapping.

    Raises:
        LogError: A log lacks one, or cannot be read.
    """
    for path in others:
        another = log_contents(path, limit, rate)
        if lacking := sorted(used - {*another.names, *another.times}):
            raise LogError(
                f"{path}: one mapping serves logs of the same columns, and here is no {', '.join(lacking)} as in "
                f"{name_of(first.path)}; map it by a run of its own."
            )
