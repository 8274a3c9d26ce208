"""A log in several files, `angles.mot+forces.mot`: tables with times of their own, all in seconds from one zero."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.csv_file import Layout
from ident.files.readers import SEVERAL_CLOCKS, TEXT, is_bag, is_log, read_clocks, read_tables
from ident.files.selection import EPOCH, counted
from ident.files.table import TRUE, Table
from ident.recordings.columns.mapping import ColumnMapping
from ident.recordings.several_clocks import TIME

USUAL = ("time", "t")
"""Names of columns of times."""


def files_of(log: Path) -> tuple[Path, ...]:
    """Files of a log: the log itself, or each file of `FILE+FILE`."""
    if log.exists():
        return (log,)
    files, name = list[Path](), ""
    for part in str(log).split("+"):
        name = f"{name}+{part}" if name else part
        if is_log(Path(name)):
            files, name = [*files, Path(name)], ""
    return (*files, Path(name)) if name or not files else tuple(files)


def name_of(log: Path) -> str:
    """Name of a log without folders."""
    return "+".join(file.name for file in files_of(log))


def read_files(files: Sequence[Path], mapping: ColumnMapping, limit: int) -> list[Table]:
    """Tables of several files, each with a column `time` in s.

    Columns that two files have are called `1:NAME` and `2:NAME`, by the number of the file.

    Args:
        files: The files, in the order of the mapping's entries.
        mapping: Their layouts, and their columns of times if names do not show them.
        limit: Bytes that each may take in memory.

    Raises:
        LogError: One is missing or damaged, its times are missing or of another epoch than the others', or the mapping
            is for another number of files.
        InputError: The library that reads one is not installed.
    """
    if twice := [file.name for file in files if [each.resolve() for each in files].count(file.resolve()) > 1]:
        raise LogError(f"a log is made of different files, but {twice[0]} is given twice.")
    layouts, clocks = _layouts_and_clocks(files, mapping)
    tables: list[list[Table]] = []
    for file, layout, clock in zip(files, layouts, clocks, strict=True):
        try:
            own = _tables(file, layout, clock, limit)
        except (LogError, OSError) as error:
            raise LogError(f"{file.name}: {error}") from None
        tables.append([replace(table, word=f"{file.name} {table.word}") for table in own])
    return _from_one_zero(files, _apart(tables))


def _layouts_and_clocks(files: Sequence[Path], mapping: ColumnMapping) -> tuple[list[Layout], list[Columns | None]]:
    """Layout of each file, and its column of times; None to find it by name.

    Raises:
        LogError: The mapping is for another number of files.
    """
    check_number(len(files), mapping)
    layouts = list(mapping.layouts)
    if len(layouts) == 1:
        # A layout for all text files does not apply to other files.
        layouts = [layouts[0] if file.name.lower().endswith(TEXT) else Layout() for file in files]
    return layouts, [*mapping.clocks] or [mapping.columns.get(TIME)] * len(files)


def check_number(number: int, mapping: ColumnMapping) -> None:
    """Refuses a mapping whose entries for single files differ in number from the log's files."""
    layouts, clocks = len(mapping.layouts), len(mapping.clocks)
    for what, stated in (("[[file]]", layouts if layouts > 1 else number), ("time", clocks or number)):
        if stated != number:
            raise LogError(
                f"the mapping describes {stated} files ({what}), but this log has {number}; files that belong together "
                "are given as FILE+FILE."
            )


def _tables(file: Path, layout: Layout, clock: Columns | None, limit: int) -> list[Table]:
    """Tables of one of the files."""
    if is_bag(file):
        raise LogError("a bag counts its times from its first message; it cannot be put together with other files.")
    if file.suffix.lower() in SEVERAL_CLOCKS:
        return read_clocks(file, limit=limit)
    pieces = list(read_tables(file, limit=limit, layout=layout))
    if not pieces:
        raise LogError("it has no rows.")
    (table,) = counted(pieces[:1], clock)
    return [_timed(table, clock)]


def _timed(table: Table, clock: Columns | None) -> Table:
    """The table with its times in the column `time` in s."""
    named = [name for name in USUAL if name in table.cells] if clock is None else list(clock.read)
    if len(named) != 1 or named[0] not in table.cells:
        needed = f"times in a column '{named[0]}'" if clock else f"one column of times, {' or '.join(USUAL)}"
        raise LogError(
            f"it needs {needed}, or the mapping the columns of times of all files, time = [...], and in it "
            f"{{ rate = HZ }} for one without; {table.available()}."
        )
    computed = {each.name: each for each in clock.sums} if clock else {}
    seconds = replace(table, sums=computed).column(clock.names[0] if clock else named[0])
    seconds = seconds * (clock.factor if clock else 1.0)
    if np.isnan(seconds).any():
        raise LogError(f"column '{named[0]}' is empty, but a log needs times.")
    others = {name: x for name, x in table.cells.items() if name != named[0] and not name.startswith(TRUE)}
    units = {name: unit for name, unit in table.units.items() if name in others}
    return replace(table, cells={TIME: seconds, **others}, units=units)


def _apart(files: Sequence[Sequence[Table]]) -> list[list[Table]]:
    """The tables, with the file's number in the names of columns that several files have."""
    count = Counter(name for tables in files for name in {name for table in tables for name in table.cells})

    def own(number: int, name: str) -> str:
        return f"{number}:{name}" if count[name] > 1 and name != TIME else name

    return [
        [
            replace(
                table,
                cells={own(k, name): x for name, x in table.cells.items()},
                units={own(k, name): unit for name, unit in table.units.items()},
            )
            for table in tables
        ]
        for k, tables in enumerate(files, start=1)
    ]


def _from_one_zero(files: Sequence[Path], tables: Sequence[Sequence[Table]]) -> list[Table]:
    """The tables, with times counted from the earliest of all files if they are beyond `EPOCH`."""
    starts = [min(float(np.ravel(table.column(TIME))[0]) for table in several) for several in tables]
    late = [abs(start) > EPOCH for start in starts]
    if any(late) and not all(late):
        begin = ", ".join(f"those of {file.name} at {start:.10g} s" for file, start in zip(files, starts, strict=True))
        raise LogError(f"the files need times of one clock, but they begin on different days: {begin}.")
    zero = min(starts) if all(late) else 0.0
    every = [table for several in tables for table in several]
    return [replace(table, cells={**table.cells, TIME: table.column(TIME) - zero}) for table in every]
