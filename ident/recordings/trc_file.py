"""Track row column files: positions of markers as motion capture and OpenSim write them.

Five lines stand before the frames: the file's name, names of what is known, that, the labels, each over three columns,
and the names of these columns:

    PathFileType  4  (X/Y/Z)  walk.trc
    DataRate  CameraRate  NumFrames  NumMarkers  Units  OrigDataRate  OrigDataStartFrame  OrigNumFrames
    100  100  2  1  mm  100  1  2
    Frame#  Time  KNEE
            X1  Y1  Z1
    1  0.00  1.5  2.5  3.5
    2  0.01  1.6  2.6  3.6
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.recordings.column import UNITS
from ident.recordings.table import short

LENGTHS: Mapping[str, float] = {**UNITS["length"], "meters": 1.0, "millimeters": 1e-3, "centimeters": 1e-2}
"""Units of length that files state, as factors to the metre."""

NEEDED = ("NumFrames", "NumMarkers", "Units")
"""What the header has to tell."""

Line = tuple[int, list[str]]
"""A line of the file, with its number from 1, as cells."""


def trc_markers(path: Path) -> tuple[np.ndarray, tuple[str, ...], np.ndarray, str]:
    """Times (N,), labels, positions (N, M, 3) in the unit that the file states, and that.

    Markers are missing where cells are empty, NaN, or all three zero, as some programs write.

    Raises:
        LogError: The file is malformed; the message names the row.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise LogError(f"a .trc file is text in UTF-8, byte {error.start} is not.") from None
    lines = [(number, [cell.strip() for cell in line.split("\t")]) for number, line in enumerate(text.splitlines(), 1)]
    if len(lines) < 5 or lines[0][1][0] != "PathFileType":
        raise LogError("a .trc file begins with 'PathFileType' and has four more lines before the frames.")
    told = _told(lines[1], lines[2])
    if told["Units"] not in LENGTHS:
        raise LogError(f"row 3: Units are one of {', '.join(LENGTHS)}, got '{short(told['Units'])}'.")
    labels = _labels(lines[3], _count(told, "NumMarkers"))
    rows = [(number, cells) for number, cells in lines[5:] if any(cells)]
    if len(rows) != _count(told, "NumFrames") or not rows:
        raise LogError(f"row 3 states {told['NumFrames']} frames, the file has {len(rows)}; was it cut off?")
    table = np.array([_numbers(row, 2 + 3 * len(labels)) for row in rows])
    time, positions = table[:, 1], table[:, 2:].reshape(len(rows), len(labels), 3)
    _check_times(rows, time)
    missing = np.isnan(positions)
    partly = missing.any(axis=2) & ~missing.all(axis=2)
    if partly.any():
        k, m = np.argwhere(partly)[0]
        raise LogError(f"row {rows[k][0]}: marker '{short(labels[m])}' has some of X, Y and Z only.")
    positions[(positions == 0).all(axis=2)] = np.nan
    return time, labels, positions, told["Units"]


def _told(names: Line, values: Line) -> dict[str, str]:
    """What the header tells, by its names."""
    told = dict(zip(names[1], values[1], strict=False))
    if missing := [name for name in NEEDED if not told.get(name)]:
        raise LogError(f"rows 2 and 3 of a .trc file tell {', '.join(NEEDED)}; {missing[0]} is missing.")
    return told


def _count(told: Mapping[str, str], name: str) -> int:
    """A number of things that the header tells."""
    if not told[name].isdecimal():
        raise LogError(f"row 3: {name} needs a whole number, got '{short(told[name])}'.")
    return int(told[name])


def _labels(line: Line, count: int) -> tuple[str, ...]:
    """The labels, each over three columns."""
    number, cells = line
    if [cell.rstrip("#").lower() for cell in cells[:2]] != ["frame", "time"]:
        raise LogError(f"row {number} of a .trc file begins with Frame# and Time, got '{short(cells[0])}'.")
    labels = tuple(label for label in cells[2:] if label)
    if len(labels) != count or not labels:
        raise LogError(f"row 3 states {count} markers, but row {number} names {len(labels)}.")
    if twice := [label for label in labels if labels.count(label) > 1]:
        raise LogError(f"row {number} names marker '{short(twice[0])}' more than once; labels have to differ.")
    return labels


def _numbers(row: Line, count: int) -> list[float]:
    """So many numbers of a row, NaN for empty cells and for those that are missing at its end."""
    number, cells = row
    if any(cells[count:]):
        raise LogError(f"row {number} has {len(cells)} cells where the header has {count}.")
    return [_number(number, k, cell) for k, cell in enumerate(cells[:count])] + [np.nan] * (count - len(cells))


def _number(row: int, k: int, cell: str) -> float:
    try:
        value = float(cell or "nan")
    except ValueError:
        value = np.inf
    if np.isinf(value) or "_" in cell:
        raise LogError(f"row {row}, cell {k + 1} needs a finite number, got '{short(cell)}'.")
    return value


def _check_times(rows: Sequence[Line], time: np.ndarray) -> None:
    """Refuses frames without time, or that go back in time."""
    wrong = ~(np.diff(time, prepend=-np.inf) > 0)
    if wrong.any():
        k = int(wrong.argmax())
        raise LogError(f"row {rows[k][0]}: times have to be there and to increase, got {time[k]:g} s.")
