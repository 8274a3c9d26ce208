"""The mapping of a log: which of its columns hold what, in which units, as names or a TOML file tell."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.mechanism.tree import Tree
from ident.recordings import plates
from ident.recordings.entries import check_keys as _check_keys
from ident.recordings.entries import pose as _pose
from ident.recordings.entries import table as _entry
from ident.recordings.plates import Plate
from ident.recordings.table import short
from ident.recordings.wrench import GROUND, Sensor
from ident.tolerances import HUGE

KINDS = {
    "position": ("{}_position", "q_{}", "{}"),
    "velocity": ("{}_velocity", "dq_{}"),
    "acceleration": ("{}_acceleration", "ddq_{}"),
    "torque": ("{}_torque", "tau_{}"),
}
"""What a log may hold of a joint, and the names of the column that holds it."""

_DEG = np.pi / 180
_SQUARED = ("^2", "2", "²")
_ANGLE = {"rad": 1.0, "deg": _DEG}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORCE = {"N": 1.0, "kN": 1e3}
_MOMENT = {"N m": 1.0, "Nm": 1.0, "N mm": 1e-3, "Nmm": 1e-3, "kN m": 1e3, "kNm": 1e3}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "hinge position": _ANGLE,
    "hinge velocity": {f"{u}/s": f for u, f in _ANGLE.items()} | {"rpm": np.pi / 30},
    "hinge acceleration": {f"{u}/s{s}": f for u, f in _ANGLE.items() for s in _SQUARED},
    "hinge torque": _MOMENT,
    "slide position": _LENGTH,
    "slide velocity": {f"{u}/s": f for u, f in _LENGTH.items()},
    "slide acceleration": {f"{u}/s{s}": f for u, f in _LENGTH.items() for s in _SQUARED},
    "slide torque": _FORCE,
    "force": _FORCE,
    "torque": _MOMENT,
    "length": _LENGTH,
}
"""Units of every quantity, as factors to SI; the first is what a log without a mapping has."""


SETUP = {
    **dict.fromkeys(("delay", "clock", "origin", "gain"), 1.0),
    **dict.fromkeys(("rotation_deg", "gravity_deg", "zero_deg", "axis_deg"), _DEG),
}
"""What may be known of a set-up: s, 1, m, 1, and angles; factors to SI and radians."""

KNOWN = dict.fromkeys(("mass", "center", "inertia"), 1.0)
"""What may be known of bodies beforehand: relative to the model's, m, relative."""


@dataclass(frozen=True)
class Columns:
    """Columns that make one quantity.

    Attributes:
        names: Their names, "" for those that are missing.
        factor: Their unit as a factor to the SI's.
        unit: The SI's unit, "" unless a unit is stated.
    """

    names: tuple[str, ...]
    factor: float = 1.0
    unit: str = ""


@dataclass
class ColumnMapping:
    """Which columns hold what.

    Attributes:
        columns: Columns by `time`, `joints.NAME.KIND`, `wrenches.NAME.force`, `wrenches.NAME.torque`, and
            `base.position` and `base.quaternion`, or `base.pose`.
        sensors: Sensors of the wrenches by name.
        plates: Those of them that rest in the world, by name.
        held: Whether something holds the base, as for `Recording`.
        setup: Standard deviations of what is known of the set-up, as for `Recording`.
        known: How well φ of the model is known, as for `Recording`.
    """

    columns: dict[str, Columns] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)
    setup: dict[str, float] = field(default_factory=dict)
    known: dict[str, float] = field(default_factory=dict)
    plates: dict[str, Plate] = field(default_factory=dict)
    held: bool | None = None

    @property
    def has_base(self) -> bool:
        """Whether the base moves."""
        return any(key.startswith("base.") for key in self.columns)

    @property
    def used(self) -> set[str]:
        """Names of all columns that are mapped."""
        return {name for columns in self.columns.values() for name in columns.names}


def joint_kinds(tree: Tree) -> dict[str, str]:
    """Whether each joint is a `hinge` or a `slide`, by its name.

    Raises:
        LogError: One is a ball, which logs cannot hold.
    """
    bodies = [tree.bodies[i] for i in tree.moving]
    if balls := [body.joint for body in bodies if body.is_ball]:
        raise LogError(
            f"A log can hold hinges, slides and the pose of a moving base, but not the ball joint '{balls[0]}'; name "
            "the body it carries as the base (--base), and map its pose under [base]."
        )
    return {body.joint: "hinge" if body.twist[3:].any() else "slide" for body in bodies}


def read_mapping(path: Path, tree: Tree) -> ColumnMapping:
    """Reads a mapping file.

    Raises:
        LogError: The file is missing or malformed, or names what the mechanism does not have.
    """
    if not path.is_file():
        raise LogError(f"{path}: a mapping of columns is a TOML file that exists.")
    try:
        entries = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    # Not all are the parser's own: Python refuses numbers of thousands of digits, and deep nesting.
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path}: a mapping of columns needs to be TOML in UTF-8 ({error}).") from None
    try:
        return _mapping(entries, joint_kinds(tree), tree.names)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def check_no_column_twice(columns: Mapping[str, Columns]) -> None:
    """Refuses a column that would stand for two quantities."""
    users: dict[str, str] = {}
    for user, used in columns.items():
        for name in filter(None, used.names):
            if name in users:
                raise LogError(f"column '{name}' is mapped to {users[name]} and to {user}; it can be one only.")
            users[name] = user


