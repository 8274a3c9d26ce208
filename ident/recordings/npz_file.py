"""Recordings as arrays: an npz archive, whose members are read side by side, some samples at a time."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

import numpy as np

from ident.errors import LogError
from ident.recordings.csv_file import TRUE
from ident.recordings.npz import LIMIT, NUMBER, check_size, member_of, opened, reading

HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""What reads the header of an array, by the version of numpy's format."""


def write_npz(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Writes a recording's channels; arguments as for `write_csv`."""
    arrays = {"metadata": np.array(json.dumps(metadata)), **{_member(name): x for name, x in channels.items()}}
    # As `numpy.savez` does, whose older versions leave the archive open when the disk is full.
    with ZipFile(path, "w") as archive:
        for name, x in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asarray(x, order="C"), allow_pickle=False)


def npz_pieces(path: Path, samples: int, limit: int = LIMIT) -> Iterator[tuple[dict[str, np.ndarray], dict[str, Any]]]:
    """Channels of at most so many samples at a time, each time with the metadata.

    Args:
        path: The archive.
        samples: Samples of each piece.
        limit: Bytes that a piece may take, as for `check_size`.

    Raises:
        LogError: The file is no archive, or a piece of it is too large; or a member is missing, damaged or no
            channel, the message names it.
    """
    with ExitStack() as streams:
        archive = streams.enter_context(opened(path))
        names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]
        for name in ("time", "metadata"):
            if name not in names:
                raise LogError(f"a recording needs a member '{name}'; it has {', '.join(names) or 'none'}.")
        text = archive.getinfo("metadata.npy")
        check_size(path, text.file_size, limit)
        with reading("metadata"), member_of(archive, text) as stream:
            metadata = json.loads(str(np.lib.format.read_array(stream, allow_pickle=False)))
            if not isinstance(metadata, dict):
                raise LogError(f"a JSON object is needed, it holds {metadata!r}")
        names = ["time", *(name for name in names if name.startswith(("measured/", "true/")))]
        members = [_opened(archive, name, streams) for name in names]
        length = members[0].shape[0]
        for member in members:
            with reading(member.name):
                member.check(length, samples)
        check_size(path, sum(NUMBER * math.prod((min(samples, length), *x.shape[1:])) for x in members), limit)
        for first in range(0, length, samples):
            yield {_channel(x.name): x.read(min(samples, length - first)) for x in members}, metadata


@dataclass(frozen=True)
class _Member:
    """An array of an archive, read from its beginning to its end."""

    name: str
    stream: IO[bytes]
    size: int
    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype

    def check(self, length: int, samples: int) -> None:
        """Refuses what is no channel of so many samples, and what cannot be read in pieces."""
        if self.dtype.kind not in "biuf":
            raise LogError(f"a channel needs real numbers, it holds {self.dtype}")
        if self.shape[0] != length:
            raise LogError(f"the times are {length} samples, it has {self.shape[0]}")
        if math.prod(self.shape) * self.dtype.itemsize != self.size:
            raise LogError(f"an array of {self.shape} {self.dtype} has another size than its {self.size} bytes")
        if self.by_columns and samples < length:
            raise LogError("an array in Fortran order is not read in pieces; load it whole, and save it anew")

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
    """A member of an archive after its header."""
    with reading(name):
        information = archive.getinfo(f"{name}.npy")
        stream = streams.enter_context(member_of(archive, information))
        version = np.lib.format.read_magic(stream)
        if version not in HEADERS:
            raise LogError(f"a channel has a header of version 1 or 2, it has version {version[0]}")
        shape, by_columns, dtype = HEADERS[version](stream)
        if len(shape) not in (1, 2):
            raise LogError(f"a channel has one or two dimensions, it has {len(shape)}")
        return _Member(name, stream, information.file_size - stream.tell(), shape, by_columns, dtype)


def _member(channel: str) -> str:
    """Name of the member that holds a channel."""
    if channel.startswith(TRUE):
        return f"true/{channel.removeprefix(TRUE)}"
    return channel if channel == "time" else f"measured/{channel}"


def _channel(member: str) -> str:
    """Name of the channel that a member holds."""
    return member.replace("true/", TRUE, 1) if member.startswith("true/") else member.removeprefix("measured/")
