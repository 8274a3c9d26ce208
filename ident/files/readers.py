"""Files of recordings, written and read as tables according to their suffix."""

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.atomic import replacing
from ident.files.csv_file import Layout, csv_pieces, write_csv
from ident.files.formats import bag, c3d, json_lines, lerobot, mat, opensim, parquet, trc
from ident.files.limits import LIMIT
from ident.files.npz_file import npz_pieces, write_npz
from ident.files.table import Table, in_pieces

TEXT = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
"""Suffixes of tables of text."""

ONE_CLOCK: Mapping[str, Callable[[Path, int], list[Table]]] = {
    ".mot": opensim.tables,
    ".sto": opensim.tables,
    ".trc": trc.tables,
    ".parquet": parquet.tables,
    ".mat": mat.tables,
    **dict.fromkeys(json_lines.SUFFIX, json_lines.tables),
}
"""Readers of files that are one table, by suffix, given the path and the bytes it may take in memory."""

SEVERAL_CLOCKS: Mapping[str, Callable[[Path, int], list[Table]]] = {
    ".c3d": c3d.tables,
    ".bag": bag.tables,
    ".mcap": bag.tables,
    ".db3": bag.tables,
}
"""Readers of files of tables that each have times of their own, by suffix; the folder of a ROS 2 bag is one too."""

BAG_FOLDER = "metadata.yaml"
"""File that marks a folder as a ROS 2 bag."""


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
    known = path.name.lower().endswith((".npz", *TEXT, *ONE_CLOCK, *SEVERAL_CLOCKS))
    return known or is_bag(path) or lerobot.is_dataset(path)


def is_bag(path: Path) -> bool:
    """True if a file is a ROS bag, or the folder of one."""
    return SEVERAL_CLOCKS.get(path.suffix.lower()) is bag.tables or (path / BAG_FOLDER).is_file()


def files_in(path: Path) -> tuple[Path, ...]:
    """Files that a log consists of: itself, those of a bag's folder, or those of an episode of a dataset.

    Raises:
        LogError: A dataset is damaged.
    """
    if lerobot.is_dataset(path):
        return lerobot.parts(path)
    return tuple(sorted(each for each in path.iterdir() if each.is_file())) if path.is_dir() else (path,)


def has_several_clocks(path: Path) -> bool:
    """True if a file holds tables that each have times of their own."""
    return path.suffix.lower() in SEVERAL_CLOCKS or is_bag(path)


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
    return SEVERAL_CLOCKS.get(path.suffix.lower(), bag.tables)(path, limit)


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
    kind = _kind(path)
    if kind in TEXT:
        return csv_pieces(path, samples, overlap=overlap, layout=layout, limit=limit)
    if layout not in (None, Layout()):
        raise LogError("the mapping's [file] tells how text is laid out, but this file is none.")
    if kind == ".npz":
        return npz_pieces(path, samples, overlap=overlap, truth=truth, limit=limit)
    (table,) = (lerobot.tables if kind == lerobot.INFO else ONE_CLOCK[kind])(path, limit)
    return in_pieces(table, samples, overlap)


def _kind(path: Path) -> str:
    """Suffix of a file that is one table, or `lerobot.INFO` for an episode of a dataset.

    Raises:
        LogError: It is none of them.
    """
    if lerobot.is_dataset(path):
        return lerobot.INFO
    suffixes = (suffix for suffix in (*TEXT, ".npz", *ONE_CLOCK) if path.name.lower().endswith(suffix))
    if path.is_file() and (suffix := next(suffixes, "")):
        return suffix
    raise _refusal(path)


def _refusal(path: Path) -> LogError:
    """Error for a path that is no log."""
    if not path.exists():
        return LogError("there is no such file; check its path and its name.")
    if path.is_dir():
        return LogError(f"the folder needs {BAG_FOLDER} of a ROS 2 bag or {lerobot.INFO} of a LeRobot dataset.")
    one_clock = [suffix for suffix in ONE_CLOCK if suffix not in json_lines.SUFFIX[1:]]
    ends = ", ".join((*TEXT[:3], ".npz", *one_clock, *SEVERAL_CLOCKS))
    return LogError(f"logs end in {ends}, or are ROS 2 or LeRobot folders.")
