"""Files of recordings and of markers, written and read as tables according to their suffix."""

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files import bag, c3d, lerobot
from ident.files.arrays import JSON_LINES, json_tables, mat_tables, parquet_tables
from ident.files.atomic import replacing
from ident.files.column import UNITS
from ident.files.csv_file import Layout, csv_pieces, storage_tables, write_csv
from ident.files.limits import LIMIT
from ident.files.markers import Markers, trc_markers
from ident.files.npz import npz_pieces, write_npz
from ident.files.table import SUFFIXES, Table, in_pieces, short

TEXT = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
"""Ends of the names of tables of text."""

BAG_FOLDER = "metadata.yaml"
"""File that marks a folder as a ROS 2 bag."""

Read = Callable[[Path, int], list[Table]]
"""Reader of a format, given the path and the bytes that it may take in memory."""

ONE_CLOCK: Mapping[str, Read] = {
    **dict.fromkeys((".mot", ".sto"), storage_tables),
    ".trc": lambda path, limit: [trc_markers(path, limit).table],
    ".parquet": parquet_tables,
    ".mat": mat_tables,
    **dict.fromkeys(JSON_LINES, json_tables),
    lerobot.INFO: lerobot.tables,
}
"""Readers of what is one table, by the end of its name or, for a dataset's episode, the file that marks the folder."""

SEVERAL_CLOCKS: Mapping[str, Read] = {
    ".c3d": c3d.tables,
    **dict.fromkeys((".bag", ".mcap", ".db3", BAG_FOLDER), bag.tables),
}
"""Readers of what has tables that each have times of their own, likewise."""

CAPTURED: Mapping[str, Callable[[Path, int], Markers]] = {".trc": trc_markers, ".c3d": c3d.markers}
"""Readers of files that state their unit, by suffix, given the path and the bytes it may take in memory."""

TABLES = (".csv", ".tsv", ".txt", ".npz")
"""Suffixes of tables with markers."""


