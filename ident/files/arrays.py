"""Files of columns by name: JSON lines, MATLAB's arrays and Parquet."""

import json
import math
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ident.errors import LogError
from ident.files.csv_file import lines_of, opened_text
from ident.files.limits import NUMBER, PIECE, check_size, library, undamaged
from ident.files.table import SUFFIXES, Table, short, vector_columns

JSON_LINES = (".jsonl", ".ndjson", ".jsonl.gz", ".ndjson.gz")
"""Ends of the names of files with an object of JSON in each line."""

STAMPS = (("sec", "nanosec"), ("secs", "nsecs"))
"""Names of the parts of a time of ROS, which is one number."""

IN_MEMORY = 5 * NUMBER
"""Bytes of a value while a file is read: an object of 24 bytes, its place in a list, and the number."""


def json_tables(path: Path, limit: int) -> list[Table]:
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


COMPRESSED = 15
"""Type of a compressed element, of version 7."""


def mat_tables(path: Path, limit: int) -> list[Table]:
    """The table of all arrays with as many samples as the longest one, along their rows or their columns.

    An array `q` is the column `q`, or `q.x`, `q.y`, `q.z` if it has three; one in a structure is `data.q`.

    Raises:
        LogError: The file is damaged, too large, of version 7.3, or has no such array.
    """
    from scipy.io import loadmat, whosmat

    with undamaged("a MATLAB file"):
        with path.open("rb") as stream:
            head = stream.read(128)
        if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
            raise LogError("MATLAB files of version 7.3 are not read; save it in MATLAB with save(NAME, '-v7').")
        check_size(path, sum(_sizes(path, limit)), limit)
        # Small numbers and integers take less in the file than as floats in memory.
        check_size(path, sum(NUMBER * math.prod(shape) for _, shape, _ in whosmat(path)), limit)
        arrays = dict(_arrays("", loadmat(path, simplify_cells=True)))
        # Those in structures have no shape in the list above.
        check_size(path, sum(NUMBER * x.size for x in arrays.values()), limit)
    samples = max((max(x.shape) for x in arrays.values()), default=0)
    cells: dict[str, np.ndarray] = {}
    for name, x in arrays.items():
        if samples in x.shape:
            cells |= vector_columns(name, np.asarray(x if x.shape[0] == samples else x.T, float))
    return [Table(cells, range(samples if cells else 0), "sample")]


def _arrays(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of real numbers by name, without scalars."""
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _arrays(f"{prefix}{name}.", value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.ndim in (1, 2) and value.size > 1:
            yield f"{prefix}{name}", value[:, 0] if value.ndim == 2 and value.shape[1] == 1 else value


def _unpacked(packed: bytes, limit: int) -> int:
    """Bytes that a compressed element unpacks to, counted up to the first beyond a limit; it may state others."""
    stream, size = zlib.decompressobj(), 0
    for at in range(0, len(packed), PIECE):
        tail = packed[at : at + PIECE]
        while tail and size <= limit:
            size += len(stream.decompress(tail, PIECE))
            tail = stream.unconsumed_tail
    return size


def _sizes(path: Path, limit: int) -> Iterator[int]:
    """Unpacked size in bytes of each element of a file of version 5 to 7."""
    with path.open("rb") as stream:
        order = {b"IM": "<", b"MI": ">"}.get(stream.read(128)[126:])
        while order and len(tag := stream.read(8)) == 8:
            kind, size = (int(x) for x in np.frombuffer(tag, f"{order}u4"))
            end = stream.tell() + size
            if kind == COMPRESSED:
                packed = stream.read(size)
                stated = np.frombuffer(zlib.decompressobj().decompress(packed, 8), f"{order}u4")[1]
                size = max(int(stated), _unpacked(packed, limit))
            yield size
            stream.seek(end)


UNPACKED, PACKED = 2, 3
"""Fields of a page's header: its sizes in bytes."""

COUNTED = (5, 7, 8)
"""Fields of a page's header of which the first field is a number of values: data, dictionaries, data of version 2."""


def parquet_tables(path: Path, limit: int) -> list[Table]:
    """The table of a file; timestamps and durations are in s, timestamps counted from the first one.

    Raises:
        LogError: The file is damaged or too large.
        InputError: The library is not installed.
    """
    with library("parquet"):
        import pyarrow.parquet
    with undamaged("a parquet file"), path.open("rb") as stream:
        file = pyarrow.parquet.ParquetFile(stream)
        columns = file.schema_arrow
        numeric = [field for field in columns if _width(field.type)]
        check_size(path, NUMBER * file.metadata.num_rows * sum(_width(field.type) for field in numeric), limit)
        twice = [name for name in columns.names if columns.names.count(name) > 1]
        if twice:
            raise LogError(f"columns of a log need different names, '{twice[0]}' is more than one.")
        check_size(path, size_of(stream, file.metadata, [field.name for field in numeric]), limit)
        content = file.read([field.name for field in numeric])
        cells: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}
        for field in numeric:
            column = content.column(field.name)
            cells |= vector_columns(field.name, numbers(column))
            if _is_time(field.type):
                units[field.name] = "SI"
    return [Table(cells, range(content.num_rows), "row", units=units)]


