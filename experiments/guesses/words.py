"""Words of names: kinds, units, sides, numbers, likeness of two names, families that differ by a number, wrenches."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from functools import lru_cache

from ident.files.table import CURRENT, UNITS

PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\d_]+|\d+")
"""Words and numbers in a name."""


def _set(text: str) -> set[str]:
    """Words of a text."""
    return set(text.split())


KINDS = {
    "position": _set("q pos position positions angle angles ang theta value encoder coordinate winkel lage phi"),
    "velocity": _set("dq qd qdot vel velocity velocities speed omega rate geschwindigkeit"),
    "acceleration": _set("ddq qdd qddot acc accel acceleration accelerations beschleunigung"),
    "torque": _set("tau torque torques trq effort efforts moment drehmoment"),
    "force": _set("force forces kraft"),
    "current": _set("current currents cur amps i strom"),
    "time": _set("time t timestamp stamp clock"),
}
"""Words of names by the quantity that the column holds."""

COMMANDED = _set("ref cmd des desired target command commanded setpoint goal action soll")
"""Words of quantities that were commanded."""

ESTIMATED = _set("ext external dtau residual computed calculated calc estimated est predicted")
"""Words of quantities that were computed, or that act from outside, rather than measured at a joint."""

MEASURED = {"meas", "measured", "msr", "actual", "act", "fb", "feedback", "ist"}
"""Words of quantities that were measured."""

EMPTY = {"joint", "jnt", "j", "axis", "jointset", "gelenk", "achse", "observation", "state"} | MEASURED
"""Words that do not distinguish joints."""

SPOKEN = set[str]().union(*KINDS.values()) | EMPTY

GLUED = re.compile(rf"(joint|axis|motor)({'|'.join(w for those in KINDS.values() for w in those if len(w) > 2)})")
"""Words that are written without a space, as `jointpos`."""

SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}

_SPELLINGS = {
    "deg": "deg degs degree degrees ° dps",
    "rad": "rad rads radian radians",
    "N m": "nm",
    "N mm": "nmm mnm",
    "kN m": "knm",
    "%": "percent pct",
    "A": "amp",
    "s": "secs sec",
    "ms": "ms msec",
    "us": "us usec",
    "ns": "ns nsec",
    **{unit: unit.lower() for unit in ("rpm", "mm", "cm", "kN", "mN", "mA")},
}
SPELLED = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings.split()}
"""Units by their spelling in names, in lower case."""

ANGLES = {spelling for spelling, unit in SPELLED.items() if unit in ("deg", "rad") and spelling.isalpha()}
"""Spellings that count anywhere in a name, as in `kneeRad`; those of other units have other uses."""

UNIT = re.compile(
    rf"(?:^|(?<=[\W_]))({'|'.join(sorted(SPELLED, key=len, reverse=True))})"
    r"((?:_per|p)?[_/]?s(?:ec)?\^?[2²]?)?(?=$|[\W_])",
    re.IGNORECASE,
)
"""A unit between other words, perhaps with seconds below it: `deg`, `rad_per_s`, `deg_s2`."""

BRACKETED = {"m": "m", "n": "N", "a": "A", "%": "%", "s": "s", "µs": "us", "n.m": "N m", "n*m": "N m", "n·m": "N m"}
"""Units that count only in brackets, as their letters have many other uses."""

LAST = re.compile(r"(?i:.(?:current|strom)s?[\W_\d]*)[\W_]A$|(?i:(?:force|kraft|(?<![a-z])f)[\W_\d]*)[\W_]N$")
"""A or N at the end of a current's or a force's name."""

OF_UNIT = {
    **dict.fromkeys(("N m", "N mm", "kN m"), "torque"),
    **dict.fromkeys(CURRENT, "current"),
    "rpm": "velocity",
    **dict.fromkeys(("deg", "rad"), "position"),
    **dict.fromkeys(("N", "kN", "mN"), "force"),
}
"""Quantities that a unit shows."""

LIKE = 0.6
"""Smallest likeness of names that may mean the same, and that of the only column of a quantity for the only joint."""

NEAR = 0.05
"""Differences of likeness below this leave the choice open."""


@dataclass(frozen=True)
class Words:
    """Words of a name.

    Attributes:
        core: The remaining words: the joint or body.
        kind: One of `KINDS`, or "".
        unit: One of the units of `SPELLED` and `BRACKETED`, without `/s`, or "".
        commanded: True if the quantity was commanded.
        measured: True if it was neither commanded nor estimated, and does not act from outside.
    """

    core: tuple[str, ...]
    kind: str = ""
    unit: str = ""
    commanded: bool = False
    measured: bool = True

    @property
    def numbers(self) -> set[str]:
        """The numbers among the words."""
        return {word for word in self.core if word.isdigit()}

    @property
    def sides(self) -> set[str]:
        """The sides among the words, left or right."""
        return {word for word in self.core if word in SIDES.values()}

    def shares_numbers_alone(self, other: "Words") -> bool:
        """True where two names share numbers only, which may start at zero in one and at one in the other."""
        common = set(self.core) & set(other.core)
        return bool(common) and all(word.isdigit() for word in common)


@lru_cache(maxsize=4096)
def words(name: str) -> Words:
    """Words of the name of a column or a joint."""
    name, unit, seconds = without_unit(name)
    split = [part for each in PARTS.findall(name) for part in GLUED.sub(r"\1 \2", each.lower()).split()]
    split = [str(int(part)) if part.isdigit() else part for part in split]
    kinds = [kind for part in split for kind, those in KINDS.items() if part in those]
    # In `motor_current_position` the last word is the quantity; `current` is one only without another.
    kind = next((kind for kind in reversed(kinds) if kind != "current" or set(kinds) == {"current"}), "")
    rate = "acceleration" if re.search("[2²]", seconds) else "velocity"
    shown = rate if seconds and unit in ("deg", "rad") else OF_UNIT.get(unit, "")
    # Among several columns, T1 [Nm] and T2 [Nm] are torques.
    kind = shown if shown in ("torque", "current") else kind or shown
    # Franka's `q_d` and `tau_J_d` are desired values.
    after = {k for k, part in enumerate(split) if part == "d" and k and split[k - 1] in SPOKEN}
    spoken = SPOKEN | COMMANDED | ESTIMATED
    core = tuple(SIDES.get(part, part) for k, part in enumerate(split) if part not in spoken and k not in after)
    commanded = bool(after) or not COMMANDED.isdisjoint(split)
    return Words(core, kind, unit, commanded, not commanded and ESTIMATED.isdisjoint(split))


def without_unit(name: str) -> tuple[str, str, str]:
    """A name without its unit, the unit without seconds below it, and these seconds, perhaps squared, or ""."""
    for match in re.finditer(r"[\[(]([^\])]*)[\])]", name):
        spelling, seconds, power = re.sub(r"\s", "", match[1].lower()).partition("/s")
        if unit := SPELLED.get(spelling) or BRACKETED.get(spelling):
            return name[: match.start()] + name[match.end() :], unit, seconds + power
    if LAST.search(name):
        return name[:-1], name[-1], ""
    for match in reversed(list(UNIT.finditer(name))):
        spelling = match[1].lower()
        if match.start() or spelling in ANGLES:
            seconds = match[2] or "s" * (spelling == "dps")
            return name[: match.start()] + name[match.end() :], SPELLED[spelling], seconds
    for match in reversed(list(PARTS.finditer(name))):
        if match[0].lower() in ANGLES:
            return name[: match.start()] + name[match.end() :], SPELLED[match[0].lower()], ""
    return name, "", ""


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
    return like - (0.0 if column.measured else 0.2)


def most_alike(name: str, others: Iterable[str], least: float = LIKE) -> dict[str, float]:
    """Likenesses of those names that are most like another one, several where the choice is open."""
    likes = {other: likeness(words(name), words(other)) for other in others}
    best = max(likes.values(), default=0.0)
    return {other: like for other, like in likes.items() if like >= least and like > best - NEAR}


def without_prefix(about: Mapping[str, Words]) -> dict[str, Words]:
    """The words of some names without a common prefix, such as the robot's name."""
    cores, length = [each.core for each in about.values()], 0
    while len(cores) > 1 and all(len(core) > length + 1 and core[length] == cores[0][length] for core in cores):
        length += 1
    return {name: replace(each, core=each.core[length:]) for name, each in about.items()}


