"""Reading of a user's log: columns found by name or by a mapping file, units converted, times repaired."""

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.annotations import typed
from ident.arguments import checked_path, described
from ident.errors import InputError, LogError
from ident.files.csv_file import Layout
from ident.files.limits import LIMIT
from ident.files.readers import (
    TEXT,
    TYPES,
    InMemory,
    files_of,
    has_several_clocks,
    kind_of,
    read_clocks,
    read_files,
    read_tables,
    table_of,
)
from ident.files.table import BALL, BASE, COMMAND, KINDS, TIME, TRUE, Columns, Table, listed, short
from ident.mechanism.mechanism import Mechanism
from ident.recordings.channels import (
    NoPositionError,
    check_angles,
    check_rates,
    misspelt,
    read_channels,
    unit_of_force,
    with_names,
)
from ident.recordings.followers import follower_notes, moved, with_servos
from ident.recordings.mapping import STATED, ColumnMapping, joint_kinds, read_mapping, stated_mapping
from ident.recordings.recording import Recording, poses
from ident.recordings.standing import placed
from ident.recordings.stated import annotations
from ident.recordings.times import Clock, Repaired, Sampled, check_samples, streams_of, together
from ident.recordings.wrench import GROUND

MARKERS = " Positions of markers become angles by `multicontact angles MODEL {}`."
"""Advice for a file of markers where joint angles are needed."""

MappingSource = str | Path | Mapping[str, Any] | None
"""Path of a columns file, or its content; None to find columns by their names alone."""


@typed("path", "columns")
def read_log(
    path: str | Path | InMemory,
    mechanism: Mechanism,
    columns: MappingSource = None,
    *,
    gaps: bool = False,
    limit: int = LIMIT,
) -> Recording:
    """Reads a log of joint states and wrenches.

    If times jitter, samples are missing or channels have times of their own, the recording also has the streams as they
    were measured, for the trajectory estimate.

    Args:
        path: A table of text (.csv, .tsv, .txt, perhaps packed as .gz), a .npz or .mat file of arrays by name, an
            OpenSim .mot or .sto file, a .parquet, .jsonl or .c3d file, a ROS bag (.bag, .mcap, .db3, or a ROS 2 bag's
            folder), a LeRobot dataset's folder, with its episode if there are several, `DATASET#3`, or what
            `Recording.save` wrote. `FILE+FILE` is one log in several files, each with times of its own on one clock, as
            angles in one and forces in another. Or columns in memory: a mapping of arrays (N,) or (N, d), a pandas data
            frame, or an xarray dataset.
        mechanism: The mechanism that was recorded. Its weight, if it has a prior, shows if a force is in kilonewtons.
        columns: A TOML file that maps columns to joints, wrenches and the base where names or units differ, or its
            content as a mapping. Columns that it does not mention are found by name.
        gaps: True if samples may be missing, as empty cells or as rows. The trajectory estimate does without them; a
            filter would have to invent them.
        limit: Bytes that an archive, or an unpacked file, may take in memory.

    Returns:
        The recording, uniformly sampled and in SI units; velocities and accelerations only if all joints have them.

    Raises:
        LogError: A file is missing or malformed, or does not fit the mechanism; the message names file, row and
            column.
        InputError: The library that reads such files is not installed.
    """
    if not isinstance(path, str | Path):
        return _in_memory(path, mechanism, columns, gaps=gaps)
    path, mapping = Path(path), _mapping(columns, mechanism)
    files = files_of(path)
    try:
        if len(files) == 1 and not has_several_clocks(path):
            _check_number(1, mapping)
            tables = list(read_tables(path, limit=limit, layout=mapping.layouts[0]))
            return _of_table(tables[0] if tables else Table({}, (), "row"), mechanism, mapping, gaps=gaps)
        if mapping.still:
            raise LogError("poses = true is for one table with a row for each pose.")
        if len(files) == 1:
            return _of_tables(read_clocks(path, limit=limit), mechanism, mapping, gaps=None)
        tables = read_files(files, *_layouts_and_clocks(files, mapping), limit=limit)
        columns_left = {key: used for key, used in mapping.columns.items() if key != TIME}
        mapping = replace(mapping, columns=columns_left, clocks=(), layouts=(Layout(),))
        return _of_tables(tables, mechanism, mapping, gaps=gaps)
    except (LogError, OSError) as error:
        markers = [file.name for file in files if file.suffix.lower() == ".trc"]
        hint = MARKERS.format(markers[0]) if markers and isinstance(error, NoPositionError) else ""
        raise LogError(f"{path}: {error}{hint}") from None


def _in_memory(source: Any, mechanism: Mechanism, columns: MappingSource, *, gaps: bool) -> Recording:
    """Recording of columns in memory, arguments as for `read_log`."""
    try:
        if (table := table_of(source)) is None:
            several = " Read each by itself, or give `identify` the list." if isinstance(source, list | tuple) else ""
            raise InputError(f"A log needs the path of a file, or {TYPES}; got {described(source)}.{several}")
        return _of_table(table, mechanism, _mapping(columns, mechanism), gaps=gaps)
    except LogError as error:
        raise LogError(f"The {kind_of(source)}: {error}") from None


