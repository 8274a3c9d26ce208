"""Parquet files: columns of numbers, times and vectors."""

from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.formats.parquet_pages import size_of
from ident.files.formats.reading import library, undamaged
from ident.files.limits import NUMBER, check_size
from ident.files.table import Table, vector_columns


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
