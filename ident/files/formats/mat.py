"""MATLAB's `.mat` files up to version 7: arrays with the same number of samples, also in structures."""

import math
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.limits import NUMBER, PIECE, check_size, undamaged
from ident.files.table import Table, vector_columns

COMPRESSED = 15
"""Type of a compressed element, of version 7."""


def tables(path: Path, limit: int) -> list[Table]:
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