def _mapping(columns: MappingSource, mechanism: Mechanism) -> ColumnMapping:
    """Mapping of columns from a file or its content."""
    if columns is None:
        mapping = ColumnMapping()
    elif isinstance(columns, Mapping):
        mapping = stated_mapping(columns, mechanism.tree)
    else:
        file = checked_path("columns", columns, "the path of a TOML file, or its content as a mapping")
        mapping = read_mapping(file, mechanism.tree)
    return replace(mapping, followers=mechanism.mimics, mechanism=mechanism)


def _layouts_and_clocks(
    files: Sequence[Path], mapping: ColumnMapping
) -> tuple[Sequence[Layout], Sequence[Columns | None]]:
    """Layout and column of times of each of several files; a layout for all text files does not apply to others."""
    _check_number(len(files), mapping)
    layouts, clocks = mapping.layouts, mapping.clocks or (mapping.columns.get(TIME),) * len(files)
    if len(layouts) == 1:
        layouts = tuple(layouts[0] if file.name.lower().endswith(TEXT) else Layout() for file in files)
    return layouts, clocks


def _check_number(number: int, mapping: ColumnMapping) -> None:
    """Refuses a mapping whose entries for single files differ in number from the log's files."""
    layouts, clocks = len(mapping.layouts), len(mapping.clocks)
    for what, stated in (("[[file]]", layouts if layouts > 1 else number), ("time", clocks or number)):
        if stated != number:
            raise LogError(
                f"the mapping describes {stated} files ({what}), but this log has {number}; files that belong together "
                "are given as FILE+FILE."
            )


def _of_table(table: Table, mechanism: Mechanism, mapping: ColumnMapping, *, gaps: bool) -> Recording:
    """Recording of one table."""
    cells = {name: x for name, x in table.cells.items() if not name.startswith(TRUE)}
    table = replace(table, cells=cells, sums=mapping.sums).counted(mapping.columns.get(TIME))
    if mapping.selection:
        clock = with_names(mapping, table, joint_kinds(mechanism.tree)).columns[TIME]
        table = mapping.selection.of(table, clock)
    check_samples(len(table.rows))
    mapping = with_names(mapping, table, joint_kinds(mechanism.tree))
    mechanism, notes = moved(mapping, mechanism), [*follower_notes(mapping.followers), *table.notes]
    # Followers' torques add to their leaders', as sums that show when all columns are known.
    table = replace(table, sums=mapping.sums)
    channels = read_channels(table, mapping, notes, gaps=gaps)
    repaired = Clock(mapping.columns[TIME], gaps).repaired(table, channels, notes)
    return _recorded(repaired, [table], mechanism, mapping, notes)


def _of_tables(
    tables: Sequence[Table], mechanism: Mechanism, mapping: ColumnMapping, *, gaps: bool | None
) -> Recording:
    """Recording of tables that each have times of their own; `gaps` is None where the format allows them.

    Raises:
        LogError: The mapping has times, which the file states, or entries for text files only; tables have columns of
            one name, or no time is covered by all.
    """
    if any(layout != Layout() for layout in mapping.layouts):
        raise LogError("the mapping's [file] tells how text is laid out, but this file is none.")
    if mapping.selection.rows:
        raise LogError("[select] rows are those of one table, but this file has several; select by time.")
    if TIME in mapping.columns:
        raise LogError("this file knows the times of its columns; leave time out of the mapping, and a rate too.")
    cells: dict[str, Sequence[str] | np.ndarray] = {}
    units: dict[str, str] = {}
    for table in tables:
        if twice := (cells.keys() & table.cells.keys()) - {TIME}:
            raise LogError(f"column '{short(min(twice))}' is at two rates; their labels need to differ.")
        cells, units = cells | dict(table.cells), units | dict(table.units)
    whole = Table(cells, (), "sample", sums=mapping.sums, units=units)
    mapping = with_names(mapping, whole, joint_kinds(mechanism.tree))
    mechanism, notes = moved(mapping, mechanism), follower_notes(mapping.followers)
    clock, streams = mapping.columns[TIME], dict[str, Sampled]()
    for table in tables:
        part = _part(mapping, table)
        if part.columns.keys() == {TIME}:
            continue
        own = mapping.selection.of(replace(table, sums=mapping.sums), clock)
        notes += own.notes
        channels = read_channels(own, part, notes, gaps=gaps is not False)
        streams |= streams_of(own, clock, channels, notes, gaps=gaps)
    if not streams:
        raise LogError(
            "a log needs columns of joints or wrenches, and none is named or mapped as one; the file has "
            f"{listed([name for name in cells if name != TIME])}."
        )
    return _recorded(together(streams), tables, mechanism, mapping, notes)


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


