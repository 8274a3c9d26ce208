"""OpenSim's motion and storage files, `.mot` and `.sto`: a header that ends with `endheader`, then a table of text."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ident.errors import LogError
from ident.files.csv_file import Line, lines_of, tables_of_lines
from ident.files.table import Table, short
from ident.files.text_file import opened_text

ANGLES = {"yes": "deg", "no": "SI"}
"""Units of the columns by the header's `inDegrees`; lengths and forces are in SI units either way."""


def tables(path: Path, limit: int) -> list[Table]:
    """The table of a motion or storage file.

    Raises:
        LogError: The header is incomplete, contradicts the table or does not end, or the table is malformed.
    """
    with opened_text(path, limit) as text:
        lines = lines_of(text)
        header = _header(lines)
        pieces = list(tables_of_lines(text, lines, sys.maxsize))
    if not pieces:
        raise LogError("the file has no rows after its header, which names the columns.")
    (table,) = pieces
    for keys, count, what in (
        (("nrows", "datarows"), len(table.rows), "rows"),
        (("ncolumns", "datacolumns"), len(table.cells), "columns"),
    ):
        for key in keys:
            if key in header and header[key] != str(count):
                raise LogError(f"the header promises {short(header[key])} {what} ({key}), the table has {count}.")
    degrees = header.get("indegrees")
    if degrees not in (None, *ANGLES):
        raise LogError(f"the header's inDegrees needs to be yes or no, got '{short(degrees)}'.")
    return [replace(table, units={} if degrees is None else dict.fromkeys(table.cells, ANGLES[degrees]))]


def _header(lines: Iterator[Line]) -> dict[str, str]:
    """Entries of the header in lower case, written as `key=value` or, in older files, `key value`."""
    entries: dict[str, str] = {}
    for _, line in lines:
        if line.strip().lower() == "endheader":
            return entries
        key, _, value = line.strip().lower().replace("=", " ").partition(" ")
        entries[key.strip()] = value.strip()
    raise LogError("a motion or storage file needs a line 'endheader' before its table; there is none.")
