"""The contents of a log before any mapping: layout of text, numeric columns at common times, and irregularities."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from experiments.guesses.clock import ROWS, Clock, clock_of
from ident.errors import LogError
from ident.files.csv_file import Layout
from ident.files.limits import LIMIT
from ident.files.readers import TEXT, has_several_clocks, read_clocks, read_tables
from ident.files.selection import counted
from ident.files.table import TRUE, Table, is_number
from ident.recordings.columns.mapping import ColumnMapping
from ident.recordings.sampled import GAP, Sampled, interpolated, rate_of, uniform_times
from ident.recordings.several_files import files_of, name_of, read_files
from ident.recordings.turns import unwrapped

OWN_TIMES = Clock("time", "s", "the file knows its times")
"""Placeholder for the clock of a file that has several, beside other files."""

WHOLE_TURNS = (2 * np.pi, 360.0)
"""Jumps of wrapped angles, which are taken out as `read_log` does."""

PREAMBLE = 40
"""Largest number of lines before a table."""


@dataclass(frozen=True, eq=False)
class LogContents:
    """The contents of a log.

    Attributes:
        path: The file, or several as `FILE+FILE`.
        layouts: Layout of each file's text.
        clocks: Column of times of each file; empty for a single file that stores the times of its columns.
        time: Common times of the columns, uniform, s (N,).
        columns: Columns of numbers that change, at these times (N,).
        constant: Values of columns that never change.
        missing: Share of missing numbers in each column that has some.
        unread: Errors of columns without numbers, by name.
        units: Units stated by the file, by column.
        holes: Number of time steps that are gaps.
        labels: Words of columns that hold one word throughout.
        markers: Labels of markers, whose columns are left out.
        jumps: Number of jumps by a whole turn that were taken out, by column.
    """

    path: Path
    layouts: tuple[Layout, ...]
    clocks: tuple[Clock, ...]
    time: np.ndarray
    columns: dict[str, np.ndarray]
    constant: dict[str, float] = field(default_factory=dict)
    missing: dict[str, float] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    holes: int = 0
    labels: dict[str, str] = field(default_factory=dict)
    markers: tuple[str, ...] = ()
    jumps: dict[str, int] = field(default_factory=dict)

    @property
    def has_gaps(self) -> bool:
        """True if cells or rows are missing, in files with one clock."""
        return bool(self.clocks) and bool(self.missing or self.holes)

    @property
    def rate(self) -> float:
        """Samples per second, Hz."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    @property
    def names(self) -> list[str]:
        """Columns with numbers, including constant ones."""
        return [*self.columns, *self.constant]

    def summary(self) -> list[str]:
        """Lines on the file and each of its columns."""
        size = max((len(name) for name in self.columns), default=0)
        lines = [
            f"{self.path}: {len(self.names)} columns of numbers, {self.time[-1] - self.time[0]:.4g} s at "
            f"{self.rate:.4g} Hz"
            + ("" if all(each.header for each in self.layouts) else "; no header, so columns go by their numbers")
            + "."
        ]
        lines += [f"Its times have {self.holes} gaps."] if self.holes else []
        lines += [f"{each.skip} lines before the table are left out." for each in self.layouts if each.skip]
        for name, x in self.columns.items():
            lost = f", {100 * self.missing[name]:.2g} % missing" if name in self.missing else ""
            wraps = f", without {self.jumps[name]} jumps by a whole turn" if name in self.jumps else ""
            lines.append(f"  {name:{size}}  {x.min():.5g} to {x.max():.5g}{lost}{wraps}")
        if self.markers:
            lines.append(f"  positions of {len(self.markers)} markers: {', '.join(self.markers)}")
        if self.constant:
            lines.append(
                f"  never changing: {', '.join(f'{name} ({value:g})' for name, value in self.constant.items())}"
            )
        return lines + [f"  not read: {why}" for why in self.unread.values()]


