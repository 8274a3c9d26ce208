"""Text files in UTF-8 or UTF-16, perhaps packed by gzip, and their rows as numbers or text in little memory."""

import codecs
import gzip
import io
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.files.limits import LIMIT, LONGEST, NUMBER, check_size
from ident.files.table import Memory, number_of

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
    """Lines of a text that is read in pieces."""

    path: Path
    limit: int

    def begin_piece(self) -> None:
        """Resets the count of unpacked bytes at the start of a piece."""
        if isinstance(counted := getattr(self.buffer, "raw", None), _Counted):
            counted.count = 0

    def check_size(self, size: int) -> None:
        """Refuses a size in bytes above the limit, as `limits.check_size`."""
        check_size(self.path, size, self.limit)

    def whole_lines(self) -> Iterator[str]:
        """Its lines.

        Raises:
            LogError: One is longer than any row of a log.
        """
        for number in count(1):
            if not (line := self.readline(LONGEST + 1)):
                return
            if len(line) > LONGEST:
                raise LogError(f"row {number} is longer than {LONGEST} characters, which no row of a log is.")
            yield line


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
            yield _text(stream, path, limit)
        return
    try:
        with gzip.open(path) as packed:
            yield _text(io.BufferedReader(_Counted(packed, path, limit)), path, limit)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise LogError(f"the file needs to be packed by gzip, whole and undamaged ({error}).") from None


def _text(buffer: io.BufferedReader, path: Path, limit: int) -> Text:
    utf16 = buffer.peek(2)[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    text = Text(buffer, encoding="utf-16" if utf16 else "utf-8-sig")
    text.path, text.limit = path, limit
    return text


@dataclass(frozen=True, eq=False)
class Block:
    """Some rows of a text.

    Attributes:
        rows: Number of each in the file (N,).
        cells: Columns by name, numbers or text (N,) each.
        size: Bytes that they take.
    """

    rows: np.ndarray
    cells: Mapping[str, Cells]
    size: int

    @classmethod
    def of(cls, rows: Sequence[int], cells: Mapping[str, Cells], memory: Memory, decimal_comma: bool) -> "Block":
        """Parses columns into numbers where possible, and records their decimal separators in `memory`."""
        numbers = {name: _numbers(name, column, memory, decimal_comma) for name, column in cells.items()}
        size = NUMBER * len(rows) * (1 + len(cells))
        size += sum(sum(TEXT + len(text) for text in {*x}) for x in numbers.values() if not isinstance(x, np.ndarray))
        return cls(np.asarray(rows), numbers, size)

    @classmethod
    def joined(cls, blocks: Sequence["Block"]) -> "Block":
        """Rows of several blocks in one; columns that are text in any of them become text."""
        cells = {name: _joined([block.cells[name] for block in blocks]) for name in blocks[0].cells}
        return cls(np.concatenate([block.rows for block in blocks]), cells, sum(block.size for block in blocks))

    def last(self, number: int) -> "Block":
        """The last rows."""
        first = max(0, len(self.rows) - number)
        return Block(self.rows[first:], {name: x[first:] for name, x in self.cells.items()}, 0)


def _numbers(name: str, cells: Cells, memory: Memory, decimal_comma: bool) -> Cells:
    """A column as numbers if all of its cells are numbers or empty, else as text with equal strings stored once."""
    if isinstance(cells, np.ndarray):
        if decimal_comma and (np.abs(np.modf(cells)[0]) > 0).any():
            memory.marks.setdefault(name, set()).add(".")
        return cells.copy()
    if decimal_comma:
        memory.marks.setdefault(name, set()).update(mark for mark in ",." if any(mark in cell for cell in cells))
    with suppress(ValueError):
        return np.array([number_of(cell, decimal_comma) for cell in cells])
    known: dict[str, str] = {}
    return [known.setdefault(cell, cell) for cell in cells]


def _joined(parts: Sequence[Cells]) -> Cells:
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate(parts)
    known: dict[str, str] = {}
    texts = (_texts(part) if isinstance(part, np.ndarray) else part for part in parts)
    return [known.setdefault(text, text) for part in texts for text in part]


def _texts(numbers: np.ndarray) -> list[str]:
    return ["" if np.isnan(x) else repr(x) for x in numbers.tolist()]
