"""Columns of LaTeX tables: their types, and their approximate widths before LaTeX sets them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from experiments.document.symbols import SYMBOL

NUMBER = re.compile(r"(-?)(\d+)(?:\.(\d+))?(?:e([+-]?)0*(\d+))?")
"""A number of an `S` column: sign, whole digits, decimals, sign and digits of the exponent."""


@dataclass(frozen=True)
class Size:
    """A font size: its LaTeX command, and approximate widths of letters and gaps and height of lines, pt."""

    command: str
    letter: float
    gap: float
    line: float


NORMAL = Size(r"\footnotesize", 4.4, 12.0, 9.6)
SMALL = Size(r"\scriptsize\setlength{\tabcolsep}{3pt}", 3.9, 6.0, 8.1)

NARROW = 10
"""Largest number of letters in a line of a head, if its words permit."""

LONG = 28
"""Number of letters above which a cell may break into lines."""


@dataclass(frozen=True)
class Column:
    """A column: words of its head, the remark it shares with its neighbours, cells, and True if these are numbers."""

    head: str
    remark: str
    cells: Sequence[str]
    numeric: bool

    @property
    def long(self) -> bool:
        """True if its cells may break into lines."""
        return not self.numeric and max(map(letters_of, self.cells), default=0) > LONG

    @property
    def format(self) -> str:
        """Column type in the preamble."""
        if self.long:
            return r">{\raggedright\arraybackslash}X"
        if not self.numeric:
            return "l"
        return f"S[table-format={self.shape}]" if self.shape else "c"

    @cached_property
    def shape(self) -> str:
        """Room for its numbers as siunitx wants it, `-2.3e1`; empty if there are none."""
        numbers = [match for cell in self.cells if (match := NUMBER.fullmatch(cell))] if self.numeric else []
        if not numbers:
            return ""
        sign = "-" if any(match[1] for match in numbers) else ""
        whole, decimals, power = (max(len(match[k] or "") for match in numbers) for k in (2, 3, 5))
        exponent = f"e{'-' if any(match[4] == '-' for match in numbers) else ''}{power}" if power else ""
        return f"{sign}{whole}.{decimals}{exponent}"

    @property
    def _room(self) -> int:
        """Letters of a number with as many digits before and after the point as any of its numbers."""
        return sum(int(each) if each.isdigit() else 1 for each in re.findall(r"\d+|[^\d]", self.shape))

    def width(self, size: Size) -> float:
        """Approximate smallest width, pt."""
        words = max(len(line) for line in (*lines_of(self.head), *lines_of(self.remark)))
        widest = max([words, self._room, *(min(letters_of(cell), LONG) for cell in self.cells)])
        return size.letter * widest + size.gap


def lines_of(head: str) -> list[str]:
    """Lines of a head, split before brackets and after commas; long ones are broken in the middle."""
    lines = []
    for k, part in enumerate(re.split(r", | (?=\()", head)):
        words = (capital(part) if k == 0 else part).split(" ")
        while len(" ".join(words)) > NARROW and len(words) > 1:
            cut = min(range(1, len(words)), key=lambda n: abs(len(" ".join(words[:n])) - len(" ".join(words[n:]))))
            lines.append(" ".join(words[:cut]))
            words = words[cut:]
        lines.append(" ".join(words))
    return lines


def capital(text: str) -> str:
    """A head with a capital letter, unless it is a symbol."""
    return text if len(text) == 1 or SYMBOL.fullmatch(text) else text[:1].upper() + text[1:]


def letters_of(cell: str) -> int:
    """Approximate number of letters that a LaTeX cell shows."""
    return len(re.sub(r"\\[A-Za-z]+|[${}\\_]", "", cell))