def write_channels(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Writes a `.npz` or `.csv` file; arguments as for `write_csv`.

    Raises:
        LogError: The name has another suffix.
    """
    writers = {".npz": write_npz, ".csv": write_csv}
    if path.suffix not in writers:
        raise LogError(f"A recording is saved as .npz or .csv, got '{path.name}'.")
    with replacing(path) as temporary:
        writers[path.suffix](temporary, channels, metadata)


def is_log(path: Path) -> bool:
    """True if a file can be read by its suffix, or is a bag's folder or an episode of a dataset."""
    return bool(_format(path))


def is_bag(path: Path) -> bool:
    """True if a file is a ROS bag, or the folder of one."""
    return SEVERAL_CLOCKS.get(_format(path)) is bag.tables


def has_several_clocks(path: Path) -> bool:
    """True if a file holds tables that each have times of their own."""
    return _format(path) in SEVERAL_CLOCKS


def _format(path: Path) -> str:
    """Format of a log: the end of its name, or the file that marks it as a bag's folder or a dataset; "" for none."""
    if lerobot.is_dataset(path):
        return lerobot.INFO
    if (path / BAG_FOLDER).is_file():
        return BAG_FOLDER
    known = (*TEXT, ".npz", *ONE_CLOCK, *SEVERAL_CLOCKS)
    return next((end for end in known if end[0] == "." and path.name.lower().endswith(end)), "")


def files_in(path: Path) -> tuple[Path, ...]:
    """Files that a log consists of: itself, those of a bag's folder, or those of an episode of a dataset.

    Raises:
        LogError: A dataset is damaged.
    """
    if lerobot.is_dataset(path):
        return lerobot.parts(path)
    return tuple(sorted(each for each in path.iterdir() if each.is_file())) if path.is_dir() else (path,)


def read_clocks(path: Path, *, limit: int = LIMIT) -> list[Table]:
    """Reads a file of tables that each have times of their own, in their column `time` in s.

    Args:
        path: A `.c3d`, `.bag`, `.mcap` or `.db3` file, or the folder of a ROS 2 bag.
        limit: Bytes that it may take in memory, as for `limits.check_size`.

    Raises:
        LogError: The file is missing or damaged.
        InputError: The library that reads it is not installed.
    """
    if not (path.is_file() or (path / BAG_FOLDER).is_file()):
        raise _refusal(path)
    return SEVERAL_CLOCKS[_format(path)](path, limit)


def read_tables(
    path: Path,
    samples: int = sys.maxsize,
    *,
    overlap: int = 0,
    truth: bool = False,
    limit: int = LIMIT,
    layout: Layout | None = None,
) -> Iterator[Table]:
    """Reads a file that is one table piece by piece, so that text or an archive may be larger than memory.

    Args:
        path: A text file or a `.npz`, `.mot`, `.sto`, `.trc`, `.parquet`, `.mat` or `.jsonl` file, or the folder of a
            LeRobot dataset, `DATASET#3` for its episode 3.
        samples: Samples of each piece; the last one may have fewer.
        overlap: Samples that each piece repeats from the one before, in addition.
        truth: True to read an archive's true values as well.
        limit: Bytes that a piece of an archive, or a file that is read whole, may take in memory, as for
            `limits.check_size`.
        layout: Layout of text, if it is not the default.

    Raises:
        LogError: The file is missing or malformed; an error in a later piece is raised when that piece is read.
        InputError: The library that reads it is not installed.
    """
    kind = _format(path)
    if kind not in (*TEXT, ".npz", *ONE_CLOCK) or not (path.is_file() or kind == lerobot.INFO):
        raise _refusal(path)
    if kind in TEXT:
        return csv_pieces(path, samples, overlap=overlap, layout=layout, limit=limit)
    if layout not in (None, Layout()):
        raise LogError("the mapping's [file] tells how text is laid out, but this file is none.")
    if kind == ".npz":
        return npz_pieces(path, samples, overlap=overlap, truth=truth, limit=limit)
    (table,) = ONE_CLOCK[kind](path, limit)
    return in_pieces(table, samples, overlap)


def _refusal(path: Path) -> LogError:
    """Error for a path that is no log."""
    if not path.exists():
        return LogError("there is no such file; check its path and its name.")
    if path.is_dir():
        return LogError(f"the folder needs {BAG_FOLDER} of a ROS 2 bag or {lerobot.INFO} of a LeRobot dataset.")
    others = [end for end in (*ONE_CLOCK, *SEVERAL_CLOCKS) if end[0] == "." and end not in JSON_LINES[1:]]
    return LogError(f"logs end in {', '.join((*TEXT[:3], '.npz', *others))}, or are ROS 2 or LeRobot folders.")


def read_markers(path: str | Path, unit: str | None = None, *, limit: int = LIMIT) -> Markers:
    """Reads the markers of a file.

    Args:
        path: A `.trc` or `.c3d` file, or a table (`.csv`, `.tsv`, `.txt`, `.npz`) with a column `time` in s and the
            columns LABEL.x, LABEL.y and LABEL.z of every marker; cells are empty or NaN where it is missing.
        unit: Unit of the lengths in a table, `m` if not given; refused where a file states its own.
        limit: Bytes that the file may take in memory, as for `limits.check_size`.

    Raises:
        LogError: The file is missing or malformed; the message names it and the row, column, frame or marker.
        InputError: The library that reads it is not installed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (*CAPTURED, *TABLES) or not path.is_file():
        raise LogError(f"{path}: markers are in a file that exists and ends in {', '.join((*CAPTURED, *TABLES))}.")
    try:
        if suffix in TABLES:
            return _of_table(path, UNITS["length"][unit or "m"], limit)
        if unit is not None:
            raise LogError(f"the file states its unit; leave out that lengths are in {unit}.")
        return CAPTURED[suffix](path, limit)
    except (LogError, OSError) as error:
        raise LogError(f"{path}: {error}") from None


def _of_table(path: Path, factor: float, limit: int) -> Markers:
    """Markers of a table; `factor` converts its unit to metres."""
    tables = list(read_tables(path, limit=limit))
    if not tables:
        raise LogError("a file of markers needs frames, it has none.")
    (table,) = tables
    if "time" not in table.cells:
        raise LogError(f"markers need a column 'time'; {table.available()}.")
    ends = tuple(f".{axis}" for axis in SUFFIXES[3])
    labels = tuple(dict.fromkeys(name[:-2] for name in table.cells if name.endswith(ends) and name[:-2]))
    if not labels:
        raise LogError(f"markers need columns LABEL.x, LABEL.y and LABEL.z; {table.available()}.")
    positions = np.stack([_marker(table, label) for label in labels], axis=1)
    return Markers(table.column("time"), labels, factor * positions)


def _marker(table: Table, label: str) -> np.ndarray:
    """Positions of a marker, NaN where cells are empty (N, 3)."""
    names = [f"{label}.{axis}" for axis in SUFFIXES[3]]
    if missing := [name for name in names if name not in table.cells]:
        raise LogError(f"marker '{short(label)}' lacks the column '{short(missing[0])}'.")
    return np.stack([table.column(name, gaps=True) for name in names], axis=1)
