"""Logs as tables of named columns: files of any format, files that belong together, and what is in memory.

A log is one table, tables that each have times of their own, or several files `angles.mot+forces.mot`.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from os.path import realpath
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from ident.errors import LogError
from ident.files import bag, c3d, parquet
from ident.files.arrays import JSON_LINES, json_tables, mat_tables, npz_table, write_npz
from ident.files.atomic import replacing
from ident.files.csv_file import Layout, csv_pieces, storage_tables, write_csv
from ident.files.limits import LIMIT
from ident.files.markers import Markers, trc_markers
from ident.files.table import EPOCH, SUFFIXES, TIME, TRUE, UNITS, Columns, Table, short, vector_columns

TEXT = (".csv", ".tsv", ".txt", ".csv.gz", ".tsv.gz", ".txt.gz")
"""Ends of the names of tables of text."""

BAG_FOLDER = "metadata.yaml"
"""File that marks a folder as a ROS 2 bag."""

Read = Callable[[Path, int], list[Table]]
"""Reader of a format, given the path and the bytes that it may take in memory."""

ONE_CLOCK: Mapping[str, Read] = {
    **dict.fromkeys((".mot", ".sto"), storage_tables),
    ".trc": lambda path, limit: [trc_markers(path, limit).table],
    ".parquet": parquet.tables,
    ".mat": mat_tables,
    **dict.fromkeys(JSON_LINES, json_tables),
    parquet.INFO: parquet.dataset_tables,
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


def _format(path: Path) -> str:
    """Format of a log: the end of its name, or the file that marks it as a bag's folder or a dataset; "" for none."""
    if parquet.is_dataset(path):
        return parquet.INFO
    if (path / BAG_FOLDER).is_file():
        return BAG_FOLDER
    known = (*TEXT, ".npz", *ONE_CLOCK, *SEVERAL_CLOCKS)
    return next((end for end in known if end[0] == "." and path.name.lower().endswith(end)), "")


def is_log(path: Path) -> bool:
    """True if a file can be read by its suffix, or is a bag's folder or an episode of a dataset."""
    return bool(_format(path))


def is_bag(path: Path) -> bool:
    """True if a file is a ROS bag, or the folder of one."""
    return SEVERAL_CLOCKS.get(_format(path)) is bag.tables


def has_several_clocks(path: Path) -> bool:
    """True if a file holds tables that each have times of their own."""
    return _format(path) in SEVERAL_CLOCKS


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


def files_in(path: Path) -> tuple[Path, ...]:
    """Files that a log consists of: itself, those of a bag's folder, or those of an episode of a dataset.

    Raises:
        LogError: A dataset is damaged.
    """
    if parquet.is_dataset(path):
        return parquet.parts(path)
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
    truth: bool = False,
    limit: int = LIMIT,
    layout: Layout | None = None,
) -> Iterator[Table]:
    """Reads a file that is one table piece by piece, so that text may be larger than memory.

    Args:
        path: A text file or a `.npz`, `.mot`, `.sto`, `.trc`, `.parquet`, `.mat` or `.jsonl` file, or the folder of a
            LeRobot dataset, `DATASET#3` for its episode 3.
        samples: Samples of each piece; the last one may have fewer.
        truth: True to read an archive's true values as well.
        limit: Bytes that a piece of packed text, or any other file, may take in memory, as for `limits.check_size`.
        layout: Layout of text, if it is not the default.

    Raises:
        LogError: The file is missing or malformed; an error in a later piece is raised when that piece is read.
        InputError: The library that reads it is not installed.
    """
    kind = _format(path)
    if kind not in (*TEXT, ".npz", *ONE_CLOCK) or not (path.is_file() or kind == parquet.INFO):
        raise _refusal(path)
    if kind in TEXT:
        return csv_pieces(path, samples, layout=layout, limit=limit)
    if layout not in (None, Layout()):
        raise LogError("the mapping's [file] tells how text is laid out, but this file is none.")
    table = npz_table(path, limit, truth=truth) if kind == ".npz" else ONE_CLOCK[kind](path, limit)[0]
    return (table.part(slice(first, first + samples)) for first in range(0, len(table.rows), samples))


def read_files(
    files: Sequence[Path], layouts: Sequence[Layout], clocks: Sequence[Columns | None], *, limit: int = LIMIT
) -> list[Table]:
    """Tables of several files, each with a column `time` in s.

    Columns that two files have are called `1:NAME` and `2:NAME`, by the number of the file.

    Args:
        files: The files.
        layouts: Their layouts, if they are text.
        clocks: Their columns of times, None if names show them.
        limit: Bytes that each may take in memory.

    Raises:
        LogError: One is missing or damaged, or its times are missing or of another epoch than the others'.
        InputError: The library that reads one is not installed.
    """
    if twice := [file.name for file in files if [*map(realpath, files)].count(realpath(file)) > 1]:
        raise LogError(f"a log is made of different files, but {twice[0]} is given twice.")
    tables: list[list[Table]] = []
    for file, layout, clock in zip(files, layouts, clocks, strict=True):
        try:
            own = _of_file(file, layout, clock, limit)
        except (LogError, OSError) as error:
            raise LogError(f"{file.name}: {error}") from None
        tables.append([replace(table, word=f"{file.name} {table.word}") for table in own])
    return _from_one_zero(files, _apart(tables))


def _of_file(file: Path, layout: Layout, clock: Columns | None, limit: int) -> list[Table]:
    """Tables of one of the files."""
    if is_bag(file):
        raise LogError("a bag counts its times from its first message; it cannot be put together with other files.")
    if has_several_clocks(file):
        return read_clocks(file, limit=limit)
    pieces = list(read_tables(file, limit=limit, layout=layout))
    if not pieces:
        raise LogError("it has no rows.")
    return [_timed(pieces[0].counted(clock), clock)]


