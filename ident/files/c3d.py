"""C3D files: markers and quantities computed from them, force platforms and other analog channels.

Their layout is checked before a C++ library reads them, which crashes on damaged files. The header holds the starts of
parameters and data and the number of frames. Parameters are consecutive records, groups with a negative and their
entries with a positive number, each with the offset of the next.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.limits import NUMBER, SI, check_size, checked_rate, library, reason, undamaged
from ident.files.markers import Markers, check_labels
from ident.files.table import UNITS, Table

BLOCK = 512
"""Bytes of a block, the unit of positions in the file."""

KEY = 0x50
"""Second byte of every C3D file."""

ORDERS = {84: "<", 85: "<", 86: ">"}
"""Orders of an integer's bytes by the kind of processor: Intel's, DEC's and MIPS's."""

TYPES = (-1, 1, 2, 4)
"""Types of entries: characters, bytes, integers and floats; the absolute value is their size in bytes."""

LOADED = 10.0
"""Least force into a plate for a meaningful centre of pressure, N."""


def check_layout(path: Path, limit: int) -> None:
    """Refuses a file whose sections are not where its header says, or that is truncated.

    Args:
        path: The file.
        limit: Bytes that it may take in memory, as for `check_size`.

    Raises:
        LogError: It is damaged or no C3D file.
    """
    content = path.read_bytes()
    start = BLOCK * (content[0] - 1) if content else 0
    if len(content) < BLOCK or content[1] != KEY or start < BLOCK or len(content) < start + 4:
        raise _damaged("it has no header of one, or ends before its parameters")
    if (order := ORDERS.get(content[start + 3])) is None:
        raise _damaged(f"its processor is of no known kind, {content[start + 3]}")
    end = start + BLOCK * content[start + 2]
    if not start + 4 < end <= len(content):
        raise _damaged("it ends before its parameters do")
    _check_parameters(_Parameters(content[:end], order, start + 4))
    _check_data(path, content, order, limit)


@dataclass
class _Parameters:
    """The section of parameters, read from its beginning to its end."""

    content: bytes
    order: str
    place: int

    def take(self, kind: str, count: int = 1) -> list[int]:
        """The next integers of a numpy type."""
        size = np.dtype(kind).itemsize * count
        if self.place + size > len(self.content):
            raise _damaged("its parameters go beyond their section")
        numbers = np.frombuffer(self.content, f"{self.order}{kind}", count, self.place)
        self.place += size
        return [int(x) for x in numbers]


def _check_parameters(section: _Parameters) -> None:
    """Checks all records of the section."""
    groups, owners = set(), set()
    while section.place + 2 <= len(section.content):
        (length,), (number,) = section.take("i1"), section.take("i1")
        if length == 0 or number == 0:
            break
        name = bytes(section.take("u1", abs(length)))
        if not all(32 < character < 127 for character in name):
            raise _damaged(f"its parameters have the name {name!r}")
        way_from = section.place
        (way,) = section.take("u2")
        if number < 0:
            groups.add(-number)
        else:
            owners.add(number)
            (kind,) = section.take("i1")
            dimensions = section.take("u1", section.take("u1")[0])
            if kind not in TYPES or len(dimensions) > 7:
                raise _damaged(f"its parameter {name.decode()} is of no known type")
            section.take("u1", abs(kind) * math.prod(dimensions))
        section.take("u1", section.take("u1")[0])
        if way == 0:
            break
        if section.place > way_from + way:
            raise _damaged(f"its parameter {name.decode()} goes into the next one")
        section.place = way_from + way
    if not groups or not owners <= groups:
        raise _damaged("its parameters lack the groups they are in")


def _check_data(path: Path, content: bytes, order: str, limit: int) -> None:
    """Refuses a file with fewer frames than its header states."""
    points, analog, first, last = (int(x) for x in np.frombuffer(content, f"{order}u2", 4, 2))
    (start,) = np.frombuffer(content, f"{order}u2", 1, 16)
    # The sign of the scale factor says if data are integers; all processors have it in the same bit.
    is_float = content[15 if order == "<" else 12] & 0x80
    frames, width = max(0, last - first + 1), (4 if is_float else 2) * (4 * points + analog)
    if not start > 1 or BLOCK * (int(start) - 1) + frames * width > len(content):
        raise _damaged(f"it ends before the {frames} frames that its header promises")
    check_size(path, NUMBER * frames * (4 * points + analog), limit)


def _damaged(what: str) -> LogError:
    return LogError(f"the file needs to be a whole C3D file, but {what}.")


COMPUTED = {
    "ANGLES": ("ANGLE_UNITS", "deg"),
    "FORCES": ("FORCE_UNITS", ""),
    "MOMENTS": ("MOMENT_UNITS", ""),
    "POWERS": ("POWER_UNITS", ""),
    "SCALARS": ("SCALAR_UNITS", ""),
}
"""Lists of points that are no positions: the entry of their unit, and its default."""


def tables(path: Path, limit: int) -> list[Table]:
    """A table of points at their rate, and one of force platforms and other channels at the analog rate.

    The wrench of platform k is in the laboratory's axes and about the laboratory's origin: `plateK_force.x`,
    `plateK_torque.x`; its centre of pressure is `plateK_point.x`, missing while the plate is unloaded. Points are
    `LABEL.x` and so on. Values are in SI units and radians if the file states the unit.

    Raises:
        LogError: The file is damaged, or lacks rates or labels.
        InputError: The library is not installed.
    """
    content = _content(path, limit)
    with undamaged("a C3D file"):
        return [table for table in (_points(content), _analog(content)) if table is not None]


def markers(path: Path, limit: int) -> Markers:
    """Positions of the labelled points, without computed quantities; raises as `tables`."""
    content = _content(path, limit)
    with undamaged("a C3D file"):
        rate, labelled = _labelled(content)
        computed = {label for kind in COMPUTED for label in _strings(content["parameters"]["POINT"], kind)}
        unit = _unit(content["parameters"]["POINT"], "UNITS", "m")
        if unit not in UNITS["length"]:
            raise LogError(f"a C3D file needs markers in a unit of length, got '{unit}'.")
        kept = tuple(label for label in labelled if label not in computed)
        frames = content["data"]["points"].shape[2]
        positions = np.reshape([UNITS["length"][unit] * labelled[label] for label in kept], (len(kept), frames, 3))
        return Markers(np.arange(frames) / rate, kept, positions.swapaxes(0, 1))


def _content(path: Path, limit: int) -> Any:
    """Content of a file as `ezc3d` returns it."""
    with library("c3d"):
        import ezc3d
    check_layout(path, limit)
    with undamaged("a C3D file"):
        try:
            return ezc3d.c3d(str(path), extract_forceplat_data=True)
        # Entries on platforms may be incomplete or of a type that the library does not know.
        except (ValueError, RuntimeError) as error:
            content = ezc3d.c3d(str(path))
            content["data"]["platform"] = []
            content["data"]["without_platforms"] = f"Force platforms cannot be read ({reason(error)})."
            return content


def _labelled(content: Any) -> tuple[float, dict[str, np.ndarray]]:
    """Rate of the points in Hz, and values by label (N, 3); points without labels are left out."""
    group = content["parameters"]["POINT"]
    labels, points = _strings(group, "LABELS"), content["data"]["points"][:3]
    if len(labels) < points.shape[1]:
        raise LogError(f"a C3D file needs a label for each of {points.shape[1]} points, it has {len(labels)}.")
    rate = checked_rate(_scalar(group, "RATE"), "the rate of a C3D file's points")
    named = [(label, points[:, k].T) for k, label in enumerate(labels[: points.shape[1]]) if label.strip("* ")]
    check_labels([label for label, _ in named])
    return rate, dict(named)


def _points(content: Any) -> Table | None:
    if not content["data"]["points"].size:
        return None
    rate, labelled = _labelled(content)
    group = content["parameters"]["POINT"]
    unit_of = dict.fromkeys(labelled, _unit(group, "UNITS", ""))
    for kind, (entry, otherwise) in COMPUTED.items():
        unit_of |= dict.fromkeys(_strings(group, kind), _unit(group, entry, otherwise))
    cells: dict[str, np.ndarray] = {}
    units: dict[str, str] = {"time": "SI"}
    for label, x in labelled.items():
        names = [f"{label}.{axis}" for axis in "xyz"]
        cells |= dict(zip(names, SI.get(unit_of[label], 1.0) * x.T, strict=True))
        units |= dict.fromkeys(names, "SI" if unit_of[label] in SI else "")
    return _timed(rate, cells, units, "frame")


def _analog(content: Any) -> Table | None:
    analog = content["data"]["analogs"][0]
    if not analog.size:
        return None
    group = content["parameters"]["ANALOG"]
    rate = checked_rate(_scalar(group, "RATE"), "the analog rate of a C3D file")
    cells: dict[str, np.ndarray] = {}
    notes = [content["data"]["without_platforms"]] if "without_platforms" in content["data"] else []
    for k, platform in enumerate(content["data"]["platform"], start=1):
        wrench, note = _platform(f"plate{k}", platform)
        cells |= wrench
        notes.append(note)
    units = dict.fromkeys(cells, "SI")
    platforms = content["parameters"].get("FORCE_PLATFORM", {}) if content["data"]["platform"] else {}
    in_platforms = {int(k) - 1 for k in np.ravel(_values(platforms, "CHANNEL"))}
    labels, stated = _strings(group, "LABELS"), _strings(group, "UNITS")
    for k, label in enumerate(labels[: len(analog)]):
        if k not in in_platforms and label and label not in cells:
            unit = stated[k] if k < len(stated) else ""
            cells[label], units[label] = SI.get(unit, 1.0) * analog[k], "SI" if unit in SI else ""
    return _timed(rate, cells, units, "analog sample", notes)


def _platform(name: str, platform: Mapping[str, Any]) -> tuple[dict[str, np.ndarray], str]:
    """Wrench of a platform in SI units, in the laboratory's axes about its origin, and a note on it."""
    units = [platform[f"unit_{what}"] for what in ("force", "moment", "position")]
    if not all(unit in SI for unit in units):
        raise LogError(f"force platforms need known units of force, moment and length, got {', '.join(units)}.")
    newton, newton_metre, metre = (SI[unit] for unit in units)
    force, corners = newton * platform["force"], metre * platform["corners"]
    torque = newton_metre * platform["moment"] + np.cross(corners.mean(axis=1), force, axis=0)
    normal = np.cross(corners[:, 0] - corners[:, 1], corners[:, 0] - corners[:, 3])
    length = np.linalg.norm(normal)
    if not length > 0:
        raise LogError(f"force platforms need four corners, those of {name} are in one line.")
    unloaded = np.abs(normal @ force) < LOADED * length
    point = np.where(unloaded, np.nan, metre * platform["center_of_pressure"])
    cells = {
        f"{name}_{what}.{axis}": column
        for what, x in (("force", force), ("torque", torque), ("point", point))
        for axis, column in zip("xyz", x, strict=True)
    }
    there, mean = (", ".join(f"{x:.3g}" for x in row) for row in (corners.mean(axis=1), force.mean(axis=1)))
    return cells, (
        f"Force platform '{name}' has its centre at ({there}) m of the laboratory; its mean force is ({mean}) N in the "
        "laboratory's axes, its torque is about the laboratory's origin."
    )


def _timed(
    rate: float, cells: Mapping[str, np.ndarray], units: Mapping[str, str], word: str, notes: Sequence[str] = ()
) -> Table | None:
    if not cells:
        return None
    samples = len(next(iter(cells.values())))
    return Table({"time": np.arange(samples) / rate, **cells}, range(samples), word, units=units, notes=notes)


def _values(group: Mapping[str, Any], entry: str) -> Any:
    return group[entry]["value"] if entry in group else []


def _strings(group: Mapping[str, Any], entry: str) -> list[str]:
    """Texts of an entry and of its continuations: LABELS, LABELS2, LABELS3."""
    entries = [entry, *(f"{entry}{k}" for k in range(2, 100) if f"{entry}{k}" in group)]
    return [str(text).strip() for each in entries for text in _values(group, each)]


def _unit(group: Mapping[str, Any], entry: str, otherwise: str) -> str:
    return next(iter(_strings(group, entry)), "") or otherwise


def _scalar(group: Mapping[str, Any], entry: str) -> float:
    values = np.ravel(_values(group, entry))
    return float(values[0]) if len(values) else np.nan
