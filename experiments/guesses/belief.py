"""What is believed of a log: columns of quantities, each with the reason, and how sure it is."""

from dataclasses import dataclass, field
from typing import Any

from ident.recordings.column import CURRENT

SURE, LIKELY, DOUBTFUL = "sure", "likely", "doubtful"
"""How sure a belief is: by an exact name or by numbers that leave no choice; by likeness; and not at all, so that it is
written as a remark only."""


@dataclass
class Quantity:
    """The column that one quantity of a joint is believed to be in.

    Attributes:
        joint: The joint.
        kind: What of it, a key of `ident.recordings.column.KINDS`.
        column: The column.
        sure: How sure that is.
        why: Reasons.
        unit: Its unit, "" for that of the file or the SI's.
        gain: What it is multiplied by; for a current in N m/A.
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
        """Entry of a mapping for it."""
        more = ({"unit": self.unit} if self.unit else {}) | (
            {"gain": self.gain} if self.gain != 1 or self.unit in CURRENT else {}
        )
        return {"column": self.column, **more} if more else self.column


@dataclass
class Entry:
    """A line of a wrench's table.

    Attributes:
        value: What it says.
        why: Reasons.
        sure: How sure it is.
    """

    value: Any
    why: str
    sure: str = LIKELY


LISTS = ("force", "torque", "point", "free_moment", "position", "quaternion")
"""Lines of a group that name columns, or have numbers in their place."""


@dataclass
class Group:
    """Columns that are believed to be a wrench, a ball joint's or a base's.

    Attributes:
        name: Name of the wrench, of the joint, or `base`.
        entries: Lines of its table by key.
    """

    name: str
    entries: dict[str, Entry]

    @property
    def columns(self) -> list[str]:
        """All columns that it takes."""
        lists = (self.entries[key].value for key in LISTS if key in self.entries)
        return [name for names in lists for name in names if isinstance(name, str) and name]


@dataclass
class Belief:
    """All that is believed of a log.

    Attributes:
        quantities: Of joints, by key.
        groups: Wrenches by name.
        poses: Ball joints and a base that moves, by their tables in a mapping.
        open: Sentences on what could be one thing or another, or is not to be found.
        notes: Sentences on what else was noticed.
        unused: Columns that nothing was found for.
        by_place: Joints whose columns are believed by their place in a series alone, and by what the model explains.
        undecided: Joints whose position a sentence of `open` is about.
        torques_undecided: Whether one is about which of several columns are the torques.
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

    def of(self, kind: str) -> dict[str, Quantity]:
        """What is believed of one kind, without what is doubtful, by joint."""
        return {x.joint: x for x in self.quantities.values() if x.kind == kind and x.column and x.sure != DOUBTFUL}

    @property
    def columns(self) -> list[str]:
        """All columns that something was found for."""
        groups = (*self.groups.values(), *self.poses.values())
        return [x.column for x in self.quantities.values()] + [name for group in groups for name in group.columns]
