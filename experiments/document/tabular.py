"""Tables: decimals and texts of their cells, and their forms for spreadsheets, Markdown and the terminal."""

import csv
import io
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from numbers import Integral

from experiments.document import symbols, terminal
from ident.display.text import decimals_beside, decimals_of
from ident.estimation.noise import unit_of
from ident.geometry.inertia import body_of_parameter

LEAST = 12
"""Largest number of decimals; numbers whose standard deviations need more are rounded, or powers of ten if smaller."""

HUGE = 1e6
"""Size from which numbers are powers of ten."""

Decimals = Sequence[int | None]
"""Decimals of each row of a column, negative for tens and hundreds; None for the table's."""

DAGGER = "†"
"""Mark of regrouped parameters."""

SUMS = "regrouping"
"""Column with the sums that parameters stand for."""

UNITS = ("deg", "rad", "N", "s", "mm")
"""Units at the end of names of columns, options and other numbers."""


def number(value: float, decimals: int = 3) -> str:
    """A number as text with so many decimals, or as a power of ten if it is large or small.

    Integers, also numpy's, have no decimals; booleans have.

    >>> [number(2.5187, 3), number(1234.0, -1), number(2e6), number(2e6, -4), number(3.14e-14, 15), number(7)]
    ['2.519', '1230', '2.00e+06', '2.00e+06', '3.1e-14', '7']
    """
    if is_whole(value):
        return str(value)
    if abs(value) >= HUGE:
        power = int(f"{value:e}".partition("e")[2])
        return f"{value:.{2 if decimals > 0 else max(power + decimals, 0)}e}"
    if decimals > LEAST and 0 < abs(value) < 0.5 * 10**-LEAST:
        return f"{value:.1e}"
    shown = min(decimals, LEAST)
    # Adding zero turns a rounded -0.0 into 0.0.
    return f"{round(value, shown) + 0.0:.{max(shown, 0)}f}"


def is_whole(value: float) -> bool:
    """True for a count, by its type."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def of_numbers(std: Iterable[float | None]) -> Decimals:
    """Decimals of numbers with these standard deviations."""
    return tuple(map(decimals_of, std))


def of_deviations(std: Iterable[float | None]) -> Decimals:
    """Decimals of the standard deviations themselves; none if one is zero."""
    return tuple(0 if x == 0 else decimals_of(x) for x in std)


def as_stated(numbers: Iterable[float]) -> int:
    """Decimals of a set of stated numbers: those of the one that has most.

    >>> as_stated([0.32, -1.0, 20.99])
    2
    """
    exponents = (Decimal(repr(float(x))).normalize().as_tuple().exponent for x in numbers if math.isfinite(x))
    return max([0, *(-int(exponent) for exponent in exponents)])


def lacking(texts: Sequence[str]) -> list[str]:
    """Text that each number lacks to have all the decimals of its column, so that decimal points can be aligned.

    >>> lacking(["1.25", "-30", "0.1", "2.00e+06", ""])
    ['', '.00', '0', '', '']
    """
    parts = [re.fullmatch(r"[-+]?\d+(?:\.(\d+))?", text) for text in texts]
    most = max((len(part[1] or "") for part in parts if part), default=0)
    return ["" if part is None else ("." + "0" * most)[_shown(part[1], most) :] for part in parts]


def _shown(decimals: str | None, most: int) -> int:
    """Letters of a column's decimals, with their point, that a number has."""
    return 1 + len(decimals) if decimals else 0 if most else 1


