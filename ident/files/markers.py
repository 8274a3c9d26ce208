"""Positions of labelled markers over time, and `.trc` files of them: header rows, labels, axes, a row for each frame.

Cells are separated by tabs; each label spans three columns:

    PathFileType  4  (X/Y/Z)  walk.trc
    DataRate  CameraRate  NumFrames  NumMarkers  Units  OrigDataRate  OrigDataStartFrame  OrigNumFrames
    100  100  2  1  mm  100  1  2
    Frame#  Time  KNEE
            X1  Y1  Z1
    1  0.00  1.5  2.5  3.5
    2  0.01  1.6  2.6  3.6
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.files.csv_file import Text, lines_of, opened_text
from ident.files.limits import NUMBER, checked_rate
from ident.files.table import UNITS, Table, short, vector_columns
from ident.tolerances import HUGE


@dataclass(frozen=True, eq=False)
class Markers:
    """Positions of labelled markers.

    Attributes:
        time: Times of the frames, s (N,).
        labels: Names of the markers, each once.
        positions: Positions in the laboratory's frame, NaN where a marker is missing, m (N, M, 3).
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
        check_labels(self.labels)
        wrong = ~np.isfinite(self.time)
        wrong[1:] |= ~(self.time[1:] > self.time[:-1])
        if wrong.any():
            raise LogError(f"times of frames must be finite and increase; frame {int(wrong.argmax()) + 1} does not.")
        missing = np.isnan(self.positions)
        self._refuse(missing.any(axis=2) & ~missing.all(axis=2), "has some of x, y and z only")
        self._refuse((np.abs(self.positions) >= HUGE).any(axis=2), f"needs positions below {HUGE:g} m")

    def _refuse(self, wrong: np.ndarray, what: str) -> None:
        """Raises an error on the first true entry of a mask of frames and markers (N, M)."""
        if wrong.any():
            k, m = np.argwhere(wrong)[0]
            raise LogError(f"frame {k + 1}: marker '{short(self.labels[m])}' {what}.")

    @property
    def visible(self) -> np.ndarray:
        """Mask of the markers present in each frame (N, M)."""
        return np.isfinite(self.positions).all(axis=2)

    @property
    def table(self) -> Table:
        """Table with the columns `time`, `LABEL.x`, `LABEL.y` and `LABEL.z`."""
        cells = {"time": self.time}
        for label, x in zip(self.labels, self.positions.swapaxes(0, 1), strict=True):
            cells |= vector_columns(label, x)
        return Table(cells, range(len(self.time)), "frame", units=dict.fromkeys(cells, "SI"))


def check_labels(labels: Sequence[str]) -> None:
    """Refuses duplicate labels.

    Raises:
        LogError: A label occurs twice.
    """
    twice = [label for label in labels if labels.count(label) > 1]
    if twice:
        raise LogError(f"markers need different labels, '{short(twice[0])}' is given to more than one.")


NEEDED = ("DataRate", "NumFrames", "NumMarkers", "Units")
"""Required entries of the header."""

LENGTHS: Mapping[str, float] = {**UNITS["length"], "meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3}
"""Units of length in headers, as factors to the metre."""

Row = tuple[int, list[str]]
"""Cells of a row, with its number from 1."""


def trc_markers(path: Path, limit: int) -> Markers:
    """Positions of the markers of a `.trc` file.

    A marker is missing where its cells are empty, NaN, or all three zero, as some programs write.

    Raises:
        LogError: The header is incomplete or contradicts the rows, or a row is malformed.
    """
    with opened_text(path, limit) as text:
        lines = ((number, [cell.strip() for cell in line.split("\t")]) for number, line in lines_of(text))
        return _markers(list(islice(lines, 5)), lines, text)


def _markers(rows: list[Row], others: Iterator[Row], text: Text) -> Markers:
    """Markers from the first five rows of a file and an iterator of the others, parsed one at a time."""
    if len(rows) < 5 or rows[0][1][0] != "PathFileType":
        raise LogError("a .trc file begins with PathFileType, and has four more rows before its frames; this has not.")
    header = dict(zip(rows[1][1], rows[2][1], strict=False))
    if missing := [key for key in NEEDED if not header.get(key)]:
        raise LogError(f"the header of a .trc file needs {', '.join(NEEDED)}; it lacks {', '.join(missing)}.")
    rate = checked_rate(_number(rows[2], header["DataRate"]), "the DataRate of a .trc file")
    if header["Units"] not in LENGTHS:
        raise LogError(f"the markers' Units need to be one of {', '.join(LENGTHS)}; got {short(header['Units'])}.")
    labels = _labels(rows[3])
    # Some files leave out the row of axes.
    columns = 2 + 3 * len(labels)
    frames: list[np.ndarray] = []
    for row in chain(rows[4:] if rows[4][1][0].isdecimal() else [], others):
        frames.append(np.array(_frame(row, columns)))
        text.check_size(len(frames) * NUMBER * columns)
    for key, count in (("NumFrames", len(frames)), ("NumMarkers", len(labels))):
        if header[key] != str(count):
            raise LogError(f"the header promises {short(header[key])} as {key}, the file has {count}.")
    table = np.reshape(frames, (len(frames), columns))
    x = table[:, 2:].reshape(len(frames), len(labels), 3)
    x[(x == 0).all(axis=2)] = np.nan
    markers = Markers(table[:, 1], labels, LENGTHS[header["Units"]] * x)
    step = np.median(np.diff(markers.time)) if len(frames) > 1 else 1 / rate
    if not 0.9 < step * rate < 1.1:
        raise LogError(f"the header promises {rate:g} Hz, but frames are {step:g} s apart.")
    return markers


def _labels(row: Row) -> tuple[str, ...]:
    """Labels, each of which spans three columns."""
    number, cells = row
    if [cell.rstrip("#").lower() for cell in cells[:2]] != ["frame", "time"]:
        raise LogError(f"row {number} of a .trc file begins with Frame# and Time, got '{short(cells[0])}'.")
    return tuple(label for label in cells[2:] if label)


def _frame(row: Row, columns: int) -> list[float]:
    """Numbers of a row, NaN for cells that are empty or missing at its end."""
    number, cells = row
    if any(cells[columns:]):
        raise LogError(f"row {number} has {len(cells)} cells where the labels ask for {columns}.")
    numbers = [_number(row, cell or "nan") for cell in cells[:columns]]
    return numbers + [np.nan] * (columns - len(numbers))


def _number(row: Row, cell: str) -> float:
    try:
        value = np.inf if "_" in cell else float(cell)
    except ValueError:
        value = np.inf
    if np.isinf(value):
        raise LogError(f"row {row[0]} needs finite numbers, got '{short(cell)}'.")
    return value
