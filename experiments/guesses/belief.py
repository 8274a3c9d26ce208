"""Beliefs about a log: columns of quantities, each with its reasons and its certainty, and their text as a mapping."""

import json
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.log_contents import LogContents
from experiments.guesses.words import Words, unit_of, words
from ident.errors import InputError
from ident.files.atomic import replacing
from ident.files.csv_file import Layout
from ident.files.readers import name_of
from ident.files.table import BASE as POSES_OF_BASE
from ident.files.table import CURRENT, UNITS
from ident.mechanism.mechanism import Mechanism, plane_normal
from ident.recordings.mapping import joint_kinds

SURE, LIKELY, OPEN, DOUBTFUL = "sure", "likely", "open", "doubtful"
"""Certainty of a belief: sure, by an exact name or by unambiguous numbers; likely, by likeness; open, where nothing
states it; doubtful, so that it is written as a remark only."""

BASE, SETUP = "base", "setup"
"""Tables of a mapping with the poses of the base, and with standard deviations of the set-up."""

LISTS = ("force", "torque", "point", "free_moment", "position", "quaternion")
"""Lines of a group whose values are columns, perhaps with gains, or numbers in their place."""

ORDER = (
    *("held", "frame", "position", "rpy_deg", "body", "on", "among", "applied_to_link"),
    *("force", "quaternion", "unit", "point", "point_unit", "free_moment", "torque", "torque_unit", "origin"),
)
"""Order of the lines of a wrench, a pose or the set-up."""


UNIT_KEYS = {"force": "unit", "torque": "torque_unit"}
"""Keys of the units of forces and of moments."""


def named(likeness: float) -> tuple[str, str]:
    """Reason and certainty of what is named like something."""
    return ("named so", SURE) if likeness >= 0.99 else (f"named alike ({100 * likeness:.0f} %)", LIKELY)


@dataclass
class Quantity:
    """The column that probably holds one quantity of a joint.

    Attributes:
        joint: The joint.
        kind: The quantity, a key of `ident.files.table.KINDS`.
        column: The column.
        sure: Certainty.
        why: Reasons.
        unit: Its unit, "" for the file's or the SI unit.
        gain: Factor on the column; for a current in N m/A.
    """

    joint: str
    kind: str
    column: str
    sure: str
    why: list[str] = field(default_factory=list)
    unit: str = ""
    gain: float = 1.0

    @property
    def about(self) -> Words:
        """Words of the column's name."""
        return words(self.column)

    @property
    def is_current(self) -> bool:
        """True where the name of a torque column says that it is a motor current."""
        return self.about.kind == "current" or self.about.unit in CURRENT

    @property
    def value(self) -> Any:
        """Its entry in a mapping."""
        with_gain = self.gain != 1 or self.unit in CURRENT
        more = ({"unit": self.unit} if self.unit else {}) | ({"gain": self.gain} if with_gain else {})
        return {"column": self.column, **more} if more else self.column


@dataclass
class TableEntry:
    """A line in the table of a wrench or pose.

    Attributes:
        value: Its value.
        why: Reasons.
        sure: Certainty.
    """

    value: Any
    why: str
    sure: str = LIKELY