def unit_of(quantity: str, stated: str) -> str:
    """The unit of a quantity of `UNITS` that a name states; "" if the quantity cannot have it."""
    rate = {"velocity": "/s", "acceleration": "/s^2"}.get(quantity.split(" ")[-1], "")
    return next((unit for unit in (stated, stated + rate) if stated and unit in UNITS[quantity]), "")


def suits(quantity: str, name: str) -> bool:
    """True unless a name states the unit of an angle, and the quantity of `UNITS` is a length, or the reverse."""
    unit = words(name).unit
    return shown_by(unit) != "position" or bool(unit_of(quantity, unit))


def shown_by(unit: str) -> str:
    """The quantity that a unit shows of joints: lengths are positions, and forces torques."""
    quantity = "position" if unit in UNITS["length"] else OF_UNIT.get(unit, unit)
    return "torque" if quantity == "force" else quantity


ELSEWHERE = {"tcp", "ee", "tool", "cartesian", "pose", "temperature", "temp", "voltage", "mode", "status", "error"}
"""Words of families that are not of joints."""


@dataclass(frozen=True)
class Family:
    """Names that differ by a number alone.

    Attributes:
        template: The common text without units, with `#` for the number, and the quantity that the units show.
        numbers: The numbers, in their order.
        names: The names in this order.
        kind: The quantity, a key of `words.KINDS`, by words or unit; "" if neither states it.
        is_of_joints: True if no word states a quantity of something else, or a commanded one.
    """

    template: str
    numbers: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    kind: str = ""
    is_of_joints: bool = False

    @property
    def by_number(self) -> dict[int, str]:
        """The names by their numbers."""
        return dict(zip(self.numbers, self.names, strict=True))

    @classmethod
    def of(cls, template: str, members: Iterable[tuple[int, str]]) -> "Family":
        """The family of some numbered names."""
        numbers, names = zip(*sorted(members), strict=True)
        # Of angles and lengths in one family, only angles state that they are positions.
        about = next(filter(lambda each: each.kind, map(words, names)), words(names[0]))
        parts = {part.lower() for part in PARTS.findall(names[0])}
        # Gazebo calls the torque of a hinge a force; among several columns, T1 and T2 are torques.
        kind = "torque" if about.kind == "force" or (about.kind == "time" and "t" in parts) else about.kind
        return cls(template, numbers, names, kind, parts.isdisjoint(ELSEWHERE) and about.measured and kind != "time")


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
    bare, unit, seconds = without_unit(name)
    bare = re.sub(r"\s*[\[(]\s*[^\])\d]*[\])]\s*$", "", bare.lower()).rstrip(" _")
    if array := re.fullmatch(r"(\D+\.)([wxyz])", bare):
        return {f"{array[1]}#": "wxyz".index(array[2])}
    shown, numbers = f" {shown_by(unit)}{seconds}".rstrip(), re.finditer(r"\d+", bare)
    return {f"{bare[: m.start()]}#{bare[m.end() :]}{shown}": int(m[0]) for m in numbers if len(m[0]) < 7}


