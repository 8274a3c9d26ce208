"""Beliefs about a log: columns of quantities, each with its reasons and its certainty."""

from dataclasses import dataclass, field
from typing import Any

from ident.files.column import CURRENT

SURE, LIKELY, DOUBTFUL = "sure", "likely", "doubtful"
"""Certainty of a belief: sure, by an exact name or by unambiguous numbers; likely, by likeness; doubtful, so that it is
written as a remark only."""


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
    def key(self) -> str:
        """Its name in a mapping."""
        return f"joints.{self.joint}.{self.kind}"

    @property
    def value(self) -> Any:
        """Its entry in a mapping."""
        more = ({"unit": self.unit} if self.unit else {}) | (
            {"gain": self.gain} if self.gain != 1 or self.unit in CURRENT else {}
        )
        return {"column": self.column, **more} if more else self.column


@dataclass
class Entry:
    """A line in the table of a wrench or pose.

    Attributes:
        value: Its value.
        why: Reasons.
        sure: Certainty.
    """

    value: Any
    why: str
    sure: str = LIKELY


LISTS = ("force", "torque", "point", "free_moment", "position", "quaternion")
"""Lines of a group whose values are columns, perhaps with gains, or numbers in their place."""


@dataclass
class Group:
    """Columns that probably hold a wrench, or the poses of a ball joint or a base.

    Attributes:
        name: Name of the wrench, of the joint, or `base`.
        entries: Lines of its table by key.
        is_open: True for a wrench that may be the ground's, or of a sensor between two bodies.
        is_inner: True for the wrench of a sensor between two bodies, which is none of the mechanism with others.
        own_name: Name in the log, for a wrench that is open.
    """

    name: str
    entries: dict[str, Entry]
    is_open: bool = False
    is_inner: bool = False
    own_name: str = ""

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
        quantities: Quantities of joints by key.
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

    quantities: dict[str, Quantity] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)
    poses: dict[str, Group] = field(default_factory=dict)
    open: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    by_place: set[str] = field(default_factory=set)
    undecided: set[str] = field(default_factory=set)
    torques_undecided: bool = False
    complete: bool = False

    def of(self, kind: str) -> dict[str, Quantity]:
        """Quantities of one kind that are not doubtful, by joint."""
        return {x.joint: x for x in self.quantities.values() if x.kind == kind and x.column and x.sure != DOUBTFUL}

    def add(self, quantity: Quantity) -> None:
        """Adds a quantity, unless it is known."""
        self.quantities.setdefault(quantity.key, quantity)

    @property
    def columns(self) -> list[str]:
        """All assigned columns."""
        groups = (*self.groups.values(), *self.poses.values())
        return [x.column for x in self.quantities.values()] + [name for group in groups for name in group.columns]
