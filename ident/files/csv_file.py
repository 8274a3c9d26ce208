"""Tables as text, perhaps packed by gzip: comments, a header row, a row of numbers for every sample, in little memory.

OpenSim's motion and storage files are such tables after a header of their own.
"""

import codecs
import csv
import gzip
import io
import json
import re
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs
from ident.errors import LogError
from ident.files.limits import LIMIT, LONGEST, NUMBER, check_size
from ident.files.table import METADATA, Memory, Table, is_number, number_of, short, vector_columns

TEXT = 64
"""Bytes that a string takes in addition to its characters."""

Cells = Sequence[str] | np.ndarray


class _Counted(io.RawIOBase):
    """Bytes of a packed file, counted since the last piece began."""

    def __init__(self, stream: gzip.GzipFile, path: Path, limit: int) -> None:
        self.stream, self.path, self.limit, self.count = stream, path, limit, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self.stream.read(len(buffer))
        buffer[: len(data)] = data
        self.count += len(data)
        check_size(self.path, self.count, self.limit)
        return len(data)


class Text(io.TextIOWrapper):
    """A text that is read in pieces, of which each may take so many bytes."""

    def __init__(self, buffer: io.BufferedReader, path: Path, limit: int) -> None:
        head, marks = buffer.peek(2)[:2], (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        # Without a mark every other byte of Latin letters and numbers is zero.
        bare = {(False, True): "utf-16-le", (True, False): "utf-16-be"}.get((head[:1] == b"\0", head[1:] == b"\0"))
        super().__init__(buffer, encoding="utf-16" if head in marks else bare or "utf-8-sig")
        self.path, self.limit = path, limit

    def begin_piece(self) -> None:
        """Resets the count of unpacked bytes at the start of a piece."""
        if isinstance(counted := getattr(self.buffer, "raw", None), _Counted):
            counted.count = 0

    def check_size(self, size: int) -> None:
        """Refuses a size in bytes above the limit, as `limits.check_size`."""
        check_size(self.path, size, self.limit)


@contextmanager
def opened_text(path: Path, limit: int = LIMIT) -> Iterator[Text]:
    """Opens a text file for the duration of a block.

    Args:
        path: The file; one whose name ends in `.gz` is unpacked.
        limit: Bytes that a piece of a packed file may have, as for `check_size`.

    Raises:
        LogError: A packed file is damaged, or too large when unpacked.
    """
    if path.suffix.lower() != ".gz":
        with path.open("rb") as stream:
            yield Text(stream, path, limit)
        return
    try:
        with gzip.open(path) as packed:
            yield Text(io.BufferedReader(_Counted(packed, path, limit)), path, limit)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise LogError(f"the file needs to be packed by gzip, whole and undamaged ({error}).") from None


def _numbers(name: str, cells: Cells, memory: Memory, decimal_comma: bool) -> Cells:
    """A column as numbers if all of its cells are numbers or empty, else as text with equal strings stored once.

    Its decimal separators are kept in `memory`.
    """
    marks = memory.marks.setdefault(name, set()) if decimal_comma else set()
    if isinstance(cells, np.ndarray):
        marks |= {"."} if decimal_comma and (np.abs(np.modf(cells)[0]) > 0).any() else set()
        return cells.copy()
    marks |= {mark for mark in ",." if any(mark in cell for cell in cells)}
    with suppress(ValueError):
        return np.array([number_of(cell, decimal_comma) for cell in cells])
    known: dict[str, str] = {}
    return [known.setdefault(cell, cell) for cell in cells]


def _joined(parts: Sequence[Cells]) -> Cells:
    """Parts of a column as one, which is text if any of them is."""
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate(parts)
    known: dict[str, str] = {}
    texts = (
        ["" if np.isnan(x) else repr(x) for x in part.tolist()] if isinstance(part, np.ndarray) else part
        for part in parts
    )
    return [known.setdefault(text, text) for part in texts for text in part]


def _size(cells: Mapping[str, Cells], rows: int) -> int:
    """Bytes that rows take, with their numbers."""
    texts = sum(sum(TEXT + len(text) for text in {*x}) for x in cells.values() if not isinstance(x, np.ndarray))
    return NUMBER * rows * (1 + len(cells)) + texts


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


def csv_pieces(path: Path, samples: int, *, layout: Layout | None = None, limit: int = LIMIT) -> Iterator[Table]:
    """Yields the file as tables of at most `samples` samples.

    Args:
        path: A text file, perhaps packed by gzip.
        samples: Samples of each piece.
        layout: Layout of the file.
        limit: Bytes that a piece of a packed file may have, as for `check_size`.

    Raises:
        LogError: The file is malformed; the message names the row.
    """
    layout = layout or Layout()
    with opened_text(path, limit) as text:
        for table in tables_of_lines(text, lines_of(text, layout.skip), samples, header=layout.header):
            yield table
            text.begin_piece()


def tables_of_lines(text: Text, lines: Iterator[Line], samples: int, *, header: bool = True) -> Iterator[Table]:
    """Yields a text as tables of at most `samples` rows; arguments as for `csv_pieces`."""
    metadata: dict[str, Any] = {}
    for first, line in lines:
        if not line.startswith("#"):
            break
        metadata |= _metadata(first, line)
    else:
        raise LogError("the file is empty; a log is a header row of names and rows of numbers.")
    delimiter = _delimiter(line)
    begin = next(_rows([(first, line)], delimiter))
    names = _header(first, begin) if header else [str(k + 1) for k in range(len(begin))]
    lines = lines if header else chain([(first, line)], lines)
    commas, memory = delimiter != ",", Memory()
    while True:
        blocks, size, left = list[tuple[np.ndarray, Mapping[str, Cells]]](), 0, samples
        while left and (new := list(islice(lines, min(left, BLOCK)))):
            columns = zip(names, _cells(new, names, delimiter), strict=True)
            cells = {name: _numbers(name, column, memory, commas) for name, column in columns if name}
            blocks.append((np.array([row for row, _ in new]), cells))
            size, left = size + _size(cells, len(new)), left - len(new)
            text.check_size(size)
        if left == samples:
            return
        rows = np.concatenate([rows for rows, _ in blocks])
        cells = {name: _joined([own[name] for _, own in blocks]) for name in blocks[0][1]}
        yield Table(cells, rows, "row", metadata, memory, commas)


def lines_of(text: Text, skip: int = 0) -> Iterator[Line]:
    """Lines of a text that are not blank, after the first `skip`.

    Raises:
        LogError: The text is not in UTF-8, or a line is longer than any row of a log.
    """
    number = 0
    try:
        while line := text.readline(LONGEST + 1):
            number += 1
            if len(line) > LONGEST:
                raise LogError(f"row {number} is longer than {LONGEST} characters, which no row of a log is.")
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
    for keys, number, what in (
        (("nrows", "datarows"), len(table.rows), "rows"),
        (("ncolumns", "datacolumns"), len(table.cells), "columns"),
    ):
        for key in keys:
            if key in header and header[key] != str(number):
                raise LogError(f"the header promises {short(header[key])} {what} ({key}), the table has {number}.")
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
