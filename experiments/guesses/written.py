"""Text of a mapping of columns with the reason for every line, to be corrected by hand."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.guesses.belief import DOUBTFUL, LIKELY, SURE, Belief, Quantity, TableEntry
from experiments.guesses.log_contents import LogContents
from ident.errors import InputError
from ident.files.atomic import replacing
from ident.files.csv_file import Layout
from ident.recordings.several_files import name_of

ORDER = (
    *("held", "frame", "position", "rpy_deg", "body", "on", "among", "applied_to_link"),
    *("force", "quaternion", "unit", "point", "point_unit", "free_moment", "torque", "torque_unit"),
)
"""Order of the lines of a wrench."""


def toml_text(belief: Belief) -> str:
    """The mapping file, with doubtful, missing and unused columns in remarks."""
    name = _printable(name_of(belief.log.path))
    lines = [f"# Columns of {name}, guessed: correct what is wrong. Lines marked ? are guesses."]
    lines += [f"# Open: {_printable(sentence)}" for sentence in belief.open]
    lines += [f"# Note: {_printable(sentence)}" for sentence in belief.notes]
    lines += _of_files(belief.log)
    for joint in (joint for joint in belief.mechanism.joints if f"joints.{joint}" not in belief.poses):
        lines += _of_joint(joint, [x for x in belief.quantities.values() if x.joint == joint])
    wrenches = {f"wrenches.{name}": group for name, group in belief.groups.items()}
    for table, group in {**belief.poses, **wrenches}.items():
        (room, _, name), mark = table.partition("."), "# " if table in wrenches and group.is_doubtful else ""
        lines.append(f"{mark}[{room}{'.' * bool(name)}{_key(name) if name else ''}]")
        lines += [mark + _line(key, each.value, each.why, each.sure) for key, each in _in_order(group.entries)]
    if belief.unused:
        lines.append(f"# Columns that are not assigned: {', '.join(belief.unused)}")
    return "\n".join(lines) + "\n"


def write_mapping(path: Path, belief: Belief, *, force: bool = False) -> None:
    """Writes the mapping.

    Raises:
        InputError: The file exists, and `force` is false.
    """
    if path.exists() and not force:
        raise InputError(f"'{path}' is there already; --force replaces it, --out NAME writes another.")
    with replacing(path) as temporary:
        temporary.write_text(toml_text(belief), encoding="utf-8")


def _in_order(entries: dict[str, TableEntry]) -> Iterator[tuple[str, TableEntry]]:
    """Lines of a wrench in their order."""
    return ((key, entries[key]) for key in ORDER if key in entries)


def _of_files(log: LogContents) -> list[str]:
    """Lines on the columns of times, one for all files or one for each, and on layouts that are not the default."""
    lines, several = list[str](), len(log.layouts) > 1
    if entries := [clock.entry for clock in log.clocks]:
        why = "; ".join(dict.fromkeys(clock.why for clock in log.clocks))
        lines.append(_line("time", entries if len(entries) > 1 else entries[0], why, LIKELY))
    for layout in log.layouts if any(layout != Layout() for layout in log.layouts) else ():
        header = _line("header", layout.header, "the first row has numbers" * (not layout.header))
        lines += ["[[file]]" if several else "[file]", header]
        lines += [_line("skip", layout.skip, "lines before the table")] if layout.skip else []
    return lines


def _of_joint(joint: str, quantities: list[Quantity]) -> list[str]:
    """Lines on a joint, only remarks if none of its columns is believed."""
    believed = any(x.sure != DOUBTFUL for x in quantities)
    lines = [f"{'' if believed else '# '}[joints.{_key(joint)}]"]
    if not any(x.kind == "position" for x in quantities):
        lines.append('# position = "?"    # no column')
    for x in quantities:
        mark, sure = "# " if x.sure == DOUBTFUL else "", x.sure if len(x.why) == 1 else LIKELY
        lines.append(mark + _line(x.kind, x.value, "; ".join(x.why), sure))
    return lines


def _line(key: str, value: Any, why: str, sure: str = SURE) -> str:
    return f"{key} = {_toml(value)}" + (f"    # {'? ' * (sure != SURE)}{_printable(why)}" if why else "")


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


def table(belief: Belief) -> list[str]:
    """Lines of a table of the beliefs: quantity, column, unit, certainty, and reasons."""
    clocks = [(clock.entry, clock.why) for clock in belief.log.clocks]
    rows = [("time", own.get("column", "counted"), own.get("unit", ""), LIKELY, why) for own, why in clocks]
    for x in belief.quantities.values():
        unit = f"{x.gain:g} × {x.unit}" if x.gain != 1 else x.unit
        rows.append((f"{x.joint}.{x.kind}", x.column or "left out", unit, x.sure, "; ".join(x.why)))
    for group in (*belief.poses.values(), *belief.groups.values()):
        for key, entry in _in_order(group.entries):
            values = entry.value if isinstance(entry.value, list) else [entry.value]
            scaled = (f"{x['gain']:g} × {x['column']}" if isinstance(x, dict) else x for x in values)
            listed = ", ".join(str(each) if each != "" else "-" for each in scaled)
            rows.append((f"{group.name}.{key}", listed, "", entry.sure, entry.why))
    sizes = [max((len(row[k]) for row in rows), default=0) for k in range(4)]
    return ["  ".join([*(f"{cell:{size}}" for cell, size in zip(row, sizes, strict=False)), row[4]]) for row in rows]