@dataclass
class ColumnGroup:
    """Columns that probably hold a wrench, or the poses of a ball joint or a base.

    Attributes:
        name: Name of the wrench, of the joint, or `base`.
        entries: Lines of its table by key.
        is_open: True for a wrench that may be the ground's, or of a sensor between two bodies.
        is_inner: True for the wrench of a sensor between two bodies, which is none of the mechanism with others.
        own_name: Name in the log, for a wrench that is open.
    """

    name: str
    entries: dict[str, TableEntry]
    is_open: bool = False
    is_inner: bool = False
    own_name: str = ""

    @property
    def is_doubtful(self) -> bool:
        """True where a line of a wrench is doubtful, or it has neither force nor torque, so that it stays a remark."""
        doubted = any(entry.sure == DOUBTFUL for entry in self.entries.values())
        return doubted or self.entries.keys().isdisjoint(("force", "torque"))

    @property
    def lines(self) -> list[tuple[str, TableEntry]]:
        """Its lines in their order in the file."""
        return [(key, self.entries[key]) for key in ORDER if key in self.entries]

    @property
    def columns(self) -> list[str]:
        """All its columns."""
        lists = (self.entries[key].value for key in LISTS if key in self.entries)
        own = (each["column"] if isinstance(each, dict) else each for names in lists for each in names)
        return [name for name in own if isinstance(name, str) and name]

    def turn(self, rotation: np.ndarray, frame: str, why: str, *, opposite: bool) -> None:
        """Sets the sign and the axes of a wrench, at right angles if they are to 3°."""
        if opposite:
            self.entries["applied_to_link"] = TableEntry(False, f"the opposite sign: {why}")
        if not np.array_equal(rotation, np.eye(3)):
            angles = Rotation.from_matrix(rotation).as_euler("xyz", degrees=True)
            near = 90 * np.round(angles / 90)
            angles = np.where(np.abs(angles - near) < 3, near, angles).round(1) + 0.0
            self.entries["rpy_deg"] = TableEntry(angles.tolist(), f"its axes in those of the {frame}: {why}")
            # A frame that is not turned states no angles.
            if "frame" in self.entries:
                self.entries["frame"] = TableEntry("plate", "axes other than the world's")
                self.entries["position"] = TableEntry([0, 0, 0], "the world's origin")


