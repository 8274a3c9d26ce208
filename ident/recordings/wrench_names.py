"""Columns that belong together as one wrench, by their names."""

import re
from collections.abc import Sequence

WORDS = {
    "force": r"(?:force|grf|(?<![a-z])f)([\W_\d]*)v?[\W_]*([xyz])(?![a-z])",
    "torque": r"(?:torque|moment|grm|(?<![a-z])[mt])([\W_\d]*)[\W_]*([xyz])(?![a-z])",
    "point": r"(?:(?:force|grf)(?=[\W_\d]*p)|cop|point|(?<![a-z])(?=p))([\W_\d]*)p?[\W_]*([xyz])(?![a-z])",
}
"""What a component is called in small letters: a word, perhaps a number, an axis. OpenSim calls the components of a
force vx, vy and vz, and those of its point of application px, py and pz."""

Component = tuple[str, str]
"""What is measured, a key of `WORDS`, and along which axis."""


def wrench_groups(names: Sequence[str]) -> dict[str, dict[Component, str]]:
    """Columns by what the names of one wrench have in common, and by component."""
    groups: dict[str, dict[Component, str]] = {}
    for name in names:
        for kind, pattern in WORDS.items():
            if match := re.search(pattern, name.lower()):
                number = "".join(re.findall(r"\d+", match[1]))
                rest = f"{name[: match.start()]}|{number}|{name[match.end() :]}"
                groups.setdefault(rest, {}).setdefault((kind, match[2]), name)
                break
    return groups