_WHOSE = r"([\W_\d]*|(?:[\W_]+[a-z\d]+)+?[\W_]+)"
_NUMBER, _AXIS = r"([\W_\d]*)", r"[\W_]*([xyz])(?![a-z])"

WRENCHES = (
    ("torque", rf"(?:force|grf){_WHOSE}m{_AXIS}"),
    ("point", rf"(?:force|grf){_WHOSE}p{_AXIS}"),
    ("force", rf"(?:force|grf|kraft){_WHOSE}v?{_AXIS}"),
    ("torque", rf"(?<![a-z])(?:ft[\W_]*r|[mt]t){_NUMBER}{_AXIS}"),
    ("force", rf"(?<![a-z])ft{_NUMBER}{_AXIS}"),
    ("force", rf"(?<![a-z])f{_NUMBER}v?{_AXIS}"),
    ("torque", rf"(?:torque|drehmoment|moment|grm){_WHOSE}m?{_AXIS}"),
    ("torque", rf"(?<![a-z])[mt]{_NUMBER}{_AXIS}"),
    ("point", rf"(?:cop|point){_WHOSE}p?{_AXIS}"),
    ("point", rf"(?<![a-z])(?=p){_NUMBER}p?{_AXIS}"),
)
"""Patterns of the names of components in lower case: a word, perhaps a number or an owner, and an axis. OpenSim calls
the components of a force vx, vy and vz, those of its point of application px, py and pz; AddBiomechanics calls those of
a moment mx, my and mz. Drivers of force-torque sensors write FTx and MTx, or FT_X and FT_RX."""

