"""Files of markers: motion-capture formats, which state their unit, and tables."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.files.column import UNITS
from ident.files.formats import c3d, trc
from ident.files.limits import LIMIT
from ident.files.markers import Markers
from ident.files.readers import read_tables
from ident.files.table import SUFFIXES, Table, short

CAPTURED: Mapping[str, Callable[[Path, int], Markers]] = {".trc": trc.markers, ".c3d": c3d.markers}
"""Readers of files that state their unit, by suffix, given the path and the bytes it may take in memory."""

TABLES = (".csv", ".tsv", ".txt", ".npz")
"""Suffixes of tables with markers."""


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
