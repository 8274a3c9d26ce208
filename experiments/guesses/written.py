"""Text of a mapping of columns with the reason for every line, to be corrected by hand."""

import json
import re
from collections.abc import Sequence
from typing import Any

from experiments.guesses.belief import DOUBTFUL, SURE, Belief, Entry, Quantity
from experiments.guesses.log_contents import LogContents
from experiments.guesses.orientations import BASE
from experiments.guesses.wrenches import is_doubtful
from ident.files.csv_file import Layout
from ident.recordings.several_files import name_of

ORDER = (
    *("held", "frame", "position", "rpy_deg", "body", "on", "among", "applied_to_link"),
    *("force", "quaternion", "unit", "point", "point_unit", "free_moment", "torque", "torque_unit"),
)
"""Order of the lines of a wrench."""


def toml_text(contents: LogContents, belief: Belief, joints: Sequence[str]) -> str:
    """The mapping file, with doubtful, missing and unused columns in remarks.

    Args:
        contents: The log.
        belief: The belief about it.
        joints: The mechanism's joints.
    """
    name = _printable(name_of(contents.path))
    lines = [f"# Columns of {name}, guessed: correct what is wrong. Lines marked ? are guesses."]
    lines += [f"# Open: {_printable(sentence)}" for sentence in belief.open]
    lines += [f"# Note: {_printable(sentence)}" for sentence in belief.notes]
    lines += [*_times(contents), *_layouts(contents)]
    for joint in (joint for joint in joints if f"joints.{joint}" not in belief.poses):
        lines += _joint(joint, [x for x in belief.quantities.values() if x.joint == joint])
    for group in belief.poses.values():
        lines.append(f"[{BASE}]" if group.name == BASE else f"[joints.{_key(group.name)}]")
        lines += [_entry(key, entry) for key, entry in group.entries.items()]
    for group in belief.groups.values():
        mark = "# " if is_doubtful(group) else ""
        lines.append(f"{mark}[wrenches.{_key(group.name)}]")
        there = [(key, group.entries[key]) for key in ORDER if key in group.entries]
        lines += [mark + _entry(key, entry) for key, entry in there]
    if belief.unused:
        lines.append(f"# Columns that are not assigned: {', '.join(belief.unused)}")
    return "\n".join(lines) + "\n"


def _times(contents: LogContents) -> list[str]:
    """The line on the columns of times, one for all files or one for each."""
    entries = [clock.entry for clock in contents.clocks]
    if not entries:
        return []
    alike = all(each == entries[0] for each in entries)
    why = "; ".join(dict.fromkeys(clock.why for clock in contents.clocks))
    if alike and "rate" in entries[0]:
        return [_line("rate", entries[0]["rate"], why)]
    return [_line("time", entries[0] if alike else entries, why, guess=True)]


def _layouts(contents: LogContents) -> list[str]:
    """Lines on the layout of text, empty if all layouts are the default."""
    several = len(contents.layouts) > 1
    lines = []
    for layout in contents.layouts if any(layout != Layout() for layout in contents.layouts) else ():
        lines += ["[[file]]" if several else "[file]"]
        lines += [_line("header", layout.header, "the first row has numbers" * (not layout.header))]
        lines += [_line("skip", layout.skip, "lines before the table")] if layout.skip else []
    return lines


def _joint(joint: str, quantities: Sequence[Quantity]) -> list[str]:
    """Lines on a joint, only remarks if none of its columns is believed."""
    believed = any(x.sure != DOUBTFUL for x in quantities)
    lines = [f"{'' if believed else '# '}[joints.{_key(joint)}]"]
    if not any(x.kind == "position" for x in quantities):
        lines.append('# position = "?"    # no column')
    for x in quantities:
        mark = "# " if x.sure == DOUBTFUL else ""
        lines.append(mark + _line(x.kind, x.value, "; ".join(x.why), guess=x.sure != SURE or len(x.why) > 1))
    return lines


def _entry(key: str, entry: Entry) -> str:
    return _line(key, entry.value, entry.why, guess=entry.sure != SURE)


def _line(key: str, value: Any, why: str, *, guess: bool = False) -> str:
    mark = "? " if guess else ""
    return f"{key} = {_toml(value)}" + (f"    # {mark}{_printable(why)}" if why else "")


def _toml(value: Any) -> str:
    """A TOML value; assigned columns have no characters that JSON would escape differently."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _printable(text: str) -> str:
    """A text on one line, for a remark."""
    return "".join(c if c.isprintable() else " " for c in text)


def table(contents: LogContents, belief: Belief) -> list[str]:
    """Lines of a table of the beliefs: quantity, column, unit, certainty, and reasons."""
    rows = [("time", clock.column, clock.unit, "likely", clock.why) for clock in dict.fromkeys(contents.clocks)]
    for x in belief.quantities.values():
        unit = f"{x.gain:g} × {x.unit}" if x.gain != 1 else x.unit
        rows.append((x.key.removeprefix("joints."), x.column or "left out", unit, x.sure, "; ".join(x.why)))
    for group in (*belief.poses.values(), *belief.groups.values()):
        for key in (key for key in ORDER if key in group.entries):
            entry = group.entries[key]
            values = entry.value if isinstance(entry.value, list) else [entry.value]
            scaled = (f"{x['gain']:g} × {x['column']}" if isinstance(x, dict) else x for x in values)
            listed = ", ".join(str(each) if each != "" else "-" for each in scaled)
            rows.append((f"{group.name}.{key}", listed, "", entry.sure, entry.why))
    sizes = [max((len(row[k]) for row in rows), default=0) for k in range(4)]
    return ["  ".join([*(f"{cell:{size}}" for cell, size in zip(row, sizes, strict=False)), row[4]]) for row in rows]
