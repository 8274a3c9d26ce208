"""Names of columns: wrenches by them, lines of a mapping for what looks like a wrench or a torque, misspelt ones."""

import json
import re
from collections.abc import Sequence
from difflib import get_close_matches

from ident.files.table import listed, short

_WHOSE = r"([\W_\d]*|(?:[\W_]+[a-z\d]+)+?[\W_]+)"
_NUMBER, _AXIS = r"([\W_\d]*)", r"[\W_]*([xyz])(?![a-z])"

WORDS = (
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
"""Quantity, a kind of `WORDS`, and axis."""


SIX_KEYS: tuple[Component, ...] = tuple((kind, axis) for kind in ("force", "torque") for axis in "xyz")
"""Components in the order of their numbers."""

KINDS = ("force", "torque")
"""Quantities of a wrench; moments are about the origin."""

JOINT_TORQUE = r"torque|moment|effort|(?<![a-z])(tau|trq|t)(?![a-z])"
"""Pattern of the names of joint torques, in lower case."""

ALIKE = 0.85
"""Similarity from which a name is taken as another one, misspelt."""

PLACE = "in a file for --columns or by columns= in Python"
"""Place of a mapping, for messages."""


def wrench_groups(names: Sequence[str]) -> dict[str, dict[Component, str]]:
    """Columns by the common part of the names of one wrench, and by component."""
    groups: dict[str, dict[Component, str]] = {}
    for name in names:
        for kind, pattern in WORDS:
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


def suggested_mapping(columns: Sequence[str], joints: Sequence[str]) -> str:
    """Message on the unused columns of a log, with a mapping for those that look like a wrench or joint torques.

    Args:
        columns: Names of the unused columns.
        joints: Names of the mechanism's joints.

    Returns:
        A sentence, followed by lines of TOML if there is something to suggest.
    """
    names = [name for name in columns if name == name.strip() and name.isprintable()]
    lines = _ground(names) or _torques(names, [joint for joint in joints if joint.isprintable()])
    plain = [" ".join(name.split()) for name in columns]
    there = f"Besides times and joint states it has {f'the columns {listed(plain)}' if columns else 'no columns'}"
    if not lines:
        return f"{there}; none is named like a wrench or a torque: map what is one, {PLACE}."
    return "\n".join([f"{there}; these lines, {PLACE}, would use those that look like it:", *lines])


def misspelt(unused: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Sentences on the unused columns whose names are nearly those of channels that are missing.

    Args:
        unused: Names of the unused columns.
        wanted: Names that the columns of the missing channels would have.
    """
    out = []
    # A column that the mapping leaves out on purpose may have the very name.
    for name in (each for each in unused if each not in wanted):
        alike = [each for each in wanted if re.sub(r"\D", "", each) == re.sub(r"\D", "", name)]
        if close := get_close_matches(name.casefold(), alike, 1, ALIKE):
            out.append(f"Column '{short(name)}' is not used, since its name is not '{close[0]}'; rename or map it.")
    return out


def _ground(names: Sequence[str]) -> list[str]:
    """Lines for the most complete wrench among the columns."""
    wrenches = (
        {key: name for key, name in group.items() if key[0] in KINDS} for group in wrench_groups(names).values()
    )
    groups = [group for group in wrenches if group]
    if not groups:
        return []
    best = max(groups, key=len)
    return ["[wrenches.ground]", *(f"{kind} = [{_listed(best, kind)}]" for kind in KINDS)]


def _listed(group: dict[Component, str], kind: str) -> str:
    return ", ".join(_quoted(group.get((kind, axis), "")) for axis in "xyz")


def _torques(names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Lines for the joints' torques: by the joints' names, or in order if there are as many."""
    torques = [name for name in names if re.search(JOINT_TORQUE, name.lower().replace("_", " "))]
    columns: dict[str, str] = {}
    for joint in sorted(joints, key=len, reverse=True):
        own = [name for name in torques if joint.lower() in name.lower() and name not in columns.values()]
        if own:
            columns[joint] = own[0]
    if not columns and len(torques) == len(joints):
        columns = dict(zip(joints, torques, strict=True))
    return [line for joint in joints if joint in columns for line in _torque_lines(joint, columns[joint])]


def _torque_lines(joint: str, column: str) -> tuple[str, str]:
    key = joint if re.fullmatch(r"[A-Za-z0-9_-]+", joint) else _quoted(joint)
    return f"[joints.{key}]", f"torque = {_quoted(column)}"


def _quoted(text: str) -> str:
    """The text as a TOML string; for names of columns JSON writes the same."""
    return json.dumps(text, ensure_ascii=False)
