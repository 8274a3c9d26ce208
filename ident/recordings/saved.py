"""Recordings as files with columns named like channels, written and read back exactly."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from dataclasses import fields as data_fields
from pathlib import Path
from typing import Any

import numpy as np

from ident.arguments import OF_BODIES, checked_deviations
from ident.errors import LogError
from ident.files.readers import read_tables, write_channels
from ident.files.schema import value_of
from ident.files.table import BASE, METADATA, TRUE, is_number, short
from ident.mechanism.body import Follower
from ident.recordings.columns.entries import Row
from ident.recordings.stated import Scale, Servo, Tracker
from ident.recordings.wrench import Sensor


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
        increases = np.diff(channels["time"], prepend=last) > 0
        if not increases.all():
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
