"""JSON lines: an object of numbers, arrays and further objects for every sample."""

import json
from collections.abc import Iterator, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.csv_file import lines_of, opened_text
from ident.files.limits import NUMBER
from ident.files.table import SUFFIXES, Table, short

SUFFIX = (".jsonl", ".ndjson", ".jsonl.gz", ".ndjson.gz")
"""Ends of the names of such files."""

STAMPS = (("sec", "nanosec"), ("secs", "nsecs"))
"""Names of the parts of a time of ROS, which is one number."""

IN_MEMORY = 5 * NUMBER
"""Bytes of a value while a file is read: an object of 24 bytes, its place in a list, and the number."""


def tables(path: Path, limit: int) -> list[Table]:
    """The table of all numbers, empty where a line lacks one: `q.0` of an array, `state.q.0` of one in an object.

    Raises:
        LogError: A line holds no object of JSON, or one name for two values; or the file is too large.
    """
    cells: dict[str, list[Any]] = {}
    rows = list[int]()
    with opened_text(path, limit) as text:
        for row, line in lines_of(text):
            sample = _sample(row, line)
            new = [name for name in sample if name not in cells]
            text.check_size(IN_MEMORY * (len(cells) + len(new)) * (len(rows) + 1))
            cells |= {name: [None] * len(rows) for name in new}
            for name, column in cells.items():
                column.append(sample.get(name))
            rows.append(row)
    return [Table({name: _column(column) for name, column in cells.items()}, rows, "row")]


def _sample(row: int, line: str) -> dict[str, Any]:
    """Values of one line by name."""
    try:
        # Python refuses integers of thousands of digits, which as numbers are infinite.
        content = json.loads(line, parse_int=float)
    except (ValueError, RecursionError) as error:
        raise LogError(f"row {row} needs an object of JSON, {{...}}, for one sample ({error}).") from None
    if not isinstance(content, dict):
        raise LogError(f"row {row} needs an object of JSON, {{...}}, for one sample; got {short(content)}.")
    out: dict[str, Any] = {}
    for name, value in _values("", content):
        if name in out:
            raise LogError(f"row {row} has two values named '{short(name)}'; each needs a name of its own.")
        out[name] = value
    return out


def _values(name: str, content: Any) -> Iterator[tuple[str, Any]]:
    """All values of nested objects and arrays by name, as `vector_columns` names those of arrays."""
    if isinstance(content, dict) and tuple(content) in STAMPS and all(isinstance(x, float) for x in content.values()):
        yield name, sum(x * unit for x, unit in zip(content.values(), (1.0, 1e-9), strict=True))
    elif isinstance(content, dict):
        for key, value in content.items():
            yield from _values(f"{name}.{key}" if name else key, value)
    elif isinstance(content, list):
        plain = not any(isinstance(each, list | dict) for each in content)
        suffixes: Sequence[Any] = SUFFIXES.get(len(content), "") if plain else ""
        for suffix, value in zip(suffixes or range(len(content)), content, strict=True):
            yield from _values(f"{name}.{suffix}", value)
    else:
        yield name, content


def _column(values: Sequence[Any]) -> np.ndarray | list[str]:
    """A column of numbers, NaN for missing ones, or of text (N,)."""
    if all(map(isinstance, values, repeat(float | bool | None))):
        return np.array([np.nan if x is None else x for x in values], float)
    return ["" if x is None else str(x) for x in values]
