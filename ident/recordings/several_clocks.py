"""Tables that each have times of their own, as from bags and C3D files: streams, and channels at common times."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.selection import selected
from ident.files.table import Table, listed, short
from ident.recordings.channels import read_channels, with_names
from ident.recordings.columns.mapping import ColumnMapping, check_text_alone
from ident.recordings.sampled import Sampled, interpolated, rate_of, uniform_times
from ident.recordings.times import LEAST_SAMPLES, Clock, Repaired, check_jumps, increasing
from ident.recordings.tracker import untracked

TIME = "time"
"""Column of every table's own times, s."""


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
    joints = [key for key in streams if key.endswith(".position") and key.startswith("joints.")]
    rate = max(map(rate_of, (streams[key] for key in joints or streams)))
    for key, stream in streams.items():
        check_jumps(f"the time of {key}", stream.time, 1 / rate)
    common = uniform_times(untracked(streams), rate)
    if len(common) < LEAST_SAMPLES:
        raise LogError(f"a log needs at least {LEAST_SAMPLES} samples that all columns cover, it has {len(common)}.")
    return Repaired(common, {key: interpolated(stream, common) for key, stream in streams.items()}, streams)


def streams_of(
    table: Table, clock: Columns, channels: dict[str, np.ndarray], notes: list[str], *, gaps: bool | None
) -> dict[str, Sampled]:
    """Channels (N, k) at the times of a table, without repeated samples; arguments as for `read_streams`."""
    if gaps is not None:
        # Time steps are checked as in a log with one clock.
        repaired = Clock(clock, gaps).repaired(table, channels, notes)
        return {key: repaired.streams.get(key, Sampled(repaired.time, x)) for key, x in repaired.channels.items()}
    time = table.column(TIME)
    kept = increasing(table, TIME, time, channels, notes)
    if len(kept) < LEAST_SAMPLES:
        raise LogError(f"a log needs at least {LEAST_SAMPLES} samples, {', '.join(channels)} have {len(kept)}.")
    return {key: Sampled(time[kept], x[kept]) for key, x in channels.items()}


def _part(mapping: ColumnMapping, table: Table) -> ColumnMapping:
    """The part of a mapping that concerns one table.

    Raises:
        LogError: A quantity has columns of this table and of another one.
    """
    columns: dict[str, Columns] = {}
    for key, used in mapping.columns.items():
        here = [name for name in used.read if name in table.cells]
        if not here:
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
