"""Tables: decimals and texts of their cells, and their forms for spreadsheets, Markdown and the terminal."""

import csv
import io
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from itertools import compress
from numbers import Integral

from experiments.document import typography
from ident.display.brief import decimals_beside, decimals_of
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


def of_small(values: Iterable[float | None], std: Iterable[float | None]) -> Decimals:
    """Decimals of other values beside estimates: those of the estimates, or more to show two digits of small ones."""
    sizes = of_numbers(None if x is None else abs(x) for x in values)
    pairs = zip(of_numbers(std), sizes, strict=True)
    return [max((each for each in pair if each is not None), default=None) for pair in pairs]


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
    parts = [re.fullmatch(r"[-+]?\d+(\.\d+)?", text) for text in texts]
    shown = [None if part is None else len(part[1] or "") for part in parts]
    most = max((letters for letters in shown if letters is not None), default=0)
    return ["" if letters is None else ("." + "0" * most)[letters:most] for letters in shown]


Cell = str | float | None


@dataclass(frozen=True)
class Table:
    """A table of results.

    Attributes:
        title: Title, for the screen and for pages.
        columns: Column names of the CSV file; elsewhere `heading`s of them.
        rows: Cells: texts, numbers, or None or NaN if empty; empty columns are in the CSV file alone.
        decimals: Decimals of numbers, except in the CSV file, which keeps all digits; counts have none.
        deviations: Columns of standard deviations by the columns of their estimates; both have decimals that leave the
            standard deviation two digits.
        digits: Decimals of other columns, a number for each row, in place of `decimals`.
        marked: First cells of the rows that get an asterisk, except in the CSV file.
        footnote: Meaning of the asterisk.
        regrouped: Sums by model, each beginning with the name of the parameter that stands for it; those of several
            parameters get a dagger, except in the CSV file.
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
    rows: Sequence[Sequence[Cell]]
    decimals: int = 3
    deviations: Mapping[str, str] = field(default_factory=dict)
    digits: Mapping[str, Decimals] = field(default_factory=dict)
    marked: frozenset[str] = frozenset()
    footnote: str = ""
    regrouped: Mapping[str, Sequence[str]] = field(default_factory=dict)
    caption: str = ""
    notes: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    heads: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    carriers: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rows = (tuple(None if isinstance(x, float) and math.isnan(x) else x for x in row) for row in self.rows)
        object.__setattr__(self, "rows", tuple(rows))

    def csv(self) -> str:
        """Comma-separated values with full precision; if bodies have names, a column holds each parameter's body.

        Texts that spreadsheets would read as formulas follow an apostrophe.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        owners = [body_of_parameter(str(row[0]), self.bodies) for row in self.rows] if self.bodies else []
        first, *more = self.columns
        writer.writerow(map(typography.cell, [first, *["body"] * bool(owners), *more]))
        for k, row in enumerate(self.rows):
            cells = [row[0], *owners[k : k + 1], *row[1:]]
            writer.writerow([typography.cell(cell) if isinstance(cell, str) else cell for cell in cells])
        return out.getvalue()

    def filled(self) -> "Table":
        """The table without empty columns."""
        kept = [k for k in range(len(self.columns)) if k == 0 or any(row[k] not in (None, "") for row in self.rows)]
        if not self.rows or len(kept) == len(self.columns):
            return self
        columns = tuple(self.columns[k] for k in kept)
        return replace(self, columns=columns, rows=[[row[k] for k in kept] for row in self.rows])

    def markdown(self) -> str:
        """A Markdown table under its title, numbers right-aligned."""
        shown = self.filled()
        rule = ["---:" if numeric else "---" for numeric in shown.numeric()]
        head = list(map(typography.markdown, shown.headings()))
        table = "".join(f"| {' | '.join(row)} |\n" for row in [head, rule, *shown.texts(typography.markdown)])
        title = f"**{typography.markdown(self.title)}**\n\n" if self.title else ""
        notes = (f"\n{typography.markdown(mark)} {typography.markdown(note)}\n" for mark, note in shown.remarks())
        return title + table + "".join(notes)

    def text(self) -> str:
        """Aligned columns for the terminal, without the column of units."""
        shown = self.filled()
        heads, numeric = shown.headings(), shown.numeric()
        kept = [k for k in range(len(heads)) if not (k == 1 and shown._units())]
        rows = [
            [row[k] + typography.FILLER * len(lack[k]) for k in kept]
            for row, lack in zip(shown.texts(), shown.lacking(), strict=True)
        ]
        lines = typography.table([heads[k] for k in kept], rows, [numeric[k] for k in kept])
        notes = [typography.wrapped_sums(f"{mark} {note}") for mark, note in shown.remarks()]
        return "\n".join([typography.wrapped(self.title), *lines, *notes, ""])

    def remarks(self) -> list[tuple[str, str]]:
        """Marks of first cells, each with a sentence on its meaning."""
        notes = [("*", self.footnote)] if self.footnote else []
        shown = {row[0] for row in self.rows}
        kept = {model: [own[name] for name in own if name in shown] for model, own in self._sums.items()}
        models = [model for model, sums in kept.items() if sums]
        if not models:
            return notes
        if SUMS in self.columns:
            return [*notes, (DAGGER, "Regrouped with other parameters: the sum is in the column of regroupings.")]
        named = dict[str, list[str]]()
        for model in models:
            named.setdefault(", ".join(kept[model]), []).append(model)
        listed = "; ".join(f"{', '.join(own)}: " * bool(own[0]) + sums for sums, own in named.items())
        return [*notes, (DAGGER, f"Regrouped sums{', ' if models[0] else ': '}{listed}.")]

    @cached_property
    def _sums(self) -> dict[str, dict[str, str]]:
        """Sums of several parameters by model and by their first one; without the model if all have the same."""
        models = (
            self.regrouped
            if len(set(map(tuple, self.regrouped.values()))) > 1
            else {"": next(iter(self.regrouped.values()), ())}
        )
        named = {model: {each.split(" ", 1)[0]: each for each in sums} for model, sums in models.items()}
        return {model: {name: each for name, each in sums.items() if name != each} for model, sums in named.items()}

    def without(self, names: Collection[str], note: str) -> "Table":
        """The table without the rows of some names, and with a note on them."""
        if not names:
            return self
        kept = [str(row[0]) not in names for row in self.rows]
        digits = {name: [*compress(decimals, kept)] for name, decimals in self.digits.items()}
        rows, units = [*compress(self.rows, kept)], (*compress(self.units, kept),)
        return replace(self, rows=rows, units=units, digits=digits, notes=(*self.notes, note))

    def headings(self) -> list[str]:
        """Column names in words, with one for the units of the rows."""
        first, *more = (self.heads.get(name, heading(name)) for name in self.columns)
        return [first, *["unit"] * bool(self._units()), *more]

    def texts(self, escaped: Callable[[str], str] = str, *, owners: bool = True) -> list[list[str]]:
        """Rows as text, with cells written by `escaped`, parameters with or without the names of their bodies."""
        units, rows = self._units(), []
        for k, (first, *more) in enumerate(self.rows):
            named = zip(self.columns[1:], more, strict=True)
            cells = [self._text(cell, self.decimals_at(name, k), escaped) for name, cell in named]
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
        heads, texts, members = self.headings(), self.texts(), dict[str, list[int]]()
        units = [row[heads.index("unit")] if "unit" in heads else "" for row in texts]
        named = heads[0] == "body" or bool(self.bodies)
        for k, (row, unit) in enumerate(zip(texts, units, strict=True)):
            body = row[0] if heads[0] == "body" else self._owner(self.rows[k][0])
            members.setdefault(body if named else unit, []).append(k)
        each = [(group * named, dict.fromkeys(units[k] for k in own), own) for group, own in members.items()]
        return [(name, ", ".join(own), rows) for name, own, rows in each]

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
        text += DAGGER if any(cell in own for own in self._sums.values()) else ""
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
    r"_(simplified|full|searched|joint|paper|scene|weighted|ignoring|relative|updated_model)(?=$| \()": r", \1",
    "^paper_": "paper's ",
    r"^(condition_number|rank|rows|epsilon|largest_error)_(?!of_)": r"\1, ",
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


def columns(**named: Iterable[Cell]) -> tuple[tuple[str, ...], list[tuple[Cell, ...]]]:
    """Column names and rows of a `Table` from its columns; numbers beside others that are no counts are none either."""
    return tuple(named), list(zip(*(_alike(list(column)) for column in named.values()), strict=True))


def _alike(column: list[Cell]) -> list[Cell]:
    """A column whose numbers are all integers, or all floats."""
    numbers = [cell for cell in column if cell is not None and not isinstance(cell, str)]
    if all(map(is_whole, numbers)):
        return column
    return [cell if cell is None or isinstance(cell, str) else float(cell) for cell in column]
