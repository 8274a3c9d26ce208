"""Sizes that the chunks of ROS 1 bags and MCAP files have unpacked, as their headers state them."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

BAG = b"#ROSBAG V2.0\n"
MCAP = b"\x89MCAP0\r\n"

BAG_CHUNK = b"op=\x05"
MCAP_CHUNK = 6
"""Operation codes of chunks, from the two formats' specifications."""


def largest_chunk(path: Path) -> int:
    """Bytes of the largest unpacked chunk of a bag, which is held in memory whole; zero without chunks.

    Records that are cut off or damaged end the search: whoever reads the bag names them.

    Args:
        path: A `.bag` or `.mcap` file, or the folder of a ROS 2 bag with MCAP files.
    """
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    return max((size for file in files for size in _chunks(file)), default=0)


def _chunks(file: Path) -> Iterator[int]:
    """Yields the unpacked size of every chunk of a file."""
    with file.open("rb") as stream:
        start = stream.read(len(BAG))
        if start == BAG:
            yield from _of_bag(stream)
        elif start.startswith(MCAP):
            stream.seek(len(MCAP))
            yield from _of_mcap(stream)


def _of_bag(stream: BinaryIO) -> Iterator[int]:
    """Yields the sizes in the records of a ROS 1 bag: a header of fields, and data, each after its length."""
    while len(length := stream.read(4)) == 4:
        header = stream.read(_number(length))
        if BAG_CHUNK in header and (at := header.find(b"size=")) >= 0:
            yield _number(header[at + 5 : at + 9])
        stream.seek(_number(stream.read(4)), 1)


def _of_mcap(stream: BinaryIO) -> Iterator[int]:
    """Yields the sizes in the records of an MCAP file: a code, a length, and content of that length."""
    while len(head := stream.read(9)) == 9:
        code, length = struct.unpack("<BQ", head)
        end = stream.tell() + length
        if code == MCAP_CHUNK and len(times_and_size := stream.read(24)) == 24:
            yield _number(times_and_size[16:])
        if end >= 2**63:
            return
        stream.seek(end)


def _number(raw: bytes) -> int:
    """Little-endian unsigned number."""
    return int.from_bytes(raw, "little")
