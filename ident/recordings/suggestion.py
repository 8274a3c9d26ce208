"""Columns that look like a wrench or like joint torques, and the lines of a mapping that would use them."""

import json
import re
from collections.abc import Sequence

from ident.recordings.table import short
from ident.recordings.wrench_names import Component, wrench_groups

KINDS = ("force", "torque")
"""What makes a wrench, moments being about the origin."""

JOINT_TORQUE = r"torque|moment|effort|(?<![a-z])(tau|trq|t)(?![a-z])"
"""What the torque of a joint is called, in small letters."""

SHOWN = 40
"""Columns that are listed at most."""


def suggested_mapping(columns: Sequence[str], joints: Sequence[str]) -> str:
    """What a log has that nothing was taken from, and how to map what looks like a wrench or like joint torques.

    Args:
        columns: Names of these columns.
        joints: Names of the mechanism's joints.

    Returns:
        A sentence, and below it lines of TOML where there is something to suggest.
    """
    names = [name for name in columns if name == name.strip() and name.isprintable()]
    lines = _ground(names) or _torques(names, [joint for joint in joints if joint.isprintable()])
    listed = ", ".join(" ".join(short(name).split()) for name in columns[:SHOWN]) + (
        ", ..." if len(columns) > SHOWN else ""
    )
    there = f"Besides times and joint states it has {f'the columns {listed}' if columns else 'no columns'}"
    if not lines:
        return f"{there}; none is named like a wrench or a torque: map what is one in a file for --columns."
    return "\n".join([f"{there}; these lines in a file for --columns would use those that look like it:", *lines])


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
    """Lines for the joints' torques: by the joints' names, or in order where there are as many."""
    torques = [name for name in names if re.search(JOINT_TORQUE, name.lower().replace("_", " "))]
    found: dict[str, str] = {}
    for joint in sorted(joints, key=len, reverse=True):
        own = [name for name in torques if joint.lower() in name.lower() and name not in found.values()]
        if own:
            found[joint] = own[0]
    if not found and len(torques) == len(joints):
        found = dict(zip(joints, torques, strict=True))
    return [line for joint in joints if joint in found for line in _torque_lines(joint, found[joint])]


def _torque_lines(joint: str, column: str) -> tuple[str, str]:
    key = joint if re.fullmatch(r"[A-Za-z0-9_-]+", joint) else _quoted(joint)
    return f"[joints.{key}]", f"torque = {_quoted(column)}"


def _quoted(text: str) -> str:
    """A string of TOML; the names of columns have nothing that JSON would write otherwise."""
    return json.dumps(text, ensure_ascii=False)