def _timed(table: Table, clock: Columns | None) -> Table:
    """The table with its times in the column `time` in s."""
    named = [name for name in (TIME, "t") if name in table.cells] if clock is None else list(clock.read)
    if (clock is None and len(named) != 1) or not table.cells.keys() >= set(named):
        needed = f"times in a column '{named[0]}'" if clock else f"one column of times, {TIME} or t"
        raise LogError(
            f"it needs {needed}, or the mapping the columns of times of all files, time = [...], and in it "
            f"{{ rate = HZ }} for one without; {table.available()}."
        )
    clock = clock or Columns((named[0],))
    seconds = replace(table, sums={each.name: each for each in clock.sums}).column(clock.names[0]) * clock.factor
    if np.isnan(seconds).any():
        raise LogError(f"column '{named[0]}' is empty, but a log needs times.")
    others = {name: x for name, x in table.cells.items() if name not in named and not name.startswith(TRUE)}
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


def _refusal(path: Path) -> LogError:
    """Error for a path that is no log."""
    if not path.exists():
        return LogError("there is no such file; check its path and its name.")
    if path.is_dir():
        return LogError(f"the folder needs {BAG_FOLDER} of a ROS 2 bag or {parquet.INFO} of a LeRobot dataset.")
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
    names = [f"{label}{end}" for label in labels for end in ends]
    if missing := [name for name in names if name not in table.cells]:
        raise LogError(f"marker '{short(missing[0][:-2])}' lacks the column '{short(missing[0])}'.")
    positions = np.stack([table.column(name, gaps=True) for name in names], axis=1)
    return Markers(table.column("time"), labels, factor * positions.reshape(len(positions), -1, 3))


class DataFrame(Protocol):
    """A data frame as of pandas."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""

    @property
    def index(self) -> Any:
        """Index of the rows."""

    def __getitem__(self, name: Any) -> Any:
        """A column."""


InMemory: TypeAlias = Mapping[str, Any] | DataFrame
"""Columns by name: arrays (N,) or (N, d), a data frame, or an xarray dataset."""

TYPES = "a mapping of arrays, a pandas DataFrame or an xarray Dataset"
"""Types of the sources of a table, for messages."""


def kind_of(source: Any) -> str:
    """Kind of a source, for messages, such as `pandas DataFrame` or `dict of columns`."""
    package, name = type(source).__module__.partition(".")[0], type(source).__name__
    return f"{name} of columns" if package in ("builtins", "collections") else f"{package} {name}"


def table_of(source: Any) -> Table | None:
    """Table of columns in memory; None for what is none of `TYPES`.

    The index of a data frame is a column if it has a name, as the coordinates of a dataset are that have one number for
    each sample. Dates and durations become seconds from the first.

    Raises:
        LogError: A column has no numbers, columns have different lengths, or names are not texts of their own.
    """
    arrays = _arrays(source)
    if arrays is None:
        return None
    columns = {name: _as_numbers(name, np.asarray(values)) for name, values in arrays.items()}
    lengths = {name: len(x) for name, x in columns.items()}
    if len(set(lengths.values())) > 1:
        (name, samples), *others = lengths.items()
        other, its = next(each for each in others if each[1] != samples)
        raise LogError(
            f"columns need one length, but '{short(name)}' has {samples} samples and '{short(other)}' has {its}."
        )
    cells = _by_text(pair for name, x in columns.items() for pair in vector_columns(name, x).items())
    samples = next(iter(lengths.values()), 0)
    return Table(cells, range(1, samples + 1), "sample", origin=kind_of(source))


def _arrays(source: Any) -> dict[str, Any] | None:
    """Columns by name, as they are."""
    if isinstance(source, Mapping):
        lengths = {np.shape(x)[:1] for x in source.values()}
        coordinates = getattr(source, "coords", {}).items()
        return _by_text([*((k, x) for k, x in coordinates if np.ndim(x) == 1 and x.shape in lengths), *source.items()])
    if hasattr(source, "columns") and hasattr(source, "index"):
        index = [] if source.index.name is None else [(source.index.name, source.index)]
        names = _by_text((name, name) for name in source.columns)
        return _by_text([*index, *((name, source[own]) for name, own in names.items())])
    return None


def _by_text(columns: Iterable[tuple[Any, Any]]) -> dict[str, Any]:
    """Columns by their names as texts.

    Raises:
        LogError: A name has several levels, or two columns have one name.
    """
    out: dict[str, Any] = {}
    for name, column in columns:
        if isinstance(name, tuple):
            raise LogError(
                f"column {short(name)} has a name of {len(name)} levels and needs a text; for a data frame, "
                'frame.columns = frame.columns.map("_".join) makes one.'
            )
        if str(name) in out:
            raise LogError(f"two columns are named '{short(name)}'; each needs a name of its own.")
        out[str(name)] = column
    return out


def _as_numbers(name: str, values: np.ndarray) -> np.ndarray:
    """Numbers of a column (N,) or (N, d)."""
    if values.ndim not in (1, 2) or not values.size:
        raise LogError(f"column '{short(name)}' needs a number for each sample, got shape {values.shape}.")
    if values.dtype.kind in "mM":
        return (values - values[:1]) / np.timedelta64(1, "s")
    try:
        # Imaginary parts would be dropped.
        return values.astype(float, casting="same_kind" if values.dtype.kind == "c" else "unsafe")
    except (TypeError, ValueError):
        raise LogError(f"column '{short(name)}' needs numbers, got {values.dtype}.") from None
