"""Columns that look like a wrench or like joint torques, and lines of a mapping for them."""

import json
import re
from collections.abc import Sequence
from difflib import get_close_matches

from ident.files.table import short
from ident.recordings.wrench_names import Component, wrench_groups

KINDS = ("force", "torque")
"""Quantities of a wrench; moments are about the origin."""

JOINT_TORQUE = r"torque|moment|effort|(?<![a-z])(tau|trq|t)(?![a-z])"
"""Pattern of the names of joint torques, in lower case."""

ALIKE = 0.85
"""Similarity from which a name is taken as another one, misspelt."""

PLACE = "in a file for --columns or by columns= in Python"
"""Place of a mapping, for messages."""

SHOWN = 40
"""Number of columns that are listed at most."""


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
    listed = ", ".join(" ".join(short(name).split()) for name in columns[:SHOWN]) + (
        ", ..." if len(columns) > SHOWN else ""
    )
    there = f"Besides times and joint states it has {f'the columns {listed}' if columns else 'no columns'}"
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
