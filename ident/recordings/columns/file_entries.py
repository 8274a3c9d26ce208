"""Entries of a mapping file on the files themselves: layout of text, columns of times, and selection."""

from collections.abc import Mapping
from typing import Any

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.counted import clock_of_rate
from ident.files.csv_file import Layout
from ident.files.entries import check_keys, made, table, vector
from ident.files.selection import Selection, Span
from ident.recordings.columns.column_entries import single


def layouts(entries: Mapping[str, Any]) -> tuple[Layout, ...]:
    """Layouts of text files: one for all from `[file]`, or one for each file from `[[file]]`.

    Raises:
        LogError: An entry is malformed; likewise for all functions here.
    """
    entry = entries.get("file", {})
    if not isinstance(entry, list):
        return (made(Layout, "file", entry),)
    return tuple(made(Layout, f"file {k}", each) for k, each in enumerate(entry, start=1)) or (Layout(),)


def clocks(entries: Mapping[str, Any]) -> tuple[Columns, ...]:
    """Columns of times: one for all files, or one for each; empty if the mapping has none."""
    if "rate" in entries:
        if "time" in entries:
            raise LogError("the mapping has time and rate; rate is for a log without times, keep one of them.")
        return (clock_of_rate("rate", entries["rate"]),)
    entry = entries.get("time", [])
    if not isinstance(entry, list):
        return (_clock("time", entry),)
    if "time" in entries and not entry:
        raise LogError("time needs the column of times of each file, got an empty list.")
    return tuple(_clock(f"time {k}", each) for k, each in enumerate(entry, start=1))


def _clock(where: str, entry: Any) -> Columns:
    """A column of times, or of sample counts for `{ rate = HZ }`."""
    if isinstance(entry, dict) and "rate" in entry:
        check_keys(where, entry, ("rate",))
        return clock_of_rate(f"{where}.rate", entry["rate"])
    return single(where, entry, "time")


def selection(entries: Mapping[str, Any]) -> Selection:
    """Rows and times that are selected."""
    entry = table("select", entries.get("select", {}))
    check_keys("[select]", entry, ("rows", "time"))
    return Selection(*(_spans(f"select.{key}", entry.get(key, [])) for key in ("rows", "time")))


def _spans(where: str, value: Any) -> tuple[Span, ...]:
    """One span `[FIRST, LAST]`, or a list of them."""
    several = value if isinstance(value, list) and all(isinstance(each, list) for each in value) else [value]
    spans = [tuple(vector(where, each, 2).tolist()) for each in several]
    for first, last in spans:
        if last <= first:
            raise LogError(f"{where} needs the first before the last, got [{first:g}, {last:g}].")
    return tuple(spans)
