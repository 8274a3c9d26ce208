"""Reading of a user's log: columns found by name or by a mapping file, units converted, times repaired."""

import sys
from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.annotations import typed
from ident.arguments import checked_path, described
from ident.errors import InputError, LogError
from ident.files.column import BALL, COMMAND, KINDS
from ident.files.limits import LIMIT
from ident.files.readers import has_several_clocks, read_clocks, read_tables
from ident.files.table import BASE, TRUE, TYPES, InMemory, Table, in_pieces, kind_of, table_of
from ident.mechanism.mechanism import Mechanism
from ident.recordings.channels import NoPositionError, misspelt, read_channels, with_names
from ident.recordings.entries import counted, selected
from ident.recordings.faults import check_angles, check_rates, unit_of_force, with_servos
from ident.recordings.followers import follower_notes, moved
from ident.recordings.mapping import STATED, ColumnMapping, joint_kinds, read_mapping, stated_mapping
from ident.recordings.recording import Recording, poses
from ident.recordings.several_clocks import check_number, files_of, mapping_of, read_files, read_streams
from ident.recordings.standing import placed
from ident.recordings.stated import annotations
from ident.recordings.times import LEAST_SAMPLES, Clock, Repaired, Sampled, check_samples
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
    (recording,) = _pieces(Path(path), mechanism, columns, sys.maxsize, gaps=gaps, limit=limit)
    return recording


@typed("path", "columns")
def read_log_pieces(
    path: str | Path, mechanism: Mechanism, columns: MappingSource = None, samples: int = 10_000, *, limit: int = LIMIT
) -> Iterator[Recording]:
    """Reads a log piece by piece, for logs larger than memory.

    Units are checked on the first piece, and its time step is used for all. A piece whose times jitter is resampled by
    itself. Text and npz archives take no more memory than a piece, unless rows or times are selected.

    Args:
        path: The log; `mechanism`, `columns` and `limit` as for `read_log`.
        samples: Samples of each piece, at least `LEAST_SAMPLES`.
    """
    yield from _pieces(checked_path("path", path), mechanism, columns, samples, gaps=False, limit=limit)


def _in_memory(source: Any, mechanism: Mechanism, columns: MappingSource, *, gaps: bool) -> Recording:
    """Recording of columns in memory, arguments as for `read_log`."""
    try:
        if (table := table_of(source)) is None:
            several = " Read each by itself, or give `identify` the list." if isinstance(source, list | tuple) else ""
            raise InputError(f"A log needs the path of a file, or {TYPES}; got {described(source)}.{several}")
        mapping = _mapping(columns, mechanism)
        tables = _selected([table], mapping, mechanism, sys.maxsize)
        (recording,) = _recordings(([each] for each in tables), mechanism, mapping, gaps=gaps, clocks=False)
    except LogError as error:
        raise LogError(f"The {kind_of(source)}: {error}") from None
    return recording


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


def _pieces(
    path: Path, mechanism: Mechanism, columns: MappingSource, samples: int, *, gaps: bool, limit: int
) -> Iterator[Recording]:
    """Pieces of a log, arguments as for `read_log_pieces` and `read_log`."""
    mapping = _mapping(columns, mechanism)
    try:
        files = files_of(path)
        if len(files) > 1 or has_several_clocks(path):
            if mapping.still:
                raise LogError("poses = true is for one table with a row for each pose.")
            if samples < sys.maxsize:
                raise LogError("a log with several clocks is not read in pieces; `identify` takes it whole.")
            together = len(files) > 1
            tables = read_files(files, mapping, limit) if together else read_clocks(path, limit=limit)
            mapping = mapping.without_files if together else mapping
            yield from _recordings([tables], mechanism, mapping, gaps=gaps if together else None, clocks=True)
            return
        check_number(1, mapping)
        samples = max(samples, LEAST_SAMPLES)
        at_once = sys.maxsize if mapping.selection else samples
        pieces = read_tables(path, at_once, overlap=1, limit=limit, layout=mapping.layouts[0])
        tables_of_file = _selected(pieces, mapping, mechanism, samples)
        yield from _recordings(([table] for table in tables_of_file), mechanism, mapping, gaps=gaps, clocks=False)
    except (LogError, OSError) as error:
        markers = [file.name for file in files_of(path) if file.suffix.lower() == ".trc"]
        hint = MARKERS.format(markers[0]) if markers and isinstance(error, NoPositionError) else ""
        raise LogError(f"{path}: {error}{hint}") from None


def _recordings(
    pieces: Iterable[Sequence[Table]], mechanism: Mechanism, mapping: ColumnMapping, *, gaps: bool | None, clocks: bool
) -> Iterator[Recording]:
    """Recordings of the pieces of a log.

    Args:
        pieces: Tables of each piece: one, or with `clocks` several that each have times of their own.
        mechanism: The mechanism.
        mapping: The mapping, to be completed by the columns' names.
        gaps: True if samples may be missing; None if the file's format allows it.
        clocks: True if tables have times of their own.
    """
    kinds, clock = joint_kinds(mechanism.tree), None
    for tables in pieces:
        first, notes = clock is None, list[str]()
        if clock is None:
            if clocks:
                mapping = mapping_of(tables, mapping, kinds)
            else:
                check_samples(len(tables[0].rows))
                mapping = with_names(mapping, tables[0], kinds)
            mechanism, notes = moved(mapping, mechanism), follower_notes(mapping.followers)
            kinds, clock = joint_kinds(mechanism.tree), Clock(mapping.columns["time"], bool(gaps))
        told = notes if first else []
        if clocks:
            repaired = read_streams(tables, mapping, notes, gaps=gaps)
        else:
            told += tables[0].notes
            # Followers' torques add to their leaders', as sums that show when all columns are known.
            table = replace(tables[0], sums=mapping.sums)
            repaired = clock.repaired(table, read_channels(table, mapping, told, gaps=bool(gaps)), notes)
        if not len(repaired.time):
            continue
        recording = _without_incomplete(_recording(repaired, mapping), mechanism.tree.joints, told)
        recording = with_servos(recording, mapping.servos, mechanism, told)
        recording = placed(recording, mechanism, mapping.plates, told)
        unused = [name for table in tables for name in table.cells if name not in mapping.used]
        if first:
            notes += misspelt(unused, _missing(mapping, kinds)) + _unread(unused, mapping, mechanism)
            hinges = [joint for joint, kind in kinds.items() if kind == "hinge"]
            check_angles(recording, mapping, hinges)
            check_rates(recording, hinges)
            notes += unit_of_force(recording, mapping, mechanism)
        origins = ChainMap(*(annotations(table.metadata).get("provenance", {}) for table in reversed(tables)))
        yield replace(recording, notes=notes, unused=unused, provenance=dict(origins))
    if clock is None:
        check_samples(0)


def _selected(pieces: Iterable[Table], mapping: ColumnMapping, mechanism: Mechanism, samples: int) -> Iterator[Table]:
    """Pieces of the selected samples of one table, which with a selection comes whole."""
    for table in counted(pieces, mapping.columns.get("time"), overlap=1):
        cells = {name: x for name, x in table.cells.items() if not name.startswith(TRUE)}
        table = replace(table, cells=cells, sums=mapping.sums)
        if mapping.selection:
            clock = with_names(mapping, table, joint_kinds(mechanism.tree)).columns["time"]
            yield from in_pieces(selected(table, mapping.selection, clock), samples, 1)
        else:
            yield table


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


def _recording(repaired: Repaired, mapping: ColumnMapping) -> Recording:
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
