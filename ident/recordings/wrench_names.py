"""Grouping of columns into wrenches by their names."""

import re
from collections.abc import Sequence

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