def _recorded(
    repaired: Repaired, tables: Sequence[Table], mechanism: Mechanism, mapping: ColumnMapping, notes: list[str]
) -> Recording:
    """Recording of the channels of some tables by their complete mapping, checked against the mechanism."""
    recording = _without_incomplete(_channels(repaired, mapping), mechanism.tree.joints, notes)
    recording = with_servos(recording, mapping.servos, mechanism, notes)
    recording = placed(recording, mechanism, mapping.plates, notes)
    kinds = joint_kinds(mechanism.tree)
    unused = [name for table in tables for name in table.cells if name not in mapping.used]
    notes += misspelt(unused, _missing(mapping, kinds)) + _unread(unused, mapping, mechanism)
    hinges = [joint for joint, kind in kinds.items() if kind == "hinge"]
    check_angles(recording, mapping, hinges)
    check_rates(recording, hinges)
    notes += unit_of_force(recording, mapping, mechanism)
    origins = ChainMap(*(annotations(table.metadata).get("provenance", {}) for table in reversed(tables)))
    return replace(recording, notes=notes, unused=unused, provenance=dict(origins))


def _missing(mapping: ColumnMapping, kinds: Mapping[str, str]) -> list[str]:
    """Names that the columns of those channels would have for which the mapping has none."""
    wanted = {f"wrenches.{GROUND}.{kind}": [f"{GROUND}_{kind}.{c}" for c in "xyz"] for kind in ("force", "torque")}
    for joint, joint_kind in kinds.items():
        for kind, (name, *_) in {**KINDS, "command": (COMMAND,)}.items():
            ends = [f".{c}" for c in BALL.get(kind, "")] if joint_kind == "ball" else [""]
            wanted[f"joints.{joint}.{kind}"] = [name.format(joint) + end for end in ends]
    own = {key: mapping.columns[key].names if key in mapping.columns else () for key in wanted}
    return [name for key, names in wanted.items() for k, name in enumerate(names) if not any(own[key][k : k + 1])]


def _unread(unused: Sequence[str], mapping: ColumnMapping, mechanism: Mechanism) -> list[str]:
    """A sentence on the columns of joints that are fixed."""
    usual = {name.format(joint) for joint in mechanism.tree.still for names in KINDS.values() for name in names}
    unread = [name for name in unused if name in (*usual, *mapping.of_fixed)]
    return [f"Columns of joints that are fixed (--fix) were not read: {', '.join(unread)}."] if unread else []


def _channels(repaired: Repaired, mapping: ColumnMapping) -> Recording:
    """Recording with the channels under its own names, without joint channels that are missing."""
    measured, streams, units = dict[str, np.ndarray](), dict[str, Sampled](), dict[str, str]()
    for key, x in repaired.channels.items():
        room, _, rest = key.partition(".")
        name, _, kind = rest.rpartition(".")
        if room == "base" or (room == "joints" and np.isnan(x).any()):
            continue
        channel = f"{name}_{kind}"
        if channel in measured:
            others = "a wrench or a tracked pose"
            raise LogError(f"a joint and {others} are both named '{name}', and both have a {kind}; rename the latter.")
        measured[channel] = _flat(x)
        if key in repaired.streams:
            streams[channel] = Sampled(repaired.streams[key].time, _flat(repaired.streams[key].values))
        if mapping.columns[key].unit:
            units[channel] = mapping.columns[key].unit
    of_base = {key: stream for key, stream in repaired.streams.items() if key.startswith("base.")}
    own = _base({key: stream.values for key, stream in of_base.items()})
    if own is not None:
        streams[BASE] = Sampled(next(iter(of_base.values())).time, own.reshape(-1, 16))
    return Recording(
        repaired.time,
        measured,
        units=units,
        base=_base(repaired.channels),
        streams=streams,
        sensors=mapping.sensors,
        **{name: getattr(mapping, name) for name in STATED},
    )


def _flat(x: np.ndarray) -> np.ndarray:
    return x[:, 0] if x.shape[1] == 1 else x


def _base(channels: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Poses of a moving base (N, 4, 4)."""
    if "base.pose" in channels:
        return channels["base.pose"].reshape(-1, 4, 4)
    return poses(channels["base.position"], channels["base.quaternion"]) if "base.position" in channels else None


def _without_incomplete(recording: Recording, joints: tuple[str, ...], notes: list[str]) -> Recording:
    """The recording without velocities and accelerations that only some joints have."""
    for kind in ("velocity", "acceleration"):
        missing = [joint for joint in joints if f"{joint}_{kind}" not in recording.measured]
        if 0 < len(missing) < len(joints):
            notes.append(f"No {kind} of {', '.join(missing)} is recorded; those of the other joints are not used.")
            recording = recording.without([f"{joint}_{kind}" for joint in joints])
    return recording
