"""Beliefs about a log: columns of quantities, each with its reasons and its certainty."""

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from experiments.guesses.log_contents import LogContents
from experiments.guesses.words import Words, unit_of, words
from ident.files.column import CURRENT, UNITS
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.plane import plane_normal
from ident.recordings.columns.mapping import joint_kinds

SURE, LIKELY, DOUBTFUL = "sure", "likely", "doubtful"
"""Certainty of a belief: sure, by an exact name or by unambiguous numbers; likely, by likeness; doubtful, so that it is
written as a remark only."""

BASE = "base"
"""Table of a mapping with the poses of the base."""

LISTS = ("force", "torque", "point", "free_moment", "position", "quaternion")
"""Lines of a group whose values are columns, perhaps with gains, or numbers in their place."""


@dataclass
class Quantity:
    """The column that probably holds one quantity of a joint.

    Attributes:
        joint: The joint.
        kind: The quantity, a key of `ident.files.column.KINDS`.
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
    def columns(self) -> list[str]:
        """All its columns."""
        lists = (self.entries[key].value for key in LISTS if key in self.entries)
        own = (each["column"] if isinstance(each, dict) else each for names in lists for each in names)
        return [name for name in own if isinstance(name, str) and name]


@dataclass
class Belief:
    """All beliefs about a log.

    Attributes:
        log: The log.
        mechanism: The mechanism.
        quantities: Quantities of joints by their keys in a mapping.
        groups: Wrenches by name.
        poses: Ball joints and a moving base, by their tables in a mapping.
        open: Sentences on quantities that are ambiguous or missing.
        notes: Sentences on other observations.
        unused: Columns that are not assigned.
        by_place: Joints whose columns are assigned only by their place in a series and by the model's predictions.
        undecided: Joints whose position a sentence of `open` is about.
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
    by_place: set[str] = field(default_factory=set)
    undecided: set[str] = field(default_factory=set)
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

    @cached_property
    def held(self) -> bool:
        """True if something holds the base."""
        return not self.mechanism.tree.floats

    @cached_property
    def flies(self) -> bool:
        """True if the joints move a held base freely in a plane."""
        return self.held and plane_normal(self.mechanism) is not None

    @property
    def can_predict(self) -> bool:
        """True if the model predicts wrenches and torques by angles alone."""
        moves = any("position" in group.entries for group in self.poses.values())
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
        return [name for name in self.log.names if name not in taken]

    def stated(self, x: Quantity) -> str:
        """Unit that the name of a quantity's column states; "" if none."""
        return unit_of(f"{self.kinds[x.joint]} {x.kind}", x.about.unit)

    def factor(self, x: Quantity) -> float:
        """Factor from the unit of a joint's quantity, its own or the file's, to the SI unit."""
        units = UNITS[f"{self.kinds[x.joint]} {x.kind}"]
        in_degrees = not x.unit and self.log.units.get(x.column) == "deg"
        return units[next((u for u in units if in_degrees and u.startswith("deg")), x.unit or next(iter(units)))]

    def values(self, joint: str, kind: str) -> np.ndarray | None:
        """A joint's position or velocity in SI units; the velocity by differentiation if it has no column (N,)."""
        quantity = self.of(kind).get(joint)
        if quantity and quantity.column in self.log.columns:
            return self.log.columns[quantity.column] * quantity.gain * self.factor(quantity)
        if kind == "velocity" and (x := self.values(joint, "position")) is not None:
            return np.gradient(x, self.log.time)
        return None
