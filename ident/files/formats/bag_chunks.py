"""Sizes that the chunks of ROS 1 bags and MCAP files, and packed files of ROS 2 bags, have unpacked.

Headers state a size that need not be true, and the library unpacks a chunk whole: compressed chunks are unpacked in
pieces, which are counted and dropped.
"""

import bz2
import struct
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

from ident.files.limits import LIMIT

BAG = b"#ROSBAG V2.0\n"
MCAP = b"\x89MCAP0\r\n"
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of the two formats, and of packed files."""

BAG_CHUNK = b"op=\x05"
MCAP_CHUNK = 6
"""Operation codes of chunks, from the two formats' specifications."""

PIECE = 1 << 16
"""Bytes that are unpacked at a time."""


def largest_chunk(path: Path, limit: int = LIMIT) -> int:
    """Bytes of the largest unpacked chunk or packed file of a bag, held in memory whole; zero without any.

    Records that are cut off or damaged end the search: whoever reads the bag names them.

    Args:
        path: A `.bag` or `.mcap` file, or the folder of a ROS 2 bag.
        limit: Bytes after which counting ends.
    """
    files = sorted(filter(Path.is_file, path.iterdir())) if path.is_dir() else [path]
    return max((size for file in files for size in _chunks(file, limit)), default=0)


def unpacked_size(packed: bytes, kind: str, limit: int) -> int:
    """Bytes that data of a kind of compression unpack to, counted up to the first beyond a limit.

    Data that are damaged or cut off count as far as they can be unpacked.
    """
    make = _decompressors().get(kind)
    if make is None:
        return len(packed)
    size = at = 0
    # Frames may follow one another.
    while at < len(packed) and size <= limit:
        frame = make()
        while not frame.eof and size <= limit:
            fed = packed[at : at + PIECE] if frame.needs_input else b""
            at += len(fed)
            try:
                piece = frame.decompress(fed, PIECE)
            # Each library has errors of its own.
            except Exception:
                return size
            if not (fed or piece) and (at >= len(packed) or not frame.needs_input):
                return size
            size += len(piece)
        at -= len(frame.unused_data or b"")
    return size


def _decompressors() -> Mapping[str, Any]:
    """Classes that unpack in pieces by the names of compressions in headers; those that `rosbags` needs are there."""
    try:
        zstd = import_module("compression.zstd")
    except ImportError:  # Before Python 3.14.
        zstd = import_module("backports.zstd")
    return {
        "bz2": bz2.BZ2Decompressor,
        "lz4": import_module("lz4.frame").LZ4FrameDecompressor,
        "zstd": zstd.ZstdDecompressor,
    }


def _chunks(file: Path, limit: int) -> Iterator[int]:
    """Yields the unpacked size of every chunk of a file."""
    with file.open("rb") as stream:
        start = stream.read(len(BAG))
        if start.startswith(ZSTD):
            yield unpacked_size(start + stream.read(), "zstd", limit)
        elif start == BAG:
            yield from _of_bag(stream, limit)
        elif start.startswith(MCAP):
            stream.seek(len(MCAP))
            yield from _of_mcap(stream, limit)


def _of_bag(stream: BinaryIO, limit: int) -> Iterator[int]:
    """Yields the sizes in the records of a ROS 1 bag: a header of fields, and data, each after its length."""
    while len(length := stream.read(4)) == 4:
        header = stream.read(_number(length))
        size = _number(stream.read(4))
        if BAG_CHUNK in header and (at := header.find(b"size=")) >= 0:
            yield _number(header[at + 5 : at + 9])
            for kind in ("bz2", "lz4"):
                if f"compression={kind}".encode() in header:
                    yield unpacked_size(packed := stream.read(size), kind, limit)
                    stream.seek(-len(packed), 1)
        stream.seek(size, 1)


def _of_mcap(stream: BinaryIO, limit: int) -> Iterator[int]:
    """Yields the sizes in the records of an MCAP file: a code, a length, and content of that length."""
    while len(head := stream.read(9)) == 9:
        code, length = struct.unpack("<BQ", head)
        end = stream.tell() + length
        if end >= 2**63:
            return
        # Two times, the size, a checksum, and the length of the name of the compression.
        if code == MCAP_CHUNK and len(fields := stream.read(32)) == 32:
            yield _number(fields[16:24])
            kind = stream.read(min(_number(fields[28:]), 64))
            if kind in (b"lz4", b"zstd"):
                yield unpacked_size(stream.read(_number(stream.read(8))), kind.decode(), limit)
        stream.seek(end)


def _number(raw: bytes) -> int:
    """Little-endian unsigned number."""
    return int.from_bytes(raw, "little")
