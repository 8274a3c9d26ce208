"""Words of a column's name: the quantity, its unit, and the joint or body that it belongs to."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher

from ident.files.column import UNITS

KINDS = {
    "position": {"q", "pos", "position", "angle", "angles", "ang", "theta", "value", "encoder", "coordinate"},
    "velocity": {"dq", "qd", "qdot", "vel", "velocity", "speed", "omega", "rate"},
    "acceleration": {"ddq", "qdd", "qddot", "acc", "accel", "acceleration"},
    "torque": {"tau", "torque", "trq", "effort", "moment"},
    "current": {"current", "cur", "amps", "i"},
    "time": {"time", "t", "timestamp", "stamp", "clock"},
}
"""Words of names by the quantity that the column holds."""

COMMANDED = {
    *("ref", "cmd", "des", "desired", "target", "command", "commanded", "setpoint", "goal", "action"),
    *("ext", "external", "dtau", "residual"),
}
"""Words of quantities that were commanded, or estimated, rather than measured at a joint."""

EMPTY = {"joint", "jnt", "j", "axis", "meas", "measured", "msr", "actual", "fb", "feedback", "jointset"}
"""Words that do not distinguish joints."""

KINDS_AND_EMPTY = set[str]().union(*KINDS.values()) | EMPTY

SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}

SPELLED = {
    "deg": "deg",
    "degs": "deg",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "dps": "deg",
    "rad": "rad",
    "rads": "rad",
    "radian": "rad",
    "radians": "rad",
    "rpm": "rpm",
    "mm": "mm",
    "cm": "cm",
    "kn": "kN",
    "nm": "N m",
    "nmm": "N mm",
    "knm": "kN m",
    "ma": "mA",
    "amp": "A",
    "ms": "ms",
    "msec": "ms",
    "us": "us",
    "usec": "us",
    "ns": "ns",
    "nsec": "ns",
    "sec": "s",
    "secs": "s",
}
"""Units by their spelling in names, in lower case."""

BRACKETED = {"m": "m", "n": "N", "a": "A", "s": "s", "µs": "us", "n.m": "N m", "n*m": "N m", "n·m": "N m"}
"""Units that count only in brackets, as their letters have many other uses."""

LIKE = 0.6
"""Smallest likeness of names that may mean the same."""

NEAR = 0.05
"""Differences of likeness below this leave the choice open."""


@dataclass(frozen=True)
class Words:
    """Words of a name.

    Attributes:
        core: The remaining words: the joint or body.
        kind: One of `KINDS`, or "".
        unit: One of the units of `SPELLED` and `BRACKETED`, without `/s`, or "".
        commanded: True if the quantity was commanded or estimated, rather than measured.
    """

    core: tuple[str, ...]
    kind: str = ""
    unit: str = ""
    commanded: bool = False

    @property
    def numbers(self) -> set[str]:
        """The numbers among the words."""
        return {word for word in self.core if word.isdigit()}

    @property
    def sides(self) -> set[str]:
        """The sides among the words, left or right."""
        return {word for word in self.core if word in SIDES.values()}


def words(name: str) -> Words:
    """Words of the name of a column or a joint."""
    name, unit = without_unit(name)
    split = [part.lower() for part in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\d_]+|\d+", name)]
    split = [str(int(part)) if part.isdigit() else part for part in split]
    kinds = [kind for part in split for kind, those in KINDS.items() if part in those]
    # In `motor_current_position` the last word is the quantity; `current` is one only without another.
    kind = next((kind for kind in reversed(kinds) if kind != "current" or set(kinds) == {"current"}), "")
    spoken = KINDS_AND_EMPTY | COMMANDED
    # Franka's `q_d` and `tau_J_d` are desired values.
    after = {k for k, part in enumerate(split) if part == "d" and k and split[k - 1] in KINDS_AND_EMPTY}
    core = tuple(SIDES.get(part, part) for k, part in enumerate(split) if part not in spoken and k not in after)
    return Words(core, kind, unit, bool(after) or any(part in COMMANDED for part in split))


def without_unit(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit."""
    if match := re.search(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$", name):
        spelling = re.sub(r"\s|/\s*s(ec)?([\^]?2|²)?$", "", match[1].lower())
        if unit := SPELLED.get(spelling) or BRACKETED.get(spelling):
            return name[: match.start()], unit
    pieces = re.split(r"([\W_]+)", name)
    for k in range(len(pieces) - 1, -1, -1):
        if k and (unit := SPELLED.get(pieces[k].lower())):
            return "".join(pieces[:k]), unit
    return name, ""


def likeness(column: Words, joint: Words) -> float:
    """Likeness of a column's name to that of a joint or body, from 0 to 1: numbers and sides have to agree."""
    if column.sides != joint.sides or not column.core or not joint.core or not joint.numbers <= column.numbers:
        return 0.0
    there, asked = set(column.core), set(joint.core)
    if there == asked:
        like = 1.0
    elif asked <= there:
        like = 0.95 - 0.02 * len(there - asked)
    elif there <= asked:
        like = 0.8 - 0.02 * len(asked - there)
    else:
        like = 0.85 * SequenceMatcher(None, "".join(column.core), "".join(joint.core)).ratio()
    return like - (0.2 if column.commanded else 0.0)


def shares_numbers_alone(column: Words, joint: Words) -> bool:
    """True where two names share numbers only, which may start at zero in one and at one in the other."""
    common = set(column.core) & set(joint.core)
    return bool(common) and all(word.isdigit() for word in common)


def without_prefix(names: Sequence[Words]) -> list[Words]:
    """The same words without a common prefix, such as the robot's name."""
    cores = [each.core for each in names]
    length = 0
    while len(cores) > 1 and all(len(core) > length + 1 and core[length] == cores[0][length] for core in cores):
        length += 1
    return [replace(each, core=each.core[length:]) for each in names]


def unit_of(quantity: str, stated: str) -> str:
    """The unit of a quantity of `UNITS` that a name states; "" if the quantity cannot have it."""
    rate = {"velocity": "/s", "acceleration": "/s^2"}.get(quantity.split(" ")[-1], "")
    return next((unit for unit in (stated, stated + rate) if stated and unit in UNITS[quantity]), "")
