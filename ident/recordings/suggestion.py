"""Columns that look like a wrench or like joint torques, and lines of a mapping for them."""

import json
import re
from collections.abc import Sequence

from ident.files.table import short
from ident.recordings.wrench_names import Component, wrench_groups

KINDS = ("force", "torque")
"""Quantities of a wrench; moments are about the origin."""

JOINT_TORQUE = r"torque|moment|effort|(?<![a-z])(tau|trq|t)(?![a-z])"
"""Pattern of the names of joint torques, in lower case."""

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