SIX = re.compile(r"(?<![a-z])f[\W_]?t(?![a-z])|wrench|force[\W_]*torque|tcp[\W_]*force|f[\W_]?t[\W_]*sens")
THREE = {"force": re.compile(r"(?<![a-z])(?:forces?|kraft|f)(?![a-z])"), "torque": re.compile(r"torques?|moments?")}
"""Words of series of numbers: three forces and three moments in one, as `FT0` to `FT5`, or in two."""

Component = tuple[str, str]
"""Quantity, a kind of `WRENCHES`, and axis."""


SIX_KEYS: tuple[Component, ...] = tuple((kind, axis) for kind in ("force", "torque") for axis in "xyz")
"""Components in the order of their numbers."""


def wrench_groups(names: Sequence[str]) -> dict[str, dict[Component, str]]:
    """Columns by the common part of the names of one wrench, and by component."""
    groups: dict[str, dict[Component, str]] = {}
    for name in names:
        for kind, pattern in WRENCHES:
            if match := re.search(pattern, name.lower()):
                whose = "_".join(re.findall(r"[a-z\d]+", match[1]))
                rest = f"{name[: match.start()]}|{whose}|{name[match.end() :]}"
                groups.setdefault(rest, {}).setdefault((kind, match[2]), name)
                break
    return {**groups, **_numbered([name for name in names if not any(name in own.values() for own in groups.values())])}


def _numbered(names: Sequence[str]) -> dict[str, dict[Component, str]]:
    """Wrenches whose components are numbered: six of one series, or three forces and three moments of two."""
    series: dict[tuple[str, str], dict[int, str]] = {}
    for name in names:
        if match := re.fullmatch(r"(.*?)(\d{1,6})(\D*)", name.lower()):
            series.setdefault((match[1], match[3]), {})[int(match[2])] = name
    groups: dict[str, dict[Component, str]] = {}
    for (stem, end), own in series.items():
        columns = [own[k] for k in sorted(own)]
        if max(own) - min(own) + 1 != len(own):
            continue
        if len(own) == 6 and SIX.search(stem):
            groups[stem.strip("[_. /") + end.strip("])_. /")] = dict(zip(SIX_KEYS, columns, strict=True))
        for kind, pattern in THREE.items() if len(own) == 3 else ():
            if match := pattern.search(stem):
                rest = f"{stem[: match.start()]}|{stem[match.end() :]}{end}"
                groups.setdefault(rest, {}).update({(kind, x): c for x, c in zip("xyz", columns, strict=True)})
    return {rest: own for rest, own in groups.items() if len(own) == 6}