def _mapping(entries: Mapping[str, Any], joints: Mapping[str, str], bodies: Sequence[str]) -> ColumnMapping:
    _check_keys("the mapping", entries, ("time", "joints", "wrenches", "base", "setup", "known"))
    mapping = ColumnMapping(setup=_deviations("setup", entries, SETUP), known=_deviations("known", entries, KNOWN))
    if "time" in entries:
        mapping.columns["time"] = _single("time", entries["time"], "time")
    of_joints = _entry("joints", entries.get("joints", {}))
    _check_keys("[joints]", of_joints, tuple(joints))
    for joint, quantities in of_joints.items():
        _check_keys(f"[joints.{joint}]", _entry(f"joints.{joint}", quantities), tuple(KINDS))
        for kind, entry in quantities.items():
            key = f"joints.{joint}.{kind}"
            mapping.columns[key] = _single(key, entry, f"{joints[joint]} {kind}")
    for name, entry in _entry("wrenches", entries.get("wrenches", {})).items():
        mapping.columns |= _wrench_columns(f"wrenches.{name}", _entry(f"wrenches.{name}", entry))
        if plate := plates.plate(name, entry, bodies):
            mapping.plates[name] = plate
        mapping.sensors[name] = _sensor(name, entry, bodies, plate)
    if "base" in entries:
        entry = _entry("base", entries["base"])
        _check_keys("[base]", entry, ("position", "quaternion", "unit", "held"))
        mapping.held = entry.get("held")
        if not isinstance(mapping.held, bool | None):
            raise LogError(f"base.held needs true or false, got {short(mapping.held)}.")
        if entry.keys() != {"held"}:
            length = _factor("base", entry, "unit", "length")
            mapping.columns["base.position"] = _several("base.position", entry.get("position"), 3, *length)
            mapping.columns["base.quaternion"] = _several("base.quaternion", entry.get("quaternion"), 4)
    check_no_column_twice(mapping.columns)
    return mapping


def _deviations(table: str, entries: Mapping[str, Any], factors: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations by what they are of; zero or false for what is exactly as stated."""
    entry = _entry(table, entries.get(table, {}))
    _check_keys(f"[{table}]", entry, tuple(factors))
    for key, value in entry.items():
        if value is not False and not (type(value) in (int, float) and 0 <= value < HUGE):
            raise LogError(f"{table}.{key} needs a standard deviation, zero or false, got {short(value)}.")
    return {key.removesuffix("_deg"): float(value) * factors[key] for key, value in entry.items()}


def _wrench_columns(where: str, entry: Mapping[str, Any]) -> dict[str, Columns]:
    keys = ("force", "torque", "unit", "torque_unit", "position", "quaternion", "rpy_deg", "body", "applied_to_link")
    _check_keys(f"[{where}]", entry, (*keys, *plates.KEYS))
    columns = {
        key: _several(key, entry.get(kind, ["", "", ""]), 3, *_factor(where, entry, unit, kind), gaps=True)
        for key, kind, unit in ((f"{where}.force", "force", "unit"), (f"{where}.torque", "torque", "torque_unit"))
    }
    if "point" in entry:
        length, point = _factor(where, entry, "point_unit", "length"), plates.columns_of_point(where, entry)
        columns[f"{where}.point"] = _several(f"{where}.point", point, 3, *length, gaps=True)
    if "free_moment" in entry:
        moment, key = _factor(where, entry, "torque_unit", "torque"), f"{where}.free_moment"
        columns[key] = _several(key, entry["free_moment"], 3, *moment, gaps=True)
    if not any(name for several in columns.values() for name in several.names):
        raise LogError(f"[{where}] needs at least one column under force or torque.")
    return columns


def _sensor(name: str, entry: Mapping[str, Any], bodies: Sequence[str], plate: Plate | None) -> Sensor:
    where, body = f"wrenches.{name}", entry.get("body")
    if name == GROUND and body is not None:
        raise LogError(f"[{where}] needs no body: the ground acts at the base; got {short(body)}.")
    if name != GROUND and plate is None and body not in bodies:
        raise LogError(f"[{where}] needs a body, one of {', '.join(bodies)}; got {short(body)}.")
    applied = entry.get("applied_to_link", True)
    if not isinstance(applied, bool):
        raise LogError(f"{where}.applied_to_link needs true or false, got {short(applied)}.")
    return Sensor(body, _pose(where, entry), applied) if plate is None else plate.sensor(applied)


def _single(where: str, entry: Any, quantity: str) -> Columns:
    """One column, `"NAME"` or `{ column = "NAME", unit = "UNIT" }`."""
    if isinstance(entry, str):
        return Columns((entry.strip(),))
    _check_keys(where, _entry(where, entry), ("column", "unit"))
    name = entry.get("column")
    if not isinstance(name, str):
        raise LogError(f"{where} needs the name of a column, got {short(name)}.")
    return Columns((name.strip(),), *_factor(where, entry, "unit", quantity))


def _several(where: str, names: Any, size: int, factor: float = 1.0, unit: str = "", *, gaps: bool = False) -> Columns:
    """Columns of a vector; with gaps, "" stands for a missing one."""
    if not isinstance(names, list) or len(names) != size or not all(isinstance(name, str) for name in names):
        raise LogError(f"{where} needs a list of {size} columns, got {short(names)}.")
    if not gaps and not all(name.strip() for name in names):
        raise LogError(f"{where} needs {size} columns, none of them may be missing; got {short(names)}.")
    return Columns(tuple(name.strip() for name in names), factor, unit)


def _factor(where: str, entry: Mapping[str, Any], key: str, quantity: str) -> tuple[float, str]:
    choices = UNITS[quantity]
    if key not in entry:
        return 1.0, ""
    if not isinstance(entry[key], str) or entry[key] not in choices:
        raise LogError(f"{where}.{key} needs one of {', '.join(choices)}; got {short(entry[key])}.")
    return choices[entry[key]], next(iter(choices))
