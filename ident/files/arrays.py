"""Files of arrays and of named values: npz archives, MATLAB's arrays, and JSON lines."""

import json
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import repeat
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from ident.errors import LogError
from ident.files.csv_file import lines_of, opened_text
from ident.files.limits import LIMIT, NUMBER, PIECE, check_size, parsed_json, reason, undamaged
from ident.files.table import METADATA, SUFFIXES, TRUE, Table, short, vector_columns

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


MEASURED, TRUTH = "measured/", "true/"
"""Prefixes of the names of members that hold channels, and their true values."""


def arrays(path: Path, limit: int = LIMIT) -> dict[str, np.ndarray]:
    """All arrays of an archive by name, which take at most `limit` bytes in memory.

    Raises:
        LogError: The file is no archive or too large, or a member is damaged or no array; the message names the member.
    """
    with _opened(path) as archive:
        members = {m.filename.removesuffix(".npy"): m for m in archive.infolist() if m.filename.endswith(".npy")}
        check_size(path, sum(m.file_size for m in members.values()), limit)
        unpacked = {name: _array(archive, name, m) for name, m in members.items()}
    check_size(path, sum(NUMBER * x.size for x in unpacked.values()), limit)
    return unpacked


@contextmanager
def _opened(path: Path) -> Iterator[ZipFile]:
    """Opens an archive for the duration of a block.

    Raises:
        LogError: The file is no archive.
    """
    # With its own file handle: `ZipFile` would leave that of a broken archive open.
    with path.open("rb") as stream:
        with undamaged("an npz archive of arrays"):
            if stream.read(2) != b"PK":
                raise ValueError("not a zip archive")
            archive = ZipFile(stream)
        with archive:
            yield archive


@contextmanager
def _reading(member: str) -> Iterator[None]:
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
    with _reading(name):
        # Of all others `zipfile` unpacks more bytes than were asked for.
        if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise LogError("it is compressed in another way than by numpy.savez_compressed")
        with archive.open(member) as stream:
            array = np.lib.format.read_array(stream, allow_pickle=False)
        if math.prod(max(1, n) for n in array.shape) * array.itemsize > max(member.file_size, PIECE):
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


def npz_table(path: Path, limit: int, *, truth: bool = False) -> Table:
    """The table of an archive: of one of `write_npz` its channels, of any other all arrays of real numbers.

    Args:
        path: The archive.
        limit: Bytes that it may take, as for `check_size`.
        truth: True to read true values as well.

    Raises:
        LogError: The file is no archive or too large; or a member is damaged or no channel, and the message names it.
    """
    content = arrays(path, limit)
    ours = any(name.startswith(MEASURED) for name in content) or content.keys() <= {"time", "metadata"}
    metadata = _metadata(content.pop("metadata")) if ours and "metadata" in content else {}
    cells, lengths = dict[str, np.ndarray](), dict[str, int]()
    for name, x in content.items():
        if ours and not (name == "time" or name.startswith((MEASURED, TRUTH) if truth else MEASURED)):
            continue
        if x.dtype.kind in "biuf" and x.ndim in (1, 2):
            own = name.replace(TRUTH, TRUE, 1) if name.startswith(TRUTH) and ours else name.removeprefix(MEASURED)
            cells |= vector_columns(own, np.asarray(x, float))
            lengths[name] = len(x)
        elif ours:
            with _reading(name):
                raise LogError(f"a channel needs real numbers in one or two dimensions, it holds {x.dtype} {x.shape}")
    shortest, longest = (by(lengths, key=lengths.__getitem__, default="") for by in (min, max))
    if len(set(lengths.values())) > 1:
        raise LogError(
            f"arrays need the same number of samples, '{shortest}' has {lengths[shortest]} and '{longest}' has "
            f"{lengths[longest]}."
        )
    return Table(cells, range(lengths.get(longest, 0)), "sample", metadata)


def _metadata(stored: np.ndarray) -> dict[str, Any]:
    with _reading("metadata"):
        metadata = parsed_json(str(stored))
        if not isinstance(metadata, dict) or any(not isinstance(metadata.get(k, t()), t) for k, t in METADATA.items()):
            raise LogError(f"JSON objects named {', '.join(METADATA)} are needed, it holds {short(metadata)}")
    return metadata


def _member(channel: str) -> str:
    """Name of the member that holds a channel."""
    if channel.startswith(TRUE):
        return f"{TRUTH}{channel.removeprefix(TRUE)}"
    return channel if channel == "time" else f"{MEASURED}{channel}"
