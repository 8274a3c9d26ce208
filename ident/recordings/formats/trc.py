"""Marker positions as text, `.trc`: two rows of what is known, two of labels and axes, then a row for each frame."""

from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.recordings.column import UNITS
from ident.recordings.csv_file import Line, lines_of
from ident.recordings.formats.reading import checked_rate
from ident.recordings.markers import Markers, check_labels
from ident.recordings.table import Table, short
from ident.recordings.text_file import opened_text

NEEDED = ("DataRate", "NumFrames", "NumMarkers", "Units")
"""Entries of the header that the positions cannot do without."""


def tables(path: Path, limit: int) -> list[Table]:
    """The markers' table, without joints.

    Raises:
        LogError: The file is malformed.
    """
    return [markers(path, limit).table]


def markers(path: Path, limit: int) -> Markers:
    """Positions of the markers of a `.trc` file.

    Raises:
        LogError: The header is incomplete or contradicts the rows, or a row is malformed.
    """
    with opened_text(path, limit) as text:
        lines = list(lines_of(text))
    if len(lines) < 6 or not lines[0][1].startswith("PathFileType"):
        raise LogError("a .trc file begins with PathFileType, and has five rows before its frames; this one has not.")
    header = dict(zip(_cells(lines[1]), _cells(lines[2]), strict=False))
    if missing := [key for key in NEEDED if not header.get(key)]:
        raise LogError(f"the header of a .trc file needs {', '.join(NEEDED)}; it lacks {', '.join(missing)}.")
    rate = checked_rate(_number(lines[2], header["DataRate"]), "the DataRate of a .trc file")
    factor = UNITS["length"].get(header["Units"])
    if factor is None:
        raise LogError(f"the markers' Units need to be one of {', '.join(UNITS['length'])}; got {header['Units']}.")
    labels = [label for label in _cells(lines[3])[2:] if label]
    check_labels(labels)
    rows = lines[5:] if not lines[4][1].split()[0].lstrip("-").isdigit() else lines[4:]
    for key, count in (("NumFrames", len(rows)), ("NumMarkers", len(labels))):
        if header[key] != str(count):
            raise LogError(f"the header promises {short(header[key])} as {key}, the file has {count}.")
    table = np.array([_frame(row, 2 + 3 * len(labels)) for row in rows])
    time, x = table[:, 1], factor * table[:, 2:].reshape(len(rows), -1, 3)
    _check_rate(time, rate)
    return Markers(time, rate, {label: x[:, k] for k, label in enumerate(labels)})


def _cells(line: Line) -> list[str]:
    return [cell.strip() for cell in line[1].rstrip("\r\n").split("\t")]


def _frame(line: Line, columns: int) -> list[float]:
    """Numbers of a row, NaN for cells that are empty or left out at its end."""
    cells = _cells(line)
    if any(cells[columns:]):
        raise LogError(f"row {line[0]} has {len(cells)} cells where the labels ask for {columns}.")
    numbers = [_number(line, cell or "nan") for cell in cells[:columns]]
    return numbers + [np.nan] * (columns - len(numbers))


def _number(line: Line, cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise LogError(f"row {line[0]} needs numbers, got '{short(cell)}'.") from None


def _check_rate(time: np.ndarray, rate: float) -> None:
    """Refuses times that are not those of the rate."""
    if not np.isfinite(time).all():
        raise LogError("every frame needs a time, some have none.")
    steps = np.diff(time)
    if len(steps) and not 0.9 < np.median(steps) * rate < 1.1:
        raise LogError(f"the header promises {rate:g} Hz, but frames are {np.median(steps):g} s apart.")
