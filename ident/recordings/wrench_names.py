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

Component = tuple[str, str]
"""Quantity, a kind of `WORDS`, and axis."""


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
    return groups
