"""Tables with times of their own: of bags and C3D files, or of several files, `angles.mot+forces.mot`."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os.path import realpath
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.csv_file import Layout
from ident.files.readers import TEXT, has_several_clocks, is_bag, is_log, read_clocks, read_tables
from ident.files.table import TRUE, Table, listed, short
from ident.recordings.channels import read_channels, with_names
from ident.recordings.entries import EPOCH, counted, selected
from ident.recordings.mapping import ColumnMapping, check_text_alone
from ident.recordings.times import TIME, Repaired, Sampled, streams_of, together

USUAL = ("time", "t")
"""Names of columns of times."""


def mapping_of(tables: Sequence[Table], mapping: ColumnMapping, joints: Mapping[str, str]) -> ColumnMapping:
    """The mapping completed by the names of columns of several tables; arguments as for `with_names`.

    Raises:
        LogError: As `with_names`; or the mapping has times, which the file states, or entries for text files only.
    """
    check_text_alone(mapping)
    if TIME in mapping.columns:
        raise LogError("this file knows the times of its columns; leave time out of the mapping, and a rate too.")
    cells: dict[str, Sequence[str] | np.ndarray] = {}
    units: dict[str, str] = {}
    for table in tables:
        if twice := (cells.keys() & table.cells.keys()) - {TIME}:
            raise LogError(f"column '{short(min(twice))}' is at two rates; their labels need to differ.")
        cells, units = cells | dict(table.cells), units | dict(table.units)
    whole = Table(cells, (), "sample", sums=mapping.sums, units=units)
    return with_names(mapping, whole, joints)


def read_streams(
    tables: Sequence[Table], mapping: ColumnMapping, notes: list[str], *, gaps: bool | None = None
) -> Repaired:
    """Channels of several tables, as measured and at common times.

    Args:
        tables: Tables, each with a column of its times.
        mapping: Their complete mapping.
        notes: Sentences on what was detected; more are appended.
        gaps: True if samples may be missing; None if the file's format allows it.

    Raises:
        LogError: A column has no numbers or goes back in time, columns of one quantity have different times, no time is
            covered by all, or samples are missing that may not be.
    """
    clock = mapping.columns[TIME]
    streams: dict[str, Sampled] = {}
    for table in tables:
        part = _part(mapping, table)
        if part.columns.keys() == {TIME}:
            continue
        table = selected(replace(table, sums=mapping.sums), mapping.selection, clock)
        notes += table.notes
        channels = read_channels(table, part, notes, gaps=gaps is not False)
        streams |= streams_of(table, clock, channels, notes, gaps=gaps)
    if not streams:
        columns = dict.fromkeys(name for table in tables for name in table.cells if name != TIME)
        raise LogError(
            "a log needs columns of joints or wrenches, and none is named or mapped as one; the file has "
            f"{listed(columns)}."
        )
    return together(streams)


def _part(mapping: ColumnMapping, table: Table) -> ColumnMapping:
    """The part of a mapping that concerns one table.

    Raises:
        LogError: A quantity has columns of this table and of another one.
    """
    columns: dict[str, Columns] = {}
    for key, used in mapping.columns.items():
        if not (here := [name for name in used.read if name in table.cells]):
            continue
        if len(here) < len(used.read):
            other = next(name for name in used.read if name not in table.cells)
            raise LogError(f"{key} needs columns of the same times, '{here[0]}' and '{other}' have times of their own.")
        columns[key] = used
    if columns.keys() > {TIME}:
        # Constants are of no table, and have the times of any.
        columns |= {key: used for key, used in mapping.columns.items() if used.names and not used.read}
    plates = {name: plate for name, plate in mapping.plates.items() if f"wrenches.{name}.force" in columns}
    for name in plates:
        for key in (key for key in mapping.columns if key.startswith(f"wrenches.{name}.")):
            if key not in columns and mapping.columns[key].read:
                raise LogError(
                    f"[wrenches.{name}] needs columns of the same times, its {key.rpartition('.')[2]} has its own."
                )
            columns.setdefault(key, mapping.columns[key])
    return replace(mapping, columns=columns, plates=plates)


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
    if twice := [file.name for file in files if [*map(realpath, files)].count(realpath(file)) > 1]:
        raise LogError(f"a log is made of different files, but {twice[0]} is given twice.")
    check_number(len(files), mapping)
    layouts = list(mapping.layouts)
    if len(layouts) == 1:
        # A layout for all text files does not apply to other files.
        layouts = [layouts[0] if file.name.lower().endswith(TEXT) else Layout() for file in files]
    clocks = mapping.clocks or (mapping.columns.get(TIME),) * len(files)
    tables: list[list[Table]] = []
    for file, layout, clock in zip(files, layouts, clocks, strict=True):
        try:
            own = _tables(file, layout, clock, limit)
        except (LogError, OSError) as error:
            raise LogError(f"{file.name}: {error}") from None
        tables.append([replace(table, word=f"{file.name} {table.word}") for table in own])
    return _from_one_zero(files, _apart(tables))


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
    if has_several_clocks(file):
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

    def own(number: int, columns: Mapping[str, Any]) -> dict[str, Any]:
        return {f"{number}:{name}" if count[name] > 1 and name != TIME else name: x for name, x in columns.items()}

    return [
        [replace(table, cells=own(k, table.cells), units=own(k, table.units)) for table in tables]
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
