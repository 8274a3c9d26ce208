"""Recordings as text: comments in JSON, a header row, and a row of numbers for every sample."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError

COMPONENTS = {3: "xyz", 4: "wxyz"}
"""Suffixes of the columns of a vector and of a quaternion in a CSV file: `ground_force.x`."""

TRUE = "true:"
"""Prefix of the CSV columns that hold true values."""


def write_csv(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Writes a recording's channels, the time among them.

    Args:
        path: File to write.
        channels: Channels (N,) or (N, d) by name; those of true values begin with `TRUE`.
        metadata: What else is known, in JSON's types.
    """
    columns: dict[str, np.ndarray] = {}
    for name, x in channels.items():
        suffixes = [""] if x.ndim == 1 else [f".{c}" for c in COMPONENTS.get(x.shape[1], range(x.shape[1]))]
        columns |= {f"{name}{s}": column for s, column in zip(suffixes, x.reshape(len(x), -1).T, strict=True)}
    with path.open("w", encoding="utf-8") as stream:
        stream.writelines(f"# {key}: {json.dumps(value)}\n" for key, value in metadata.items())
        stream.write(",".join(columns) + "\n")
        table = np.stack(list(columns.values()), axis=1)
        stream.writelines(",".join(map(repr, row.tolist())) + "\n" for row in table)


def csv_pieces(path: Path, samples: int) -> Iterator[tuple[dict[str, np.ndarray], dict[str, Any]]]:
    """Channels of at most so many samples at a time, each time with the metadata.

    Raises:
        LogError: The file is malformed; the message names row and column.
    """
    with path.open(encoding="utf-8-sig") as stream:
        lines = _lines(stream)
        metadata: dict[str, Any] = {}
        row, line = 1, next(lines, "")
        while line.startswith("#"):
            key, value = _comment(line, row)
            metadata[key] = value
            row, line = row + 1, next(lines, "")
        header = _header(line)
        row += 1
        while block := list(islice(lines, samples)):
            columns = dict(zip(header, _table(block, row, header).T, strict=True))
            names = dict.fromkeys(column.partition(".")[0] for column in header)
            yield {name: _channel(name, columns) for name in names}, metadata
            row += len(block)


def _lines(stream: Iterable[str]) -> Iterator[str]:
    """Lines of a text; blank ones are for its end only."""
    blank = 0
    try:
        for row, line in enumerate(stream, start=1):
            if line == "\n":
                blank = blank or row
            elif blank:
                raise LogError(f"row {blank} is blank.")
            else:
                yield line
    except UnicodeDecodeError as error:
        raise LogError(
            f"the file needs to be text in UTF-8, a byte 0x{error.object[error.start]:02x} is not."
        ) from None


def _comment(line: str, row: int) -> tuple[str, Any]:
    key, _, value = line[1:].partition(":")
    try:
        return key.strip(), json.loads(value)
    except (ValueError, RecursionError) as error:
        raise LogError(f"row {row} needs '# units', noise or provenance in JSON ({error}).") from None


def _header(line: str) -> list[str]:
    header = [cell.strip() for cell in line.split(",")]
    if header == [""]:
        raise LogError("no header row.")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise LogError(f"the header names {', '.join(twice)} more than once.")
    if "time" not in header:
        raise LogError(f"a recording needs a column 'time'; it has {', '.join(header)}.")
    return header


def _table(lines: Sequence[str], row: int, header: Sequence[str]) -> np.ndarray:
    """Numbers of the lines that begin with a row (n, columns)."""
    # Numpy reads faster, and accepts nothing that `float` does not; but it cannot say where in the file a fault is.
    with suppress(ValueError):
        table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
        if table.shape[1] == len(header) and np.isfinite(table).all():
            return table
    return np.array([_numbers(line, number, header) for number, line in enumerate(lines, start=row)])


def _numbers(line: str, row: int, header: Sequence[str]) -> list[float]:
    cells = line.removesuffix("\n").split(",")
    if len(cells) != len(header):
        raise LogError(f"row {row} has {len(cells)} cells where the header has {len(header)}.")
    return [_number(cell, row, column) for cell, column in zip(cells, header, strict=True)]


def _number(cell: str, row: int, column: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        raise LogError(f"row {row}, column '{column}' needs a number, got '{cell}'.") from None
    if not math.isfinite(number):
        raise LogError(f"row {row}, column '{column}' needs a finite number, got '{cell}'.")
    return number


def _channel(name: str, columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """A channel from its column, or from its columns `name.x`, `name.y`, … in whatever order they stand."""
    suffixes = [column.partition(".")[2] for column in columns if column.partition(".")[0] == name]
    if suffixes == [""]:
        return columns[name]
    expected = COMPONENTS.get(len(suffixes), [str(k) for k in range(len(suffixes))])
    if sorted(suffixes) != sorted(expected):
        raise LogError(f"channel '{name}' needs the components {', '.join(expected)}, it has {', '.join(suffixes)}.")
    return np.stack([columns[f"{name}.{suffix}"] for suffix in expected], axis=1)