def _width(kind: Any) -> int:
    """Count of numbers in a cell of a type; zero if it is not numeric."""
    from pyarrow import types

    if types.is_fixed_size_list(kind):
        return int(kind.list_size) if _width(kind.value_type) == 1 else 0
    number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)
    return int(number or _is_time(kind))


def _is_time(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_timestamp(kind) or types.is_duration(kind))


def numbers(column: Any) -> np.ndarray:
    """Numbers of a column of any numeric type, NaN for its nulls (N,) or (N, d)."""
    return _numbers(column.combine_chunks(), column.type)


def _numbers(column: Any, kind: Any) -> np.ndarray:
    """Numbers of an array, as `numbers`."""
    import pyarrow

    if _width(kind) > 1:
        if column.null_count:
            raise LogError("a column of vectors has rows without any.")
        return _numbers(column.flatten(), kind.value_type).reshape(len(column), -1)
    if not _is_time(kind):
        return np.asarray(column.cast(pyarrow.float64()).to_numpy(zero_copy_only=False), float)
    ticks = column.cast(pyarrow.int64())
    missing = np.asarray(ticks.is_null().to_numpy(zero_copy_only=False))
    # Integers: nanoseconds since 1970 have more digits than a float.
    counts = np.asarray(ticks.fill_null(0).to_numpy(zero_copy_only=False), np.int64)
    first = counts[missing.argmin()] if pyarrow.types.is_timestamp(kind) and len(counts) else 0
    return np.where(missing, np.nan, (counts - first) * {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit])


def size_of(stream: BinaryIO, metadata: Any, columns: Collection[str], groups: Iterable[int] | None = None) -> int:
    """Bytes that some columns take in memory.

    Args:
        stream: The file.
        metadata: Its footer, as the library reads it.
        columns: Names of the columns.
        groups: Numbers of the row groups, all by default.

    Raises:
        LogError: A header is none.
    """
    chosen = range(metadata.num_row_groups) if groups is None else groups
    rows = [metadata.row_group(k) for k in chosen]
    chunks = [group.column(k) for group in rows for k in range(group.num_columns)]
    # A vector's path is that of its innermost part, `action.list.element`.
    used = [each for each in chunks if any(f"{each.path_in_schema}.".startswith(f"{name}.") for name in columns)]
    return sum(_chunk_size(stream, each) for each in used)


def _chunk_size(stream: BinaryIO, chunk: Any) -> int:
    """Bytes of all pages of a column in a row group."""
    offsets = chunk.data_page_offset, chunk.dictionary_page_offset or 0
    size, at = 0, min(offset for offset in offsets if offset)
    end = at + chunk.total_compressed_size
    while at < end:
        stream.seek(at)
        header = _struct(stream)
        values = sum(header[k].get(1, 0) for k in COUNTED if k in header)
        size += max(NUMBER * values, header.get(UNPACKED, 0))
        at = stream.tell() + max(0, header.get(PACKED, 0))
    return size


def _struct(stream: BinaryIO) -> dict[int, Any]:
    """Fields of a structure by number: whole numbers and structures; True for all others."""
    fields, number = dict[int, Any](), 0
    while (head := _byte(stream)) and (kind := head & 15):
        number = number + (head >> 4) if head >> 4 else _whole(stream)
        if kind in (4, 5, 6):
            fields[number] = _whole(stream)
        elif kind == 12:
            fields[number] = _struct(stream)
        elif kind in (1, 2, 3, 7, 8):
            # Truth values are in the type itself; texts follow their length.
            stream.seek({3: 1, 7: 8}.get(kind, 0) if kind != 8 else _natural(stream), 1)
            fields[number] = True
        else:
            raise LogError(f"a page's header has a field of type {kind}")
    return fields


def _whole(stream: BinaryIO) -> int:
    """Whole number, whose sign is its last bit."""
    number = _natural(stream)
    return number >> 1 if number % 2 == 0 else -(number + 1 >> 1)


def _natural(stream: BinaryIO) -> int:
    """Natural number in pieces of seven bits, the last of which has no eighth."""
    number = 0
    for shift in range(0, 70, 7):
        piece = _byte(stream)
        number |= (piece & 127) << shift
        if piece < 128:
            return number
    raise LogError("a page's header has a number of more than ten bytes")


def _byte(stream: BinaryIO) -> int:
    if not (byte := stream.read(1)):
        raise LogError("a page's header is cut off")
    return byte[0]
