"""Tables as text: comments, a header row, a row of numbers for every sample; and OpenSim's motion and storage files."""

import csv
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs
from ident.errors import LogError
from ident.files.limits import LIMIT
from ident.files.table import METADATA, Memory, Table, is_number, short, vector_columns
from ident.files.text_file import Block, Text, opened_text

DELIMITERS = ";\t,"
"""Delimiters in order of preference: the first that occurs in the header, or else spaces. Decimal commas are accepted
unless the comma is the delimiter."""

BLOCK = 4096
"""Rows that are held as text in memory at a time."""

Line = tuple[int, str]
"""A line of a file with its number, from 1."""

ANGLES = {"yes": "deg", "no": "SI"}
"""Units of the columns by the header's `inDegrees`; lengths and forces are in SI units either way."""


@dataclass(frozen=True)
class Layout:
    """Layout of a text file.

    Attributes:
        header: True if the first row has names; otherwise columns are called 1, 2, 3 and so on.
        skip: Number of lines before that row, comments that begin with # included.
    """

    header: bool = True
    skip: Annotated[int, Needs("a number of lines", lambda x: x >= 0)] = 0


def write_csv(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Writes a recording's channels, including the time.

    Args:
        path: File to write.
        channels: Channels (N,) or (N, d) by name; those of true values begin with `TRUE`.
        metadata: Metadata of JSON's types.
    """
    columns: dict[str, np.ndarray] = {}
    for name, x in channels.items():
        columns |= vector_columns(name, x)
    with path.open("w", encoding="utf-8") as stream:
        stream.writelines(f"# {key}: {json.dumps(value)}\n" for key, value in metadata.items())
        stream.write(",".join(map(_quoted, columns)) + "\n")
        table = np.stack(list(columns.values()), axis=1)
        stream.writelines(",".join(map(repr, row.tolist())) + "\n" for row in table)


def _quoted(name: str) -> str:
    """The name as a cell, quoted if it contains a delimiter or a quotation mark."""
    return '"' + name.replace('"', '""') + '"' if any(c in name for c in f'"{DELIMITERS}') else name


def csv_pieces(
    path: Path, samples: int, *, overlap: int = 0, layout: Layout | None = None, limit: int = LIMIT
) -> Iterator[Table]:
    """Yields the file as tables of at most `samples` samples.

    Args:
        path: A text file, perhaps packed by gzip.
        samples: Samples of each piece.
        overlap: Samples that each piece repeats from the end of the one before.
        layout: Layout of the file.
        limit: Bytes that a piece of a packed file may have, as for `check_size`.

    Raises:
        LogError: The file is malformed; the message names the row.
    """
    layout = layout or Layout()
    with opened_text(path, limit) as text:
        for table in tables_of_lines(text, lines_of(text, layout.skip), samples, overlap=overlap, header=layout.header):
            yield table
            text.begin_piece()


def tables_of_lines(
    text: Text, lines: Iterator[Line], samples: int, *, overlap: int = 0, header: bool = True
) -> Iterator[Table]:
    """Yields a text as tables of at most `samples` rows; arguments as for `csv_pieces`."""
    metadata: dict[str, Any] = {}
    for first, line in lines:
        if not line.startswith("#"):
            break
        metadata |= _metadata(first, line)
    else:
        raise LogError("the file is empty; a log is a header row of names and rows of numbers.")
    delimiter = _delimiter(line)
    cells = next(_rows([(first, line)], delimiter))
    names = _header(first, cells) if header else [str(k + 1) for k in range(len(cells))]
    lines = lines if header else chain([(first, line)], lines)
    memory, kept = Memory(), list[Block]()
    while True:
        blocks, size, left = [*kept], sum(block.size for block in kept), samples
        while left and (new := list(islice(lines, min(left, BLOCK)))):
            columns = zip(names, _cells(new, names, delimiter), strict=True)
            named = {name: column for name, column in columns if name}
            blocks.append(Block.of([row for row, _ in new], named, memory, delimiter != ","))
            size, left = size + blocks[-1].size, left - len(new)
            text.check_size(size)
        if left == samples:
            return
        piece = Block.joined(blocks)
        yield Table(piece.cells, piece.rows, "row", metadata, memory, delimiter != ",")
        kept = [piece.last(overlap)] if overlap else []


def lines_of(text: Text, skip: int = 0) -> Iterator[Line]:
    """Lines of a text that are not blank, after the first `skip`.

    Raises:
        LogError: The text is not in UTF-8.
    """
    try:
        for number, line in enumerate(text.whole_lines(), start=1):
            if number > skip and line.strip(' "\n' + DELIMITERS):
                yield number, line
    except UnicodeDecodeError as error:
        raise LogError(
            f"the file needs to be text in UTF-8, a byte 0x{error.object[error.start]:02x} is not."
        ) from None


def _metadata(number: int, remark: str) -> dict[str, Any]:
    """Metadata of a comment `# NAME: JSON` with a name of `METADATA`; empty for any other comment."""
    key, _, text = remark[1:].partition(":")
    key = key.strip()
    if key not in METADATA or not text.lstrip().startswith("{" if METADATA[key] is dict else "["):
        return {}
    try:
        return {key: json.loads(text)}
    except (ValueError, RecursionError) as error:
        raise LogError(f"row {number} needs '{key}' in JSON ({error}).") from None


def _delimiter(line: str) -> str | None:
    """Delimiter between the cells of a line; None for spaces."""
    outside_quotes = re.sub('"[^"]*"', "", line).strip()
    spaces = None if " " in outside_quotes else ","
    return next((d for d in DELIMITERS if d in outside_quotes), spaces)


def _header(number: int, header: list[str]) -> list[str]:
    """Names of the columns, "" for those without."""
    names = [name for name in header if name]
    if not names or any(map(is_number, names)):
        raise LogError(
            f"a log needs a header row of names, row {number} holds numbers or nothing; where there is none, say so in "
            "the mapping: header = false under [file]."
        )
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise LogError(f"the header names column '{short(twice[0])}' more than once.")
    return header


def _cells(block: Sequence[Line], header: Sequence[str], delimiter: str | None) -> Iterable[Sequence[str] | np.ndarray]:
    """Columns of some lines, as numbers if all cells are numbers."""
    lines = [line for _, line in block]
    # Numpy is faster and accepts nothing that `float` does not, but its errors do not name the row.
    with suppress(ValueError):
        table = np.loadtxt(lines, delimiter=delimiter, comments=None, ndmin=2)
        if table.shape[1] == len(header):
            return table.T
    rows = list(_rows(block, delimiter))
    for (number, _), row in zip(block, rows, strict=True):
        if len(row) < len(header) or any(row[len(header) :]):
            raise LogError(f"row {number} has {len(row)} cells where the header has {len(header)}.")
    return [[row[k] for row in rows] for k in range(len(header))]


def _rows(block: Sequence[Line], delimiter: str | None) -> Iterator[list[str]]:
    """Cells of each line."""
    if delimiter is None:
        yield from (line.split() for _, line in block)
        return
    reader = csv.reader((line for _, line in block), delimiter=delimiter)
    for number, _ in block:
        try:
            row = next(reader)
        except csv.Error as error:
            raise LogError(f"row {number} is no row of a CSV file ({error}).") from None
        if any("\n" in cell for cell in row):
            raise LogError(f"row {number} opens a quotation mark that it does not close.")
        yield [cell.strip() for cell in row]


def storage_tables(path: Path, limit: int) -> list[Table]:
    """The table of a motion or storage file.

    Raises:
        LogError: The header is incomplete, contradicts the table or does not end, or the table is malformed.
    """
    with opened_text(path, limit) as text:
        lines = lines_of(text)
        header = _entries(lines)
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


def _entries(lines: Iterator[Line]) -> dict[str, str]:
    """Entries of the header in lower case, written as `key=value` or, in older files, `key value`."""
    entries: dict[str, str] = {}
    for _, line in lines:
        if line.strip().lower() == "endheader":
            return entries
        key, _, value = line.strip().lower().replace("=", " ").partition(" ")
        entries[key.strip()] = value.strip()
    raise LogError("a motion or storage file needs a line 'endheader' before its table; there is none.")
