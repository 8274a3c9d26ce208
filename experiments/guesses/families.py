"""Families of names that differ by a number alone, such as `actual_q_0` to `actual_q_5`."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from experiments.guesses.words import PARTS, Words, words

ELSEWHERE = {"tcp", "ee", "tool", "cartesian", "pose", "temperature", "temp", "voltage", "mode", "status", "error"}
"""Words of families that are not of joints."""

SECOND = {"theta", "motor", "encoder", "raw"}
"""Words of positions before the gear or the calibration; a family of the joints themselves has precedence."""


class Member(NamedTuple):
    """A name of a family.

    Attributes:
        number: The number in the name.
        name: The name.
    """

    number: int
    name: str


@dataclass(frozen=True)
class Family:
    """Names that differ by a number alone.

    Attributes:
        template: The common text, with `#` for the number.
        members: The names in the order of their numbers.
    """

    template: str
    members: tuple[Member, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The names in the order of their numbers."""
        return tuple(member.name for member in self.members)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers."""
        return tuple(member.number for member in self.members)

    @property
    def words(self) -> Words:
        """Words of the first name."""
        return words(self.names[0])

    @property
    def kind(self) -> str:
        """The quantity, a key of `words.KINDS`, by words or unit; "" if neither states it."""
        # Gazebo calls the torque of a hinge a force; among several columns, T1 and T2 are torques.
        kind = self.words.kind
        return "torque" if kind == "force" or (kind == "time" and "t" in self._parts) else kind

    @property
    def is_of_joints(self) -> bool:
        """True if no word states a quantity of something else, or a commanded one."""
        return not (set(self._parts) & ELSEWHERE) and self.words.measured and self.kind != "time"

    @property
    def is_second(self) -> bool:
        """True if its positions are of motors rather than of joints."""
        return bool(set(self._parts) & SECOND)

    @property
    def _parts(self) -> list[str]:
        return [part.lower() for part in PARTS.findall(self.names[0])]


def families(names: Iterable[str]) -> list[Family]:
    """Families of names, each name in the largest that it fits; names without numbers are in none."""
    there = list(names)
    ways = {name: _templates(name) for name in there}
    sizes: dict[str, int] = {}
    for templates in ways.values():
        for template in templates:
            sizes[template] = sizes.get(template, 0) + 1
    groups: dict[str, list[Member]] = {}
    for name in there:
        if ways[name]:
            # Between templates with equally many names, the last number counts.
            template = max(reversed(ways[name]), key=sizes.__getitem__)
            groups.setdefault(template, []).append(Member(ways[name][template], name))
    return [Family(template, tuple(sorted(members))) for template, members in groups.items()]


def _templates(name: str) -> dict[str, int]:
    """Numbers in a name by the text around them, without units; those of `q.x` in arrays of three or four."""
    bare = re.sub(r"\s*[\[(]\s*[^\])\d]*[\])]\s*$", "", name.lower())
    if array := re.fullmatch(r"(\D+\.)([wxyz])", bare):
        return {f"{array[1]}#": "wxyz".index(array[2])}
    return {f"{bare[: m.start()]}#{bare[m.end() :]}": int(m[0]) for m in re.finditer(r"\d+", bare) if len(m[0]) < 7}


def is_shifted(columns: Sequence[int], joints: Sequence[int]) -> bool:
    """True where columns and joints are numbered from different origins: each has numbers that the other lacks."""
    return bool(set(columns) - set(joints)) and bool(set(joints) - set(columns))
