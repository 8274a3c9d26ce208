"""Settings of markers from a TOML file: their sites or positions, their weights, and bodies that share a scale factor.

unit = "mm"                  # of a table that states none
up = "y"                     # axis of the laboratory that points up; by default the model's: z, in OpenSim y
[markers.KNEE]               # a label
site = "knee"                # a site of the model; by default that with the label's name
weight = 0.5                 # of its squared distance; by default 1
[markers.HEEL]
body = "foot"                # instead of a site: a position on a body
position = [-0.05, 0, -0.04] # m
[scale]
groups = [["left_thigh", "right_thigh"]]
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.files.column import UNITS
from ident.files.limits import toml
from ident.files.table import short
from ident.tolerances import HUGE

UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
}
"""Rotations from a laboratory whose vertical axis is the key to one with Z upwards."""


@dataclass(frozen=True)
class Place:
    """Site or position of a marker on the model.

    Attributes:
        site: Name of a site, "" if a body is named.
        body: Name of a body, "" if a site is named.
        position: Position in the body's frame, m.
        weight: Weight of the squared distance.
    """

    site: str
    body: str = ""
    position: tuple[float, ...] = ()
    weight: float = 1.0


@dataclass(frozen=True)
class Settings:
    """Settings of a file.

    Attributes:
        unit: Unit of a table, None if not stated.
        up: Axis of the laboratory that points up, None if not stated.
        places: Sites or positions of markers, by label.
        groups: Names of bodies that share a scale factor.
    """

    unit: str | None = None
    up: str | None = None
    places: Mapping[str, Place] = field(default_factory=dict)
    groups: tuple[tuple[str, ...], ...] = ()


def read_settings(path: Path) -> Settings:
    """Reads a file of settings.

    Raises:
        InputError: The file is missing or malformed; the message names the entry.
    """
    entries = toml(path, "settings of markers need")
    try:
        return _settings(entries)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _settings(entries: Mapping[str, Any]) -> Settings:
    _check("the file", entries, ("unit", "up", "markers", "scale"))
    unit, up = entries.get("unit"), entries.get("up")
    if unit is not None and unit not in list(UNITS["length"]):
        raise InputError(f"unit is one of {', '.join(UNITS['length'])}, got {short(unit)}.")
    if up is not None and up not in list(UP):
        raise InputError(f"up is the axis that points up, x, y or z, got {short(up)}.")
    markers = _check("[markers]", entries.get("markers", {}))
    scale = _check("[scale]", entries.get("scale", {}), ("groups",))
    groups = scale.get("groups", [])
    if not isinstance(groups, list) or not all(isinstance(group, list) and _names(group) for group in groups):
        raise InputError(f"scale.groups is a list of lists of bodies, got {short(groups)}.")
    places = {label: _place(f"markers.{label}", label, entry) for label, entry in markers.items()}
    return Settings(unit, up, places, tuple(map(tuple, groups)))


def _place(where: str, label: str, entry: Any) -> Place:
    _check(f"[{where}]", entry, ("site", "body", "position", "weight"))
    weight = entry.get("weight", 1.0)
    if type(weight) not in (int, float) or not 0 < weight < HUGE:
        raise InputError(f"{where}.weight needs a positive number, got {short(weight)}.")
    if "body" not in entry and "position" not in entry:
        site = entry.get("site", label)
        if not _names([site]):
            raise InputError(f"{where}.site needs the name of a site, got {short(site)}.")
        return Place(site, weight=float(weight))
    if "site" in entry:
        raise InputError(f"[{where}] needs a site, or a body with a position, got both.")
    body, position = entry.get("body"), entry.get("position")
    numbers = isinstance(position, list) and all(type(x) in (int, float) and abs(x) < HUGE for x in position)
    if not _names([body]) or not numbers or len(position) != 3:
        raise InputError(f"[{where}] needs the name of a body and a position [x, y, z] in m on it.")
    return Place("", body, tuple(map(float, position)), float(weight))


def _names(values: list[Any]) -> bool:
    return all(isinstance(value, str) and value for value in values)


def _check(what: str, entry: Any, keys: tuple[str, ...] | None = None) -> Mapping[str, Any]:
    """The entry, checked to be a table without other keys than these."""
    if not isinstance(entry, dict):
        raise InputError(f"{what} needs to be a table, got {short(entry)}.")
    for key in entry:
        if keys is not None and key not in keys:
            raise InputError(f"{what} takes {', '.join(keys)}, got '{short(key)}'.")
    return entry