@dataclass(frozen=True)
class Regrouped:
    """Sums that parameters stand for.

    Attributes:
        sums: Sums by model, each beginning with the name of its parameter; the model is empty if there is one only.
    """

    sums: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @classmethod
    def of(cls, sums: Mapping[str, Sequence[str]]) -> "Regrouped":
        """Sums by model, without the models' names if they are the same for all."""
        first, *others = sums.values()
        return cls(sums if any(each != first for each in others) else {"": first})

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the parameters that stand for several in some model."""
        return frozenset(_name(each) for sums in self.sums.values() for each in sums if each != _name(each))

    def sentence(self, shown: Collection[object], *, column: bool) -> str:
        """Sentence with the sums of the shown parameters, or on the table's column that has them."""
        if column:
            return "Regrouped with other parameters: the sum is in the column of regroupings."
        kept = {model: [each for each in sums if self._counts(each, shown)] for model, sums in self.sums.items()}
        parts = [(model, ", ".join(sums)) for model, sums in kept.items() if sums]
        listed = "; ".join(f"{model}: {sums}" if model else sums for model, sums in parts)
        return f"Regrouped sums{', ' if parts[0][0] else ': '}{listed}."

    @staticmethod
    def _counts(terms: str, shown: Collection[object]) -> bool:
        """True for a sum of several terms that belongs to a shown parameter."""
        return _name(terms) in shown and terms != _name(terms)


def _name(terms: str) -> str:
    """Name of the parameter that stands for a sum, its first term."""
    return terms.split(" ", 1)[0]


Cell = str | float | None


