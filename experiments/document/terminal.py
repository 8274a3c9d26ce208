"""Text for a terminal with lines of at most `WIDTH`: sentences, and tables with aligned columns."""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH = 120
"""Largest number of letters in a line."""

GAP = 2
"""Spaces between the columns of a table."""

FILLER = "\N{NO-BREAK SPACE}"
"""Space at which lines do not break, and that stays at their ends."""

NARROW, LONG = 10, 20
"""Smallest width of a head's line, and the width above which a cell may break into lines."""


def wrapped(text: str) -> str:
    """A text whose long lines break between words; further lines of a dashed item are indented."""
    return "\n".join(_broken(line) for line in text.split("\n"))


def sentences(text: str) -> list[str]:
    """Sentences of a text, split where a capital letter follows a full stop.

    >>> sentences("At 0.5 s. Then (Eq. 3) more.")
    ['At 0.5 s.', 'Then (Eq. 3) more.']
    """
    return re.split(r"(?<=[.!?]) (?=[A-Z])", text)


def _broken(line: str) -> str:
    if len(line) <= WIDTH:
        return line
    lead = re.match(r" *(- )?", line)
    indent = " " * (len(lead[0]) if lead else 0)
    return "\n".join(_lines(line, WIDTH, indent))


def _lines(text: str, width: int, indent: str = "") -> list[str]:
    """Lines of a text of at most this width, if its words permit."""
    broken = textwrap.wrap(
        text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
    )
    return broken or [""]


def wrapped_sums(text: str) -> str:
    """A text with sums of parameters, in which a coefficient and the parameter after it stay in one line."""
    return "\n".join(_lines_of_sums(text, WIDTH))


def _lines_of_sums(text: str, width: int) -> list[str]:
    """Lines of such a text of at most this width, if its words permit."""
    joined = re.sub(r"(?<=\d) (?=[A-Za-z])|(?<=[-+]) ", FILLER, text)
    return [line.replace(FILLER, " ") for line in _lines(joined, width)]


@dataclass(frozen=True)
class _Column:
    """A column of cells below a head; numbers are right-aligned."""

    head: str
    cells: Sequence[str]
    numeric: bool

    @property
    def natural(self) -> int:
        """Width without line breaks."""
        return max(len(self.head), self.widest)

    @property
    def widest(self) -> int:
        """Width of the cells without line breaks."""
        return max(map(len, self.cells), default=0)

    @property
    def least(self) -> int:
        """Smallest width, with line breaks in the head and in long cells."""
        words = max(map(len, self.head.split()), default=0)
        cells = self.widest if self.numeric else min(self.widest, LONG)
        return max(cells, words, min(len(self.head), NARROW))

    def block(self, text: str, width: int) -> list[str]:
        """Lines of the head or of a cell; a number and the parameter after it stay together."""
        lines = _lines_of_sums(text, width)
        return [line.rjust(width) if self.numeric else line.ljust(width) for line in lines]


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[bool]) -> list[str]:
    """Lines of a table; heads and long cells break, and columns that do not fit follow below the others.

    Args:
        headings: Heads of the c columns.
        rows: Cells as text (r, c).
        numeric: True for each column of numbers.
    """
    cells = list(zip(*rows, strict=True)) or [()] * len(headings)
    columns = [_Column(*each) for each in zip(headings, cells, numeric, strict=True)]
    if _total([column.natural for column in columns]) <= WIDTH:
        return _drawn(columns, [column.natural for column in columns])
    lines: list[str] = []
    for part in _parts(columns):
        lines += [*[""] * bool(lines), *_drawn(part, _widths(part), skip=bool(lines))]
    return lines


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + GAP * (len(widths) - 1)


def _parts(columns: Sequence[_Column]) -> list[list[_Column]]:
    """Sets of columns that fit, each beginning with the first column."""
    parts = [[columns[0]]]
    for column in columns[1:]:
        if len(parts[-1]) > 1 and _total([each.least for each in (*parts[-1], column)]) > WIDTH:
            parts.append([columns[0]])
        parts[-1].append(column)
    return parts


def _widths(columns: Sequence[_Column]) -> list[int]:
    """Widths of columns: the smallest of each; the rest of the line goes to cells, then to heads."""
    widths = [column.least for column in columns]
    for wanted in ([column.widest for column in columns], [column.natural for column in columns]):
        for k, width in enumerate(wanted):
            widths[k] += max(0, min(width - widths[k], WIDTH - _total(widths)))
    return widths


def _drawn(columns: Sequence[_Column], widths: Sequence[int], *, skip: bool = False) -> list[str]:
    """Lines of the heads, bottom-aligned, and of all rows, or with `skip` of those with more than a first cell."""
    heads = [column.block(column.head, width) for column, width in zip(columns, widths, strict=True)]
    highest = max(map(len, heads))
    blocks = [[[" " * w] * (highest - len(head)) + head for head, w in zip(heads, widths, strict=True)]]
    for row in zip(*(column.cells for column in columns), strict=True):
        if skip and not any(row[1:]):
            continue
        blocks.append([c.block(cell, w) for c, cell, w in zip(columns, row, widths, strict=True)])
    lines = []
    for block in blocks:
        for k in range(max(map(len, block))):
            line = (cell[k] if k < len(cell) else " " * w for cell, w in zip(block, widths, strict=True))
            lines.append((" " * GAP).join(line).rstrip())
    return lines
