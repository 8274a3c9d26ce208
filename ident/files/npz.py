"""Npz archives from any source, and tables in them whose members are read in parallel piece by piece."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from ident.errors import LogError
from ident.files.limits import LIMIT, NUMBER, check_size, parsed_json, reason
from ident.files.table import METADATA, TRUE, Memory, Table, short, vector_columns

EMPTY = 1_000_000
"""Bytes that an empty array may claim by its other dimensions."""

HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""Readers of the header of an array, by the version of numpy's format."""

MEASURED = "measured/"
"""Prefix of the names of members that hold channels."""


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


def write_npz(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Writes a recording's channels; arguments as for `write_csv`."""
    arrays = {"metadata": np.array(json.dumps(metadata)), **{_member(name): x for name, x in channels.items()}}
    # As `numpy.savez` does, whose older versions leave the archive open when the disk is full.
    with ZipFile(path, "w") as archive:
        for name, x in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asarray(x, order="C"), allow_pickle=False)


def npz_pieces(
    path: Path, samples: int, *, overlap: int = 0, truth: bool = False, limit: int = LIMIT
) -> Iterator[Table]:
    """Yields an archive as tables of at most `samples` samples.

    From an archive of `write_npz` they hold the channels, from any other all arrays of numbers.

    Args:
        path: The archive.
        samples: Samples of each piece.
        overlap: Samples that each piece repeats from the end of the one before.
        truth: True to read true values as well.
        limit: Bytes that a piece may take, as for `check_size`.

    Raises:
        LogError: The file is no archive, or a piece of it is too large; or a member is damaged or no channel, and the
            message names it.
    """
    with ExitStack() as streams:
        archive = streams.enter_context(opened(path))
        names = dict.fromkeys(name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy"))
        ours = any(name.startswith(MEASURED) for name in names) or names.keys() <= {"time", "metadata"}
        metadata = _metadata(path, archive, limit) if ours and "metadata" in names else {}
        if ours:
            kinds = (MEASURED, "true/") if truth else (MEASURED,)
            members = [_opened(archive, name, streams) for name in names if name == "time" or name.startswith(kinds)]
        else:
            members = [x for x in (_opened(archive, name, streams) for name in names) if x.holds_columns]
        for member in members:
            with reading(member.name):
                member.check(samples)
        length = _common_length(members)
        check_size(path, sum(NUMBER * math.prod((min(samples, length), *x.shape[1:])) for x in members), limit)
        memory, cells = Memory(), dict[str, np.ndarray]()
        for first in range(0, length, samples):
            kept = {name: x[len(x) - overlap :] for name, x in cells.items()} if overlap else {}
            cells = {}
            for member in members:
                cells |= member.columns(min(samples, length - first))
            cells = {name: np.append(kept[name], x) if name in kept else x for name, x in cells.items()}
            rows = range(first - overlap if kept else first, min(first + samples, length))
            yield Table(cells, rows, "sample", metadata, memory)


def _metadata(path: Path, archive: ZipFile, limit: int) -> dict[str, Any]:
    information = archive.getinfo("metadata.npy")
    check_size(path, information.file_size, limit)
    with reading("metadata"), member_of(archive, information) as stream:
        metadata = parsed_json(str(np.lib.format.read_array(stream, allow_pickle=False)))
        if not isinstance(metadata, dict) or any(not isinstance(metadata.get(k, t()), t) for k, t in METADATA.items()):
            raise LogError(f"JSON objects named {', '.join(METADATA)} are needed, it holds {short(metadata)}")
    return metadata


def _common_length(members: Sequence["_Member"]) -> int:
    lengths = {member.name: member.shape[0] for member in members}
    shortest, longest = (by(lengths, key=lengths.__getitem__, default="") for by in (min, max))
    if len(set(lengths.values())) > 1:
        raise LogError(
            f"arrays need the same number of samples, '{shortest}' has {lengths[shortest]} and '{longest}' has "
            f"{lengths[longest]}."
        )
    return lengths.get(longest, 0)


@dataclass(frozen=True)
class _Member:
    """An array of an archive, read from its beginning to its end."""

    name: str
    stream: IO[bytes]
    size: int
    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype

    @property
    def holds_columns(self) -> bool:
        """True if these are real numbers, one or several for each sample."""
        return self.dtype.kind in "biuf" and len(self.shape) in (1, 2)

    def check(self, samples: int) -> None:
        """Refuses a member that holds no columns or cannot be read in pieces of `samples` samples."""
        if not self.holds_columns:
            raise LogError(f"a channel needs real numbers in one or two dimensions, it holds {self.dtype} {self.shape}")
        if math.prod(self.shape) * self.dtype.itemsize != self.size or min(self.shape) < 0:
            raise LogError(f"an array of {self.shape} {self.dtype} has another size than its {self.size} bytes")
        if self.by_columns and samples < self.shape[0]:
            raise LogError("an array in Fortran order is not read in pieces; load it whole, and save it anew")

    def columns(self, rows: int) -> dict[str, np.ndarray]:
        """The next samples by name (rows,), vectors and quaternions split into components."""
        true = self.name.startswith("true/")
        name = self.name.replace("true/", TRUE, 1) if true else self.name.removeprefix(MEASURED)
        return vector_columns(name, np.asarray(self.read(rows), float))

    def read(self, rows: int) -> np.ndarray:
        """The next samples (rows,) or (rows, d)."""
        shape = (rows, *self.shape[1:])
        size = math.prod(shape) * self.dtype.itemsize
        with reading(self.name):
            data = self.stream.read(size)
            if len(data) < size:
                raise LogError(f"it ends {size - len(data)} bytes early")
        return np.frombuffer(data, self.dtype).reshape(shape, order="F" if self.by_columns else "C")


def _opened(archive: ZipFile, name: str, streams: ExitStack) -> _Member:
    """A member of an archive, opened after its header."""
    with reading(name):
        information = archive.getinfo(f"{name}.npy")
        stream = streams.enter_context(member_of(archive, information))
        version = np.lib.format.read_magic(stream)
        if version not in HEADERS:
            raise LogError(f"a channel has a header of version 1 or 2, it has version {version[0]}")
        shape, by_columns, dtype = HEADERS[version](stream)
        return _Member(name, stream, information.file_size - stream.tell(), shape, by_columns, dtype)


def _member(channel: str) -> str:
    """Name of the member that holds a channel."""
    if channel.startswith(TRUE):
        return f"true/{channel.removeprefix(TRUE)}"
    return channel if channel == "time" else f"{MEASURED}{channel}"
