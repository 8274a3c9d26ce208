"""Families of names that differ by a number alone, such as `actual_q_0` to `actual_q_5`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from experiments.guesses.words import PARTS, words

ELSEWHERE = {"tcp", "ee", "tool", "cartesian", "pose", "temperature", "temp", "voltage", "mode", "status", "error"}
"""Words of families that are not of joints."""

SECOND = {"theta", "motor", "encoder", "raw"}
"""Words of positions before the gear or the calibration; a family of the joints themselves has precedence."""


@dataclass(frozen=True)
class Family:
    """Names that differ by a number alone.

    Attributes:
        template: The common text, with `#` for the number.
        numbers: The numbers, in their order.
        names: The names in this order.
        kind: The quantity, a key of `words.KINDS`, by words or unit; "" if neither states it.
        is_of_joints: True if no word states a quantity of something else, or a commanded one.
        is_second: True if its positions are of motors rather than of joints.
    """

    template: str
    numbers: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    kind: str = ""
    is_of_joints: bool = False
    is_second: bool = False

    @property
    def by_number(self) -> dict[int, str]:
        """The names by their numbers."""
        return dict(zip(self.numbers, self.names, strict=True))

    @classmethod
    def of(cls, template: str, members: Iterable[tuple[int, str]]) -> "Family":
        """The family of some numbered names."""
        numbers, names = zip(*sorted(members), strict=True)
        about, parts = words(names[0]), {part.lower() for part in PARTS.findall(names[0])}
        # Gazebo calls the torque of a hinge a force; among several columns, T1 and T2 are torques.
        kind = "torque" if about.kind == "force" or (about.kind == "time" and "t" in parts) else about.kind
        of_joints = parts.isdisjoint(ELSEWHERE) and about.measured and kind != "time"
        return cls(template, numbers, names, kind, of_joints, not parts.isdisjoint(SECOND))


def families(names: Iterable[str]) -> list[Family]:
    """Families of names, each name in the largest that it fits; names without numbers are in none."""
    ways, sizes, groups = {name: _templates(name) for name in names}, dict[str, int](), dict[str, list[str]]()
    for template in (template for templates in ways.values() for template in templates):
        sizes[template] = sizes.get(template, 0) + 1
    for name in (name for name, templates in ways.items() if templates):
        # Between templates with equally many names, the last number counts.
        groups.setdefault(max(reversed(ways[name]), key=sizes.__getitem__), []).append(name)
    return [Family.of(each, [(ways[name][each], name) for name in own]) for each, own in groups.items()]


def _templates(name: str) -> dict[str, int]:
    """Numbers in a name by the text around them, without units; those of `q.x` in arrays of three or four."""
    bare = re.sub(r"\s*[\[(]\s*[^\])\d]*[\])]\s*$", "", name.lower())
    if array := re.fullmatch(r"(\D+\.)([wxyz])", bare):
        return {f"{array[1]}#": "wxyz".index(array[2])}
    return {f"{bare[: m.start()]}#{bare[m.end() :]}": int(m[0]) for m in re.finditer(r"\d+", bare) if len(m[0]) < 7}