@dataclass
class Belief:
    """All beliefs about a log.

    Attributes:
        log: The log.
        mechanism: The mechanism.
        quantities: Quantities of joints by their keys in a mapping.
        groups: Wrenches by name.
        poses: Ball joints, a moving base and the set-up, by their tables in a mapping.
        open: Sentences on quantities that are ambiguous or missing.
        notes: Sentences on other observations.
        unused: Columns that are not assigned.
        by_size: Joints whose unit of angles was chosen by size, or because others have it.
        by_place: Joints whose columns are assigned only by their place in a series and by the model's predictions.
        undecided: Joints whose position a sentence of `open` is about.
        sign_undecided: True if a joint's sign is open, so that axes of wrenches cannot be checked.
        torques_undecided: True if a sentence of `open` asks which of several columns are the torques.
        complete: True if every joint has a position, or follows one that has.
    """

    log: LogContents
    mechanism: Mechanism
    quantities: dict[str, Quantity] = field(default_factory=dict)
    groups: dict[str, ColumnGroup] = field(default_factory=dict)
    poses: dict[str, ColumnGroup] = field(default_factory=dict)
    open: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    by_size: set[str] = field(default_factory=set)
    by_place: set[str] = field(default_factory=set)
    undecided: set[str] = field(default_factory=set)
    sign_undecided: bool = False
    torques_undecided: bool = False
    complete: bool = False

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Kind of each joint."""
        return joint_kinds(self.mechanism.tree)

    @cached_property
    def axes(self) -> list[str]:
        """Joints with one coordinate."""
        return [joint for joint, kind in self.kinds.items() if kind != "ball"]

    @property
    def moves(self) -> bool:
        """True if the log has poses of the base, which then nothing holds."""
        named = f"{POSES_OF_BASE}.0" in self.log.samples
        return named or (BASE in self.poses and "position" in self.poses[BASE].entries)

    @property
    def held(self) -> bool:
        """True if something holds the base."""
        return not (self.mechanism.tree.floats or self.moves)

    @property
    def flies(self) -> bool:
        """True if the joints move a held base freely in a plane."""
        return self.held and plane_normal(self.mechanism) is not None

    @property
    def can_predict(self) -> bool:
        """True if the model predicts wrenches and torques by angles alone."""
        moves = self.moves or any("position" in group.entries for group in self.poses.values())
        return self.mechanism.prior is not None and not moves and len(self.axes) == len(self.kinds)

    def of(self, kind: str) -> dict[str, Quantity]:
        """Quantities of one kind that are not doubtful, by joint."""
        return {x.joint: x for x in self.quantities.values() if x.kind == kind and x.column and x.sure != DOUBTFUL}

    def add(self, joint: str, kind: str, column: str, why: str, sure: str = LIKELY) -> None:
        """Adds a quantity, unless it is known."""
        self.quantities.setdefault(f"joints.{joint}.{kind}", Quantity(joint, kind, column, sure, [why]))

    def ask(self, sentence: str, joints: Collection[str] = ()) -> None:
        """Adds a question, perhaps on the positions of joints."""
        self.open.append(sentence)
        self.undecided |= set(joints)

    def ask_place(self, group: ColumnGroup, why: str) -> None:
        """Leaves a wrench a remark, with a question on the place where it is measured."""
        group.entries["body"] = TableEntry("?", "the body beyond the sensor", DOUBTFUL)
        self.ask(f"It is open where the wrench '{group.own_name}' is measured. {why}")
        self.rename(group)

    def rename(self, group: ColumnGroup) -> None:
        """Gives a wrench that is not the ground's its own name."""
        self.groups.pop(group.name)
        group.name, group.is_open = group.own_name, False
        self.groups[group.name] = group

    def set_unit(self, groups: Iterable[ColumnGroup], kind: str, ratio: float) -> bool:
        """Sets the unit of forces or moments by size, unless it is known, and returns True if it is not the SI unit.

        Args:
            groups: The wrenches.
            kind: `force` or `torque`.
            ratio: Size of the columns over what the model predicts in SI units.
        """
        key, choices = UNIT_KEYS[kind], UNITS[kind]
        sizes = {unit: ratio * choice for unit, choice in choices.items()}
        unit = min(sizes, key=lambda unit: abs(np.log(sizes[unit])))
        # Up to half way, as factors go, to the next unit, which is a thousand times as large.
        if not 1 / np.sqrt(1000) < sizes[unit] < np.sqrt(1000):
            self.notes.append(
                f"The {kind}s have {ratio:.2g} times the size in {next(iter(choices))} that the model predicts, "
                "which no other unit explains."
            )
            return False
        changed, why = False, f"in {unit} it has {sizes[unit]:.2g} times the size that the model predicts"
        for entries in (group.entries for group in groups):
            columns = [name for k in (kind, "free_moment") if k in entries for name in entries[k].value]
            if key not in entries and any(columns) and not self.log.states_unit(columns):
                entries[key] = TableEntry(unit, why)
                changed = choices[unit] != 1
        return changed

    @property
    def outer(self) -> dict[str, ColumnGroup]:
        """Wrenches by name that are no remarks, without those of sensors between two bodies."""
        return {name: group for name, group in self.groups.items() if not (group.is_inner or group.is_doubtful)}

    @property
    def columns(self) -> list[str]:
        """All assigned columns."""
        groups = (*self.groups.values(), *self.poses.values())
        return [x.column for x in self.quantities.values()] + [name for group in groups for name in group.columns]

    @property
    def free(self) -> list[str]:
        """Columns that are not assigned."""
        taken = set(self.columns)
        return [name for name in self.log.names if name not in taken and not name.startswith(f"{POSES_OF_BASE}.")]

    def stated(self, x: Quantity) -> str:
        """Unit that the name of a quantity's column states; "" if none."""
        return unit_of(f"{self.kinds[x.joint]} {x.kind}", x.about.unit)

    def factor(self, x: Quantity) -> float:
        """Factor from the unit of a joint's quantity, its own or the file's, to the SI unit."""
        units = UNITS[f"{self.kinds[x.joint]} {x.kind}"]
        in_degrees = not x.unit and self.log.units.get(x.column) == "deg"
        return units[next((u for u in units if in_degrees and u.startswith("deg")), x.unit or next(iter(units)))]

    def values(self, joint: str, kind: str) -> np.ndarray | None:
        """A joint's quantity of a kind in SI units; None without a column that changes (N,)."""
        quantity = self.of(kind).get(joint)
        if quantity and quantity.column in self.log.columns:
            return self.log.columns[quantity.column] * quantity.gain * self.factor(quantity)
        return None


