"""Text for a terminal with lines of at most `WIDTH`: sentences, and tables with aligned columns."""

import re
import textwrap
from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import TypeVar

from ident.display.brief import WIDTH

C = TypeVar("C")

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


class _Column:
    """A column of cells below a head; numbers are right-aligned.

    Attributes:
        widest: Width of the cells without line breaks.
        natural: Width without line breaks.
        least: Smallest width, with line breaks in the head and in long cells.
    """

    def __init__(self, head: str, cells: Sequence[str], numeric: bool) -> None:
        self.head, self.cells, self.numeric = head, cells, numeric
        self.widest = max(map(len, cells), default=0)
        self.natural = max(len(head), self.widest)
        words = max(map(len, head.split()), default=0)
        self.least = max(self.widest if numeric else min(self.widest, LONG), words, min(len(head), NARROW))

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
    for part in parts(columns, 1, lambda part: _total([each.least for each in part]) <= WIDTH):
        lines += [*[""] * bool(lines), *_drawn(part, _widths(part), skip=bool(lines))]
    return lines


def _total(widths: Sequence[int]) -> int:
    """Width of columns with two spaces between them."""
    return sum(widths) + 2 * (len(widths) - 1)


def parts(columns: Sequence[C], keys: int, fits: Callable[[Sequence[C]], bool]) -> list[list[C]]:
    """The columns, in as many sets as it takes for each to fit; all sets begin with the first `keys` columns."""
    out = [list(columns[:keys])]
    for column in columns[keys:]:
        if len(out[-1]) > keys and not fits([*out[-1], column]):
            out.append(list(columns[:keys]))
        out[-1].append(column)
    return out


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
    blocks = [[[""] * (highest - len(head)) + head for head in heads]]
    for row in zip(*(column.cells for column in columns), strict=True):
        if any(row[1:]) or not skip:
            blocks.append([c.block(cell, w) for c, cell, w in zip(columns, row, widths, strict=True)])
    lines = []
    for block in blocks:
        for cells in zip_longest(*block, fillvalue=""):
            line = (cell.ljust(w) for cell, w in zip(cells, widths, strict=True))
            lines.append("  ".join(line).rstrip())
    return lines