def log_contents(path: Path, limit: int = LIMIT, rate: float = 0.0) -> LogContents:
    """Reads a log, or the first `ROWS` samples of a long one.

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
            return _at_common_times(path, None, read_clocks(path, limit=limit))
        parts = [_file(file, limit, rate, alone=len(files) == 1) for file in files]
        layouts, clocks = tuple(layout for layout, _, _ in parts), tuple(clock for _, clock, _ in parts)
        tables, clock = [table for _, _, table in parts if table], clocks[0] if len(files) == 1 else None
        if len(files) > 1:
            mapping = ColumnMapping(layouts=layouts, clocks=tuple(each.columns for each in clocks))
            tables = read_files(files, mapping, limit)
        return replace(_at_common_times(path, clock, tables), layouts=layouts, clocks=clocks)
    except (LogError, OSError) as error:
        raise LogError(f"{path}: {error}") from None


def _file(path: Path, limit: int, rate: float, *, alone: bool) -> tuple[Layout, Clock, Table | None]:
    """Layout of a file, its column of times, and its first `ROWS` samples."""
    if has_several_clocks(path):
        return Layout(), OWN_TIMES, None
    try:
        layout = _layout(path, limit)
        table = next(read_tables(path, ROWS, limit=limit, layout=layout), None)
        if table is None:
            raise LogError("it has no rows of numbers.")
        clock = clock_of(_numbers(table, {}), rate)
    except (LogError, OSError) as error:
        raise error if alone else LogError(f"{path.name}: {error}") from None
    (table,) = counted([table], clock.columns)
    return layout, clock, table


def _layout(path: Path, limit: int) -> Layout:
    """Layout of a text file: the first with which it can be read."""
    if not path.name.lower().endswith(TEXT) or not path.is_file():
        return Layout()
    first: LogError | None = None
    for skip in range(PREAMBLE):
        try:
            row = next(read_tables(path, 1, limit=limit, layout=Layout(False, skip)), None)
            if row is None:
                break
            cells = [str(cell[0]) for cell in row.cells.values()]
            layout = Layout(not all(is_number(cell) for cell in cells if cell), skip)
            several = [_numbers(table, {}) for table in islice(read_tables(path, 50, limit=limit, layout=layout), 1)]
        except LogError as error:
            first = first if skip else error
            continue
        if several and len(several[0]) > 1:
            return layout
    raise first or LogError("a log needs a table with two columns of numbers or more.")


def _numbers(table: Table, unread: dict[str, str]) -> dict[str, np.ndarray]:
    """Columns with numbers, NaN where missing (N,); errors of the others are put into `unread`."""
    numbers = {}
    for name in table.cells:
        if name.startswith(TRUE):
            continue
        try:
            if not name.isprintable() or name != name.strip():
                raise LogError(f"column {name!r} has a name that a mapping cannot hold.")
            x = table.column(name, gaps=True)
        except LogError as error:
            unread[name] = str(error)
            continue
        if np.isfinite(x).any():
            numbers[name] = x
        else:
            unread[name] = f"column '{name}' is empty."
    return numbers


def _labels(table: Table, names: Iterable[str]) -> dict[str, str]:
    """Words of columns that hold one word throughout, such as joint names in a ROS message."""
    there = {name: {str(cell).strip() for cell in table.cells[name]} for name in names if name in table.cells}
    return {name: next(iter(texts)) for name, texts in there.items() if len(texts) == 1}


def _at_common_times(path: Path, clock: Clock | None, tables: Sequence[Table]) -> LogContents:
    """Columns of all tables, interpolated at uniform times that all of them cover."""
    unread: dict[str, str] = {}
    sampled: dict[str, Sampled] = {}
    units, labels, jumps = dict[str, str](), dict[str, str](), dict[str, int]()
    holes = 0
    for table in tables:
        numbers = _numbers(table, unread)
        labels |= _labels(table, unread)
        own = numbers.pop(clock.column if clock else "time", np.empty(0)) * (clock.columns.factor if clock else 1.0)
        if len(own) < 10:
            raise LogError(f"a log needs at least 10 samples, it has {len(own)}.")
        # If times repeat or go back, the first ones are kept.
        kept = np.flatnonzero(own > np.maximum.accumulate(np.append(-np.inf, own[:-1])))
        for name, x in numbers.items():
            x, number = unwrapped(x[kept], WHOLE_TURNS)
            sampled[name] = Sampled(own[kept] - (own[0] if clock else 0), x)
            jumps |= {name: number} if number else {}
        units |= table.units
        steps = np.diff(own[kept])
        holes += int((steps > GAP * np.median(steps) * (1 + 1e-6)).sum())
    if not sampled:
        raise LogError("it has times, but no other column of numbers.")
    time = uniform_times(sampled, max(map(rate_of, sampled.values())))[:ROWS]
    if len(time) < 10:
        raise LogError("a log needs at least 10 samples that all columns cover.")
    missing = {name: float(np.isnan(x.values).mean()) for name, x in sampled.items() if np.isnan(x.values).any()}
    changing = {name: x for name, x in sampled.items() if np.nanmax(x.values) > np.nanmin(x.values)}
    columns = {name: interpolated(Sampled(x.time, x.values), time) for name, x in changing.items()}
    constant = {name: float(np.nanmean(x.values)) for name, x in sampled.items() if name not in changing}
    return LogContents(
        path, (Layout(),), (), time, columns, constant, missing, unread, units, holes, labels, jumps=jumps
    )


def check_same_columns(
    first: LogContents, others: Sequence[Path], used: set[str], limit: int = LIMIT, rate: float = 0.0
) -> None:
    """Raises an error for logs that lack columns of the mapping.

    Raises:
        LogError: A log lacks one, or cannot be read.
    """
    for path in others:
        another = log_contents(path, limit, rate)
        if lacking := sorted(used - {*another.names, *(clock.column for clock in another.clocks)}):
            raise LogError(
                f"{path}: one mapping serves logs of the same columns, and here is no {', '.join(lacking)} as in "
                f"{name_of(first.path)}; map it by a run of its own."
            )