@dataclass(frozen=True)
class Table:
    """A table of results.

    Attributes:
        title: Title, for the screen and for pages.
        columns: Column names of the CSV file; elsewhere `heading`s of them.
        rows: Cells: texts, numbers, or None if empty; empty columns are in the CSV file alone.
        decimals: Decimals of numbers, except in the CSV file, which keeps all digits; counts have none.
        deviations: Columns of standard deviations by the columns of their estimates; both have decimals that leave the
            standard deviation two digits.
        digits: Decimals of other columns, a number for each row, in place of `decimals`.
        marked: First cells of the rows that get an asterisk, except in the CSV file.
        footnote: Meaning of the asterisk.
        regrouped: Parameters that stand for sums, which get a dagger, except in the CSV file.
        caption: Caption in print, by default the title.
        notes: Further notes in print.
        bodies: Names of the bodies of the parameters in the first column, numbered from 1.
        units: Units of the rows, by default those of the parameters if there are bodies.
        heads: Headings that `heading` would not form.
        names: Texts that replace first cells, except in the CSV file.
        carriers: Bodies by the joints that move them, whose drives stand beside their parameters on pages.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    decimals: int = 3
    deviations: Mapping[str, str] = field(default_factory=dict)
    digits: Mapping[str, Decimals] = field(default_factory=dict)
    marked: frozenset[str] = frozenset()
    footnote: str = ""
    regrouped: Regrouped = field(default_factory=Regrouped)
    caption: str = ""
    notes: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    heads: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    carriers: Mapping[str, str] = field(default_factory=dict)

    def csv(self) -> str:
        """Comma-separated values with full precision; if bodies have names, a column holds each parameter's body.

        Texts that spreadsheets would read as formulas follow an apostrophe.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        owners = [body_of_parameter(str(row[0]), self.bodies) for row in self.rows] if self.bodies else []
        first, *more = self.columns
        writer.writerow(map(symbols.cell, [first, *["body"] * bool(owners), *more]))
        for k, row in enumerate(self.rows):
            cells = [row[0], *owners[k : k + 1], *row[1:]]
            writer.writerow([symbols.cell(cell) if isinstance(cell, str) else cell for cell in cells])
        return out.getvalue()

    def filled(self) -> "Table":
        """The table without empty columns."""
        kept = [k for k in range(len(self.columns)) if k == 0 or any(row[k] not in (None, "") for row in self.rows)]
        if not self.rows or len(kept) == len(self.columns):
            return self
        columns = tuple(self.columns[k] for k in kept)
        return replace(self, columns=columns, rows=tuple(tuple(row[k] for k in kept) for row in self.rows))

    def markdown(self) -> str:
        """A Markdown table under its title, numbers right-aligned."""
        if (filled := self.filled()) is not self:
            return filled.markdown()
        rule = ["---:" if numeric else "---" for numeric in self.numeric()]
        head = list(map(symbols.markdown, self.headings()))
        table = "".join(f"| {' | '.join(row)} |\n" for row in [head, rule, *self.texts(symbols.markdown)])
        title = f"**{symbols.markdown(self.title)}**\n\n" if self.title else ""
        notes = (f"\n{symbols.markdown(mark)} {symbols.markdown(note)}\n" for mark, note in self.remarks())
        return title + table + "".join(notes)

    def text(self) -> str:
        """Aligned columns for the terminal, without the column of units."""
        if (filled := self.filled()) is not self:
            return filled.text()
        kept = [k for k in range(len(self.headings())) if not (k == 1 and self._units())]
        heads, *rows = ([line[k] for k in kept] for line in (self.headings(), *self.texts()))
        rows = [
            [text + terminal.FILLER * len(lack[k]) for k, text in zip(kept, row, strict=True)]
            for row, lack in zip(rows, self.lacking(), strict=True)
        ]
        lines = terminal.table(heads, rows, [self.numeric()[k] for k in kept])
        notes = [terminal.wrapped_sums(f"{mark} {note}") for mark, note in self.remarks()]
        return "\n".join([terminal.wrapped(self.title), *lines, *notes, ""])

    def remarks(self) -> list[tuple[str, str]]:
        """Marks of first cells, each with a sentence on its meaning."""
        notes = [("*", self.footnote)] if self.footnote else []
        shown = {row[0] for row in self.rows}
        if not shown & self.regrouped.names:
            return notes
        return [*notes, (DAGGER, self.regrouped.sentence(shown, column=SUMS in self.columns))]

    def without(self, names: Collection[str], note: str) -> "Table":
        """The table without the rows of some names, and with a note on them."""
        if not names:
            return self
        kept = [k for k, row in enumerate(self.rows) if str(row[0]) not in names]
        units = tuple(self.units[k] for k in kept) if self.units else ()
        digits = {name: [decimals[k] for k in kept] for name, decimals in self.digits.items()}
        rows, notes = tuple(self.rows[k] for k in kept), (*self.notes, note)
        return replace(self, rows=rows, units=units, digits=digits, notes=notes)

    def headings(self) -> list[str]:
        """Column names in words, with one for the units of the rows."""
        first, *more = (self.heads.get(name, heading(name)) for name in self.columns)
        return [first, *["unit"] * bool(self._units()), *more]

    def texts(self, escaped: Callable[[str], str] = str, *, owners: bool = True) -> list[list[str]]:
        """Rows as text, with cells written by `escaped`, parameters with or without the names of their bodies."""
        units, rows = self._units(), []
        for k, (first, *more) in enumerate(self.rows):
            decimals = [self.decimals_at(name, k) for name in self.columns[1:]]
            cells = [self._text(*each, escaped) for each in zip(more, decimals, strict=True)]
            rows.append([self._name(first, escaped, owners), *map(escaped, units[k : k + 1]), *cells])
        return rows

    def lacking(self) -> list[list[str]]:
        """Text that each cell of `texts` lacks to align the decimal points of its column."""
        columns = zip(self.numeric(), *self.texts(), strict=True)
        lacks = [lacking(texts) if numeric else [""] * len(texts) for numeric, *texts in columns]
        return [list(row) for row in zip(*lacks, strict=True)]

    def decimals_at(self, column: str, row: int) -> int:
        """Decimals of a cell."""
        own = self.digits[column][row] if column in self.digits else self._by_deviation(column, row)
        return self.decimals if own is None else own

    def _by_deviation(self, column: str, row: int) -> int | None:
        """Decimals of an estimate with its standard deviation, or of that; None for other cells."""
        std = self.deviations.get(column, column)
        if std not in self.columns or std not in self.deviations.values():
            return None
        own, cell = (self.rows[row][self.columns.index(name)] for name in (column, std))
        deviation = cell if isinstance(cell, float) else None
        if std == column:
            return of_deviations([deviation])[0]
        return decimals_beside(own, deviation) if isinstance(own, float) else decimals_of(deviation)

    def numeric(self) -> list[bool]:
        """True for each column that holds only numbers."""
        first, *more = [not any(isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]
        return [first, *[False] * bool(self._units()), *more]

    def groups(self) -> list[tuple[str, str, list[int]]]:
        """Rows in groups, each with its name and its units: by body, or by unit; one group without either."""
        heads, texts, units = self.headings(), self.texts(), dict[tuple[str, str], dict[str, None]]()
        members = dict[tuple[str, str], list[int]]()
        for k, row in enumerate(texts):
            unit = row[heads.index("unit")] if "unit" in heads else ""
            body = row[0] if heads[0] == "body" else self._owner(self.rows[k][0])
            group = (body, "" if self.bodies or heads[0] == "body" else unit)
            members.setdefault(group, []).append(k)
            units.setdefault(group, {})[unit] = None
        return [(group[0], ", ".join(units[group]), rows) for group, rows in members.items()]

    def _owner(self, cell: Cell) -> str:
        """Body of a parameter or of the joint of a drive such as `Fc(elbow)`, empty for other rows."""
        joint = str(cell).partition("(")[2].rpartition(")")[0]
        return body_of_parameter(str(cell), self.bodies) or self.carriers.get(joint, "") if self.bodies else ""

    def _units(self) -> tuple[str, ...]:
        """Units of the rows; empty if unknown."""
        return self.units or tuple(unit_of(str(row[0])) or "" for row in self.rows if self.bodies)

    def _name(self, cell: Cell, escaped: Callable[[str], str], owners: bool = True) -> str:
        """A row's first cell: a parameter with the name of its body."""
        named = isinstance(cell, str) and cell in self.names
        text = escaped(self.names[str(cell)]) if named else self._text(cell, self.decimals, escaped)
        # Concatenated, not formatted: in pages the parts are HTML already.
        text += DAGGER if cell in self.regrouped.names else ""
        body = body_of_parameter(cell, self.bodies) if isinstance(cell, str) else None
        return text if body is None or not owners else text + " of " + escaped(body)

    def _text(self, cell: Cell, decimals: int, escaped: Callable[[str], str]) -> str:
        if cell is None:
            return ""
        if isinstance(cell, str):
            return escaped(cell) + ("*" if cell in self.marked else "")
        return escaped(number(cell, decimals))


_HEADINGS = {
    rf"_({'|'.join(UNITS)})$": r" (\1)",
    r"_(simplified|full|joint|paper|scene|weighted|ignoring|relative|updated_model)$": r", \1",
    "^paper_": "paper's ",
    r"(?<![^_ ])std(?![^_, ])": "s.d.",
    r"(?<![^_])rms(?![^_, ])": "RMS",
    "_wrench_noise$": " (wrench noise)",
    "_95$": ", 95 %",
    "_": " ",
}


def heading(name: str) -> str:
    """A column's name in words: `paper_error_full` becomes `paper's error, full`."""
    for pattern, words in _HEADINGS.items():
        name = re.sub(pattern, words, name)
    return name


def columns(**named: Iterable[Cell]) -> tuple[tuple[str, ...], tuple[tuple[Cell, ...], ...]]:
    """Column names and rows of a `Table` from its columns; NaN becomes an empty cell, and counts remain counts."""
    return tuple(named), tuple(zip(*(map(_cell, _alike(list(column))) for column in named.values()), strict=True))


def _alike(column: list[Cell]) -> list[Cell]:
    """A column whose numbers are all integers, or all floats."""
    numbers = [cell for cell in column if cell is not None and not isinstance(cell, str)]
    if all(map(is_whole, numbers)):
        return column
    return [cell if cell is None or isinstance(cell, str) else float(cell) for cell in column]


def _cell(value: Cell) -> Cell:
    return None if isinstance(value, float) and math.isnan(value) else value
