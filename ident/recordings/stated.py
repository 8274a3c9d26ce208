"""Servos and tracked bodies that a recording states beside its samples; and recordings as files, read back exactly."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from dataclasses import fields as data_fields
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np

from ident.annotations import Needs, NotNegative, Positive, typed
from ident.arguments import OF_BODIES, checked_deviations
from ident.errors import LogError
from ident.files.limits import made, value_of
from ident.files.readers import read_tables, write_channels
from ident.files.table import BASE, METADATA, TRUE, is_number, short
from ident.mechanism.body import Follower, is_rigid
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism
from ident.recordings.entries import Row
from ident.recordings.wrench import Sensor

GAINS = ("kp", "kv")
"""Keys of a joint's entry in a mapping that state the gains of its servo."""

SCALES = {"kp_std": "command", "torque_std": "torque"}
"""Keys that state how uncertain the scale of a joint's torque is, and the channel that each is about."""

Scale = Annotated[float, Needs("a number above 0 and at most 1", lambda x: 0 < x <= 1)]
"""Relative standard deviation of a scale, which is positive."""

TRACKED = "tracked."
"""Start of the keys of poses in a mapping. Samples of them may always be missing: markers are hidden now and then."""


@dataclass(frozen=True)
class Servo:
    """Law of a position-controlled joint, `τ = kp (u - q) - kv q̇`, with the recorded command u.

    A command is held until the next one, so that it acts half a sample later than it is logged on average.

    Attributes:
        kp: Stiffness, N m/rad or N/m.
        kv: Damping, N m s/rad or N s/m.
    """

    kp: Positive
    kv: NotNegative = 0.0


def servo_of(joint: str, entry: Mapping[str, Any]) -> dict[str, Servo]:
    """Servo that a joint's entry in a mapping states, by the joint's name; empty if it states none.

    Raises:
        LogError: A gain is not a number in its range, there is no command, or the torque is mapped as well.
    """
    given = {key: entry[key] for key in GAINS if key in entry}
    if "command" in entry and "torque" in entry:
        raise LogError(f"joints.{joint} maps a torque and a command, from which the torque would follow; map one.")
    if given and "command" not in entry:
        raise LogError(f"joints.{joint} states {', '.join(given)} of a servo; that needs its command as well.")
    return {joint: made(Servo, f"joints.{joint}", given)} if given else {}


def scale_of(joint: str, entry: Mapping[str, Any]) -> dict[str, float]:
    """Relative standard deviation of the scale of a joint's torque that its entry states; empty if it states none.

    Raises:
        LogError: It is no number above 0, or its channel is not mapped.
    """
    stated = [key for key in SCALES if key in entry]
    if without := [key for key in stated if SCALES[key] not in entry]:
        raise LogError(f"joints.{joint} states {without[0]}; that needs its {SCALES[without[0]]} as well.")
    scales = [value_of(f"joints.{joint}.{key}", entry[key], Scale) for key in stated]
    return {joint: scales[-1]} if scales else {}


def model_servo(mechanism: Mechanism, joint: str) -> Servo | None:
    """Servo of a joint by the model's position actuator; None without one, or if it acts through a gear."""
    actuators = [each for each in mechanism.drives.get(joint, NO_DRIVE).actuators if each.kind == "position"]
    alone = len(actuators) == 1 and actuators[0].gear == 1
    return Servo(actuators[0].kp, actuators[0].kv) if alone else None


Stream = TypeVar("Stream")


@typed()
@dataclass(frozen=True, eq=False)
class Tracker:
    """Frames of a tracked body, whose poses a recording has as `NAME_position` and `NAME_orientation`.

    Attributes:
        body: Name of the body.
        markers: Pose of the tracked frame in the body's frame (4, 4); None if it is unknown.
        frame: Pose of the tracker's frame in the base frame, of a moving base in the frame of its poses (4, 4); None if
            it is unknown. All trackers of unknown frames share one.
    """

    body: str
    markers: np.ndarray | None = None
    frame: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, T in (("markers", self.markers), ("frame", self.frame)):
            if T is not None and not (np.shape(T) == (4, 4) and is_rigid(T)):
                raise LogError(f"The tracker of '{self.body}' needs a rigid pose (4, 4) as {name}, got {np.shape(T)}.")


