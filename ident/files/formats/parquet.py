"""Parquet files: columns of numbers, times and vectors."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ident.errors import LogError
from ident.files.limits import NUMBER, check_size, library, undamaged
from ident.files.table import Table, vector_columns

UNPACKED, PACKED = 2, 3
"""Fields of a page's header: its sizes in bytes."""

COUNTED = (5, 7, 8)
"""Fields of a page's header of which the first field is a number of values: data, dictionaries, data of version 2."""


def tables(path: Path, limit: int) -> list[Table]:
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
