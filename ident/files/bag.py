"""ROS 1 and ROS 2 bags, including MCAP: joint states, wrenches and numbers, each topic at its own times.

Headers state sizes of chunks that need not be true, and the library unpacks a chunk whole: compressed chunks are first
unpacked in pieces, which are counted and dropped.
"""

import bz2
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ident.errors import LogError
from ident.files.limits import LIMIT, PIECE, check_size, library, undamaged
from ident.files.table import Table

BAG = b"#ROSBAG V2.0\n"
MCAP = b"\x89MCAP0\r\n"
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of the two formats, and of packed files."""

BAG_CHUNK = b"op=\x05"
MCAP_CHUNK = 6
"""Operation codes of chunks, from the two formats' specifications."""

JOINT_STATE = "sensor_msgs/msg/JointState"

UNITLESS = ("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float64")
"""Types of messages whose numbers have no defined unit; all others are in SI units by definition."""

MESSAGE = 1000
"""Bytes that a message takes in memory in addition to its serialized size, until its numbers are in columns."""


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


Message = tuple[int, Any]
"""Time in ns, and the message."""


def tables(path: Path, limit: int) -> list[Table]:
    """A table for each topic of a type in `COLUMNS`.

    Joints are columns `JOINT_position`, `JOINT_velocity` and `JOINT_torque`, or `TOPIC:JOINT_position` if several
    topics have the joint. Wrenches are `TOPIC_force.x` and so on, without the topic's first slash, arrays `TOPIC.0`.
    Times are the stamps in the messages, or if these have none the times of writing, in s from the earliest.

    Raises:
        LogError: The bag is damaged, too large, or has no such topic.
        InputError: The library is not installed.
    """
    with library("ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    # The library unpacks a chunk whole, whatever its topics.
    check_size(path, largest_chunk(path, limit), limit)
    with undamaged("a ROS bag"), AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        # The types as ROS defines them: the library generates code from those in the bag, without end if damaged.
        types = get_typestore(Stores.ROS2_HUMBLE if reader.is2 else Stores.ROS1_NOETIC)
        read = types.deserialize_cdr if reader.is2 else types.deserialize_ros1
        used = [each for each in reader.connections if each.msgtype in COLUMNS]
        if not used:
            there = ", ".join(f"{each.topic} ({each.msgtype})" for each in reader.connections) or "none"
            raise LogError(f"a bag needs a topic of {', '.join(COLUMNS)}; its topics are {there}.")
        check_size(path, max(_packed_messages(reader.readers, limit), default=0), limit)
        sent: dict[tuple[str, str], list[Message]] = defaultdict(list)
        size = 0
        for connection, written, data in reader.messages(connections=used):
            size += len(data) + MESSAGE
            check_size(path, size, limit)
            sent[connection.topic, connection.msgtype].append((written, read(data, connection.msgtype)))
        return _tables(sent)


def _packed_messages(readers: Sequence[Any], limit: int) -> Iterator[int]:
    """Unpacked sizes of messages that are packed one by one."""
    for reader in readers:
        if getattr(getattr(reader, "metadata", None), "compression_mode", "") == "message":
            for storage in reader.storages:
                for _, _, packed in storage.messages(storage.connections):
                    yield unpacked_size(packed, "zstd", limit)


def _tables(sent: Mapping[tuple[str, str], list[Message]]) -> list[Table]:
    times = {key: _times(messages) for key, messages in sent.items()}
    zero = min(int(time.min()) for time, _ in times.values())
    shared = _shared(sent)
    out = []
    for (topic, kind), messages in sent.items():
        time, note = times[topic, kind]
        order = np.argsort(time, kind="stable")
        name = topic.strip("/")
        columns = COLUMNS[kind]([messages[i][1] for i in order], name)
        if kind == JOINT_STATE:
            columns = {f"{name}:{column}" if column in shared else column: x for column, x in columns.items()}
        cells = {"time": (time[order] - zero) / 1e9, **columns}
        notes = [f"Topic {topic}: {note}"] if note else []
        units = {} if kind in UNITLESS else dict.fromkeys(cells, "SI")
        out.append(Table(cells, range(len(order)), f"message of {topic}", units=units, notes=notes))
    return out


def _times(messages: Sequence[Message]) -> tuple[np.ndarray, str]:
    """Times in ns (N,), from the messages' stamps if they have any, and a note on them."""
    written = np.array([time for time, _ in messages], np.int64)
    headers = [message.header for _, message in messages if hasattr(message, "header")]
    stamps = np.array([10**9 * header.stamp.sec + header.stamp.nanosec for header in headers], np.int64)
    if len(headers) < len(messages) or not stamps.any():
        return written, "its messages have no times, those of writing are used."
    frames = sorted({header.frame_id for header in headers if header.frame_id})
    return stamps, f"it is in the frame '{frames[0]}'." if len(frames) == 1 else ""


def _shared(sent: Mapping[tuple[str, str], list[Message]]) -> set[str]:
    """Names of joint columns that several topics have."""
    states = (messages for (_, kind), messages in sent.items() if kind == JOINT_STATE)
    topics = Counter(joint for own in states for joint in {joint for _, message in own for joint in message.name})
    several = [joint for joint, number in topics.items() if number > 1]
    return {f"{joint}_{quantity}" for joint in several for quantity in ("position", "velocity", "torque")}


def _joint_states(messages: Sequence[Any], name: str) -> dict[str, np.ndarray]:
    columns: dict[str, np.ndarray] = {}
    for i, message in enumerate(messages):
        for quantity, field in (("position", "position"), ("velocity", "velocity"), ("torque", "effort")):
            numbers = getattr(message, field)
            if len(numbers) not in (0, len(message.name)):
                raise LogError(
                    f"message {i} of {name} names {len(message.name)} joints and has {len(numbers)} {field}."
                )
            for joint, number in zip(message.name, numbers, strict=False):
                column = columns.setdefault(f"{joint}_{quantity}", np.full(len(messages), np.nan))
                column[i] = number
    return columns


def _wrenches(messages: Sequence[Any], name: str) -> dict[str, np.ndarray]:
    wrenches = [getattr(message, "wrench", message) for message in messages]
    return {
        f"{name}_{kind}.{axis}": np.array([getattr(getattr(wrench, kind), axis) for wrench in wrenches], float)
        for kind in ("force", "torque")
        for axis in "xyz"
    }


def _arrays(messages: Sequence[Any], name: str) -> dict[str, np.ndarray]:
    lengths = {len(message.data) for message in messages}
    if len(lengths) > 1:
        raise LogError(f"arrays of {name} need one length, they have {', '.join(map(str, sorted(lengths)))}.")
    return {f"{name}.{k}": x for k, x in enumerate(np.array([message.data for message in messages], float).T)}


def _numbers(messages: Sequence[Any], name: str) -> dict[str, np.ndarray]:
    return {name: np.array([message.data for message in messages], float)}


COLUMNS: Mapping[str, Callable[[Sequence[Any], str], dict[str, np.ndarray]]] = {
    JOINT_STATE: _joint_states,
    "geometry_msgs/msg/WrenchStamped": _wrenches,
    "geometry_msgs/msg/Wrench": _wrenches,
    "std_msgs/msg/Float64MultiArray": _arrays,
    "std_msgs/msg/Float64": _numbers,
}
"""Functions that turn messages into columns, by type of message."""