def untracked(streams: Mapping[str, Stream]) -> dict[str, Stream]:
    """Streams without those of tracked poses: these do not limit the common times."""
    return {key: stream for key, stream in streams.items() if not key.startswith(TRACKED)}


@dataclass(frozen=True)
class Stated:
    """Metadata `stated`: fields of a recording that are no mappings."""

    held: bool | None = None
    base_rpy_deg: tuple[float, ...] | None = None
    still: bool = False
    loaded: str = ""


KINDS: Mapping[str, Any] = {
    "sensors": Mapping[str, Sensor],
    "servos": Mapping[str, Servo],
    "scales": Mapping[str, Scale],
    "couplings": Mapping[str, Row],
    "followers": Mapping[str, Follower],
    "trackers": Mapping[str, Tracker],
    "stated": Stated,
}
"""Types of metadata that are more than JSON, by name."""


def save(path: Path, fields: Mapping[str, Any]) -> None:
    """Writes a `.npz` or `.csv` file.

    Args:
        path: File to write.
        fields: Fields of the recording, by name.

    Raises:
        LogError: A channel has a name that a file cannot hold.
    """
    measured, base = fields["measured"], fields["base"]
    for name in measured:
        if is_number(name) or not re.fullmatch(r"(?!true:|base:|time$|#)[^\s,.]([^,.\r\n]*[^\s,.])?", name):
            raise LogError(f"A channel's name cannot be {name!r}: in a file it is a word without commas and dots.")
    channels = {"time": fields["time"], **measured} | {f"{TRUE}{name}": x for name, x in fields["true"].items()}
    if base is not None:
        channels[BASE] = base.reshape(-1, 16)
    always = {name: fields[name] for name in ("units", "noise", "provenance")}
    others = {name: plain(fields[name]) for name in METADATA if name in fields and name not in always}
    stated = {name: fields[name] for name in ("held", "base_rpy_deg")} | {
        name: fields[name] or None for name in ("still", "loaded")
    }
    others["stated"] = {name: x for name, x in stated.items() if x is not None}
    write_channels(path, channels, always | {name: content for name, content in others.items() if content})


def plain(value: Any) -> Any:
    """Data classes, arrays and sequences in JSON's types, without entries that are None."""
    if is_dataclass(value):
        return {each.name: plain(x) for each in data_fields(value) if (x := getattr(value, each.name)) is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(x) for key, x in value.items()}
    return list(map(plain, value)) if isinstance(value, list | tuple) else value


def load(path: Path, samples: int, *, limit: int) -> Iterator[dict[str, Any]]:
    """Reads a file piece by piece and yields the fields of a recording, by name.

    Args:
        path: A `.csv`, `.tsv`, `.txt` or `.npz` file.
        samples: Samples of each piece; the last one may have fewer.
        limit: Bytes that a piece of an archive may take in memory, as for `limits.check_size`.

    Raises:
        LogError: The file is missing or not a recording; raised when the faulty piece is read.
    """
    last = -np.inf
    for table in read_tables(path, samples, truth=True, limit=limit):
        if "time" not in table.cells:
            raise LogError(f"a recording needs a column 'time'; {table.available()}.")
        channels = table.channels()
        if not (increases := np.diff(channels["time"], prepend=last) > 0).all():
            raise LogError(f"{table.row(int(np.argmin(increases)))}, column 'time' needs to increase.")
        last = channels["time"][-1]
        yield _fields(channels, table.metadata)
    if last == -np.inf:
        raise LogError("a recording needs samples, it has none.")


def _fields(channels: dict[str, np.ndarray], metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a recording from the channels and the metadata of a file."""
    time, base = channels.pop("time"), channels.pop(BASE, None)
    true = {name.removeprefix(TRUE): x for name, x in channels.items() if name.startswith(TRUE)}
    measured = {name: x for name, x in channels.items() if not name.startswith(TRUE)}
    if base is not None and base.shape[1:] == (16,):
        base = base.reshape(-1, 4, 4)
    return {"time": time, "measured": measured, "true": true, "base": base} | annotations(metadata)


def annotations(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a recording other than channels from the metadata of a file."""
    out = {name: value_of(name, metadata[name], KINDS.get(name, Any)) for name in METADATA if name in metadata}
    for body, known in out.get("known_bodies", {}).items():
        checked_deviations(f"known.{short(body)}", known, OF_BODIES, LogError)
    return out | vars(out.pop("stated", Stated()))
