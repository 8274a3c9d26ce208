"""Sizes of parquet columns in memory, from the headers of their pages.

The counts in the footer need not be true, and a few bytes repeat a number as often as they say. The library reads by
the headers of the pages, which are in Thrift's compact form: <https://github.com/apache/parquet-format>.
"""

from collections.abc import Collection, Iterable
from typing import Any, BinaryIO

from ident.errors import LogError
from ident.files.limits import NUMBER

UNPACKED, PACKED = 2, 3
"""Fields of a page's header: its sizes in bytes."""

COUNTED = (5, 7, 8)
"""Fields of a page's header of which the first field is a number of values: data, dictionaries, data of version 2."""


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