def toml_text(belief: Belief) -> str:
    """The mapping file, with doubtful, missing and unused columns in remarks."""
    lines = [f"# Columns of {name_of(belief.log.path)}, guessed: correct what is wrong. Lines marked ? are guesses."]
    lines += [f"# Open: {sentence}" for sentence in belief.open] + [f"# Note: {sentence}" for sentence in belief.notes]
    lines = [*map(_printable, lines), *_of_files(belief.log)]
    for joint in (joint for joint in belief.mechanism.joints if f"joints.{joint}" not in belief.poses):
        own = [x for x in belief.quantities.values() if x.joint == joint]
        lines.append("# " * all(x.sure == DOUBTFUL for x in own) + f"[joints.{_key(joint)}]")
        lines += ['# position = "?"    # no column'] * all(x.kind != "position" for x in own)
        for x in own:
            lines.append("# " * (x.sure == DOUBTFUL) + _line(x.kind, x.value, "; ".join(x.why), x.sure))
    wrenches = {f"wrenches.{name}": group for name, group in belief.groups.items()}
    for table, group in {**belief.poses, **wrenches}.items():
        (room, dot, name), mark = table.partition("."), "# " * (table in wrenches and group.is_doubtful)
        lines.append(f"{mark}[{room}{dot}{_key(name) if name else ''}]")
        lines += [mark + _line(key, each.value, each.why, each.sure) for key, each in group.lines]
    if belief.unused:
        lines.append(f"# Columns that are not assigned: {', '.join(belief.unused)}")
    return "\n".join(lines) + "\n"


def write_mapping(path: Path, belief: Belief, *, force: bool = False) -> None:
    """Writes the mapping.

    Raises:
        InputError: The file exists, and `force` is false.
    """
    if path.exists() and not force:
        raise InputError(f"'{path}' is there already; --force replaces it, --out NAME writes another.")
    with replacing(path) as temporary:
        temporary.write_text(toml_text(belief), encoding="utf-8")


def _of_files(log: LogContents) -> list[str]:
    """Lines on the columns of times, one for all files or one for each, and on layouts that are not the default."""
    lines, several = list[str](), len(log.layouts) > 1
    if entries := [clock.entry for clock in log.clocks]:
        why = "; ".join(dict.fromkeys(clock.why for clock in log.clocks))
        lines.append(_line("time", entries if len(entries) > 1 else entries[0], why, LIKELY))
    for layout in log.layouts if any(layout != Layout() for layout in log.layouts) else ():
        header = _line("header", layout.header, "the first row has numbers" * (not layout.header))
        lines += ["[[file]]" if several else "[file]", header]
        lines += [_line("skip", layout.skip, "lines before the table")] if layout.skip else []
    return lines


def _line(key: str, value: Any, why: str, sure: str = SURE) -> str:
    return f"{key} = {_toml(value)}" + (f"    # {'? ' * (sure != SURE)}{_printable(why)}" if why else "")


def _toml(value: Any) -> str:
    """A TOML value; assigned columns have no characters that JSON would escape differently."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _printable(text: str) -> str:
    """A text on one line, for a remark."""
    return "".join(c if c.isprintable() else " " for c in text)


def rows(belief: Belief) -> list[tuple[str, ...]]:
    """Rows of a table of the beliefs: quantity, column, unit, certainty, and reasons."""
    clocks = [(clock.entry, clock.why) for clock in belief.log.clocks]
    out: list[tuple[str, ...]] = [
        ("time", ", ".join(own.get("columns", [own.get("column", "counted")])), own.get("unit", ""), LIKELY, why)
        for own, why in clocks
    ]
    for x in belief.quantities.values():
        unit = f"{x.gain:g} × {x.unit}" if x.gain != 1 else x.unit
        out.append((f"{x.joint}.{x.kind}", x.column or "left out", unit, x.sure, "; ".join(x.why)))
    for group in (*belief.poses.values(), *belief.groups.values()):
        for key, entry in group.lines:
            values = entry.value if isinstance(entry.value, list) else [entry.value]
            scaled = (f"{x['gain']:g} × {x['column']}" if isinstance(x, dict) else x for x in values)
            listed = ", ".join(str(each) if each != "" else "-" for each in scaled)
            out.append((f"{group.name}.{key}", listed, "", entry.sure, entry.why))
    return out
