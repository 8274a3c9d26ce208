"""Labelled positions of markers over time, and the files that hold them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.recordings.c3d_markers import c3d_markers
from ident.recordings.files import read_tables
from ident.recordings.column import UNITS
from ident.recordings.table import SUFFIXES, Table, short
from ident.recordings.trc_file import LENGTHS, trc_markers
from ident.tolerances import HUGE

SUFFIX = {".trc", ".c3d", ".csv", ".tsv", ".txt", ".npz"}
"""What names of files with markers end in."""


@dataclass(frozen=True, eq=False)
class Markers:
    """Positions of labelled markers.

    Attributes:
        time: Times of the frames, s (N,).
        labels: Names of the markers, each once.
        positions: Positions in the laboratory's frame, NaN where a marker was not seen, m (N, M, 3).
    """

    time: np.ndarray
    labels: tuple[str, ...]
    positions: np.ndarray

    def __post_init__(self) -> None:
        N, M = len(self.time), len(self.labels)
        if not N or not M or self.positions.shape != (N, M, 3):
            raise LogError(
                f"{M} markers in {N} frames need positions ({N}, {M}, 3), one or more of each, got shape "
                f"{self.positions.shape}."
            )
        if twice := [label for label in self.labels if self.labels.count(label) > 1]:
            raise LogError(f"marker '{short(twice[0])}' is there more than once; labels have to differ.")
        if not np.isfinite(self.time).all() or not (np.diff(self.time) > 0).all():
            late = int(np.argmin([True, *(np.diff(self.time) > 0)]))
            raise LogError(f"times of frames must be finite and increase; frame {late + 1} does not.")
        if (far := np.argwhere(np.abs(self.positions) >= HUGE)).size:
            k, m, _ = far[0]
            raise LogError(f"frame {k + 1}: marker '{short(self.labels[m])}' needs positions below {HUGE:g} m.")

    @property
    def seen(self) -> np.ndarray:
        """Whether each marker was seen (N, M)."""
        return np.isfinite(self.positions).all(axis=2)


def read_markers(path: str | Path, unit: str | None = None) -> Markers:
    """Reads the markers of a file.

    Args:
        path: A `.trc` or `.c3d` file, which state their unit, or a table (`.csv`, `.tsv`, `.txt`, `.npz`) with a column
            `time` in s and the columns LABEL.x, LABEL.y and LABEL.z of every marker, cells being empty or NaN where it
            was not seen.
        unit: Unit of the lengths in a table, `m` if not given; a file that states another is refused.

    Raises:
        LogError: The file is missing or malformed; the message names it and the row, column or marker.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIX or not path.is_file():
        raise LogError(f"{path}: markers are in a .trc, .c3d, .csv, .tsv, .txt or .npz file that exists.")
    try:
        if path.suffix.lower() == ".trc":
            time, labels, positions, stated = trc_markers(path)
        elif path.suffix.lower() == ".c3d":
            time, labels, positions, stated = c3d_markers(path)
        else:
            time, labels, positions = _of_table(path)
            stated = unit or "m"
        if unit is not None and LENGTHS[stated] != UNITS["length"][unit]:
            raise LogError(f"the file states that lengths are in {stated}, but {unit} was given.")
        return Markers(time, labels, LENGTHS[stated] * positions)
    except (LogError, OSError) as error:
        raise LogError(f"{path}: {error}") from None


def _of_table(path: Path) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Times, labels and positions (N, M, 3) of a table."""
    tables = list(read_tables(path))
    if not tables:
        raise LogError("a file of markers needs frames, it has none.")
    (table,) = tables
    if "time" not in table.cells:
        raise LogError(f"markers need a column 'time'; {table.available()}.")
    labels = tuple(dict.fromkeys(name[:-2] for name in table.cells if name[-2:] in (".x", ".y", ".z") and name[:-2]))
    if not labels:
        raise LogError(f"markers need columns LABEL.x, LABEL.y and LABEL.z; {table.available()}.")
    positions = np.stack([_marker(table, label) for label in labels], axis=1)
    return table.column("time"), labels, positions


def _marker(table: Table, label: str) -> np.ndarray:
    """Positions of a marker (N, 3), NaN in all components or in none."""
    names = [f"{label}.{axis}" for axis in SUFFIXES[3]]
    if missing := [name for name in names if name not in table.cells]:
        raise LogError(f"marker '{short(label)}' lacks the column '{short(missing[0])}'.")
    xyz = np.stack([table.column(name, gaps=True) for name in names], axis=1)
    partly = np.isnan(xyz).any(axis=1) & ~np.isnan(xyz).all(axis=1)
    if partly.any():
        raise LogError(f"{table.row(int(partly.argmax()))}: marker '{short(label)}' has some of x, y and z only.")
    return xyz
