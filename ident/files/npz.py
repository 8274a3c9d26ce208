"""Npz archives from any source: damaged, pickled or too large content is refused in one sentence."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from ident.errors import LogError
from ident.files.limits import LIMIT, NUMBER, check_size, reason

EMPTY = 1_000_000
"""Bytes that an empty array may claim by its other dimensions."""


def arrays(path: Path, limit: int = LIMIT) -> dict[str, np.ndarray]:
    """All arrays of an archive by name, which take at most `limit` bytes in memory.

    Raises:
        LogError: The file is no archive or too large, or a member is damaged or no array; the message names the member.
    """
    with opened(path) as archive:
        members = {m.filename.removesuffix(".npy"): m for m in archive.infolist() if m.filename.endswith(".npy")}
        check_size(path, sum(m.file_size for m in members.values()), limit)
        unpacked = {name: _array(archive, name, m) for name, m in members.items()}
    check_size(path, sum(NUMBER * x.size for x in unpacked.values()), limit)
    return unpacked


@contextmanager
def opened(path: Path) -> Iterator[ZipFile]:
    """Opens an archive for the duration of a block.

    Raises:
        LogError: The file is no archive.
    """
    # With its own file handle: `ZipFile` would leave that of a broken archive open.
    with path.open("rb") as stream:
        try:
            if stream.read(2) != b"PK":
                raise LogError("not a zip archive")
            archive = ZipFile(stream)
        except Exception as error:
            raise LogError(f"the file needs to be an npz archive of arrays ({reason(error)}).") from error
        with archive:
            yield archive


def member_of(archive: ZipFile, member: ZipInfo) -> IO[bytes]:
    """A stream of a member that unpacks no more bytes than were asked for.

    Raises:
        LogError: It is compressed by LZMA or bzip2, of which `zipfile` unpacks all that it has read.
    """
    if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
        raise LogError("it is compressed in another way than by numpy.savez_compressed")
    return archive.open(member)


@contextmanager
def reading(member: str) -> Iterator[None]:
    """Turns any error of a block into one that names the member that cannot be read.

    Raises:
        LogError: The block failed.
    """
    try:
        yield
    # Zip, its decompressors and numpy's parser of headers have a dozen classes of errors for damage.
    except Exception as error:
        raise LogError(f"member {member!r} cannot be read ({reason(error)}).") from error


def _array(archive: ZipFile, name: str, member: ZipInfo) -> np.ndarray:
    with reading(name), member_of(archive, member) as stream:
        array = np.lib.format.read_array(stream, allow_pickle=False)
        if math.prod(max(1, n) for n in array.shape) * array.itemsize > max(member.file_size, EMPTY):
            raise LogError(f"an array of {array.shape} is none")
        return array
