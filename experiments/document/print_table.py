"""Tables in a journal's style: LaTeX with booktabs, siunitx, tabularx and threeparttable."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, groupby, pairwise
from math import ceil

from experiments.document import typography
from experiments.document.figures import SHEET
from experiments.document.tabular import DAGGER, Table
from experiments.document.typography import PARAMETER, SYMBOL, parameter_symbol
from ident.geometry.inertia import body_of_parameter

NUMBER = re.compile(r"(-?)(\d+)(?:\.(\d+))?(?:e([+-]?)0*(\d+))?")
"""A number of an `S` column: sign, whole digits, decimals, sign and digits of the exponent."""

LONG = 28
"""Number of letters above which a cell may break into lines."""

PACKAGES = "booktabs,siunitx,tabularx,threeparttable"
"""LaTeX packages that the tables need, all in TeX Live's latexextra and science collections."""


@dataclass(frozen=True)
class Size:
    """A font size: its LaTeX command, and approximate widths of letters and gaps and height of lines, pt."""

    command: str
    letter: float
    gap: float
    line: float


NORMAL = Size(r"\footnotesize", 4.4, 12.0, 9.6)
SMALL = Size(r"\scriptsize\setlength{\tabcolsep}{3pt}", 3.9, 6.0, 8.1)


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
    """Lines of a head, split before brackets and after commas; those of more than ten letters are broken at spaces."""
    lines = []
    for k, part in enumerate(re.split(r", | (?=\()", head)):
        words = (capital(part) if k == 0 else part).split(" ")
        while len(" ".join(words)) > 10 and len(words) > 1:
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


_MARKS = {DAGGER: r"$^\dagger$"}
"""Marks of first cells that LaTeX writes otherwise."""

CHANNEL = re.compile(r"([FMτ])([xyz])")
_GREEK = {"α": r"\alpha", "θ": r"\theta", "π": r"\pi", "τ": r"\tau", "ω": r"\omega", "β": r"\beta"}
_UNITS = {
    "kg m²": r"\kilo\gram\metre\squared",
    "kg m": r"\kilo\gram\metre",
    "kg": r"\kilo\gram",
    "N m": r"\newton\metre",
    "N": r"\newton",
    "s": r"\second",
    "deg": r"\degree",
    "rad": r"\radian",
    "m": r"\metre",
    "mm": r"\milli\metre",
    "%": r"\percent",
    "1": r"\text{--}",
}


def unit(text: str) -> str:
    """A unit by siunitx, or as text if siunitx lacks it."""
    return rf"\unit{{{_UNITS[text]}}}" if text in _UNITS else text_with_symbols(text)


def text_with_symbols(text: str) -> str:
    """Plain text as LaTeX, with parameters, their sums, channels and minus signs as symbols."""
    if match := CHANNEL.fullmatch(text):
        return f"${_GREEK.get(match[1], match[1])}_{match[2]}$"
    if match := SYMBOL.fullmatch(text):
        sign, letter, index, minus, greek, half, name = (group or "" for group in match.groups())
        symbol = rf"\{name}" if name else _GREEK.get(letter or greek, letter or greek)
        return f"${sign or minus}{symbol}{f'_{index}' if index else ''}{half}$"
    edges = [0, *(edge for match in PARAMETER.finditer(text) for edge in match.span()), len(text)]
    parts = [text[start:end] for start, end in pairwise(edges)]
    if len(parts) > 1 and all(re.fullmatch(r"[-+ .\de]*", part) for part in parts[::2]):
        factors = (re.sub(r"(?<=[\d.]) $", r"\\,", part) for part in parts[::2])
        letters = (*(parameter_symbol(part).strip("$") for part in parts[1::2]), "")
        return "$" + "".join(a + b for a, b in zip(factors, letters, strict=True)) + "$"
    mixed = "".join(parameter_symbol(part) if k % 2 else typography.tex(part) for k, part in enumerate(parts))
    return re.sub(r"(?<!\S)-(?=[\d\s])", "$-$", mixed)


def tex(table: Table, label: str = "") -> str:
    """A table over one column of the page, or over both if it is wide; in several floats if it is too large."""
    table = table.filled()
    columns, caption, notes = _columns(table), _caption(table.caption or table.title), _notes(table)
    narrow, wide, height = (72.27 * inches for inches in (SHEET.column, SHEET.text, SHEET.height))
    needed = sum(column.width(NORMAL) for column in columns)
    star, room = ("*", wide) if needed > narrow else ("", narrow)
    size, keys = NORMAL if needed <= room else SMALL, 1 + (len(columns) > len(table.columns))
    parts = typography.parts(columns, keys, lambda part: sum(each.width(size) for each in part) <= room)
    if len(parts) > 1:
        parts = [_with_cells(part, keys) for part in parts]
    floats: list[str] = []
    for rows in (page for part in parts for page in _pages(part, size, room, height)):
        continued = r" \emph{(continued)}" if floats else ""
        name = f"\\label{{tab:{label}}}" if label and not floats else ""
        same = "\\addtocounter{table}{-1}\n" if floats else ""
        floats.append(
            f"\\begin{{table{star}}}\n\\centering{size.command}\n\\begin{{threeparttable}}\n"
            f"{same}\\caption{{{caption}{continued}}}{name}\n{_tabular(rows)}{notes}"
            f"\\end{{threeparttable}}\n\\end{{table{star}}}\n"
        )
    return f"% \\usepackage{{{PACKAGES}}}\n" + "\n".join(floats)


def _with_cells(columns: Sequence[Column], keys: int) -> list[Column]:
    """A set of columns without the rows that are empty beyond the first `keys` columns."""
    kept = [any(cells) for cells in zip(*(column.cells for column in columns[keys:]), strict=True)]
    return [replace(column, cells=[*compress(column.cells, kept)]) for column in columns]


def _pages(columns: Sequence[Column], size: Size, room: float, height: float) -> Iterator[list[Column]]:
    """Yields the columns' rows that fit on a page of this height, pt, by the number of lines of their longest cells."""
    # Heads, rules and notes take about 60 pt.
    most = (height - 60) / size.line
    long = [column for column in columns if column.long]
    left = room - sum(column.width(size) for column in columns if not column.long)
    letters = max(left / max(len(long), 1) - size.gap, LONG * size.letter) / size.letter
    number = len(columns[0].cells)
    starts, used = [0], 0
    for row in range(number):
        lines = max([1, *(ceil(letters_of(column.cells[row]) / letters) for column in long)])
        if used and used + lines > most:
            starts, used = [*starts, row], 0
        used += lines
    for start, end in pairwise([*starts, number]):
        yield [replace(column, cells=column.cells[start:end]) for column in columns]


def figure(name: str, caption: str, width: float) -> str:
    """A float with a figure from a file of that name, in its drawn width, inches."""
    star = "*" if width > 1.05 * SHEET.column else ""
    return (
        f"% \\usepackage{{graphicx,siunitx}}\n\\begin{{figure{star}}}\n\\centering\n\\includegraphics{{{name}}}\n"
        f"\\caption{{{_caption(caption)}}}\\label{{fig:{name}}}\n\\end{{figure{star}}}\n"
    )


def _caption(caption: str) -> str:
    """A caption in LaTeX, with a full stop."""
    text = text_with_symbols(caption)
    return text if not text or text.endswith(".") else f"{text}."


def _columns(table: Table) -> list[Column]:
    """Columns in LaTeX: numbers as they are, names of bodies slanted, units by siunitx."""
    heads, numeric, plain = table.headings(), table.numeric(), table.texts()
    rows = table.texts(text_with_symbols)
    for row, own, (first, *_) in zip(rows, plain, table.rows, strict=True):
        row[0] = row[0].replace(DAGGER, _MARKS[DAGGER])
        if (body := body_of_parameter(str(first), table.bodies)) is not None:
            row[0] = f"{row[0][: -len(typography.tex(body))]}\\emph{{{typography.tex(body)}}}"
        if "unit" in heads:
            row[heads.index("unit")] = unit(own[heads.index("unit")])
    out = []
    for k, (head, is_numeric) in enumerate(zip(heads, numeric, strict=True)):
        words, _, remark = head.partition(", ")
        out.append(Column(words, remark, [row[k] for row in (plain if is_numeric else rows)], is_numeric))
    return out


def _tabular(columns: Sequence[Column]) -> str:
    """Rules, heads and rows; a column with long cells takes the rest of the line's width."""
    preamble = "@{}" + "".join(column.format for column in columns) + "@{}"
    kind, width = ("tabularx", r"{\linewidth}") if any(column.long for column in columns) else ("tabular", "")
    begin = f"\\begin{{{kind}}}{width}{{{preamble}}}"
    rows = "".join(" & ".join(cells) + " \\\\\n" for cells in zip(*(c.cells for c in columns), strict=True))
    return f"{begin}\n\\toprule\n{_heads(columns)}\\midrule\n{rows}\\bottomrule\n\\end{{{kind}}}\n"


def _heads(columns: Sequence[Column]) -> str:
    """One row of heads, under another one if neighbours share a remark."""
    groups = [(remark, len(list(members))) for remark, members in groupby(columns, lambda column: column.remark)]
    shared = any(remark and size > 1 for remark, size in groups)
    top, rules, first = [], "", 1
    for remark, size in groups:
        lines = [text_with_symbols(line) for line in lines_of(remark)]
        # Several columns have room for one line.
        text = _stack(lines, True) if size == 1 and len(lines) > 1 else text_with_symbols(capital(remark))
        top.append(f"\\multicolumn{{{size}}}{{c}}{{{text}}}" if remark else " & ".join([""] * size))
        rules += f"\\cmidrule(lr){{{first}-{first + size - 1}}}" if remark else ""
        first += size
    heads = [column.head if shared or not column.remark else f"{column.head}, {column.remark}" for column in columns]
    row = " & ".join(_head(head, column.numeric) for head, column in zip(heads, columns, strict=True))
    return (f"{' & '.join(top)} \\\\\n{rules}\n" if shared else "") + f"{row} \\\\\n"


def _head(text: str, numeric: bool) -> str:
    """A head in lines, in braces above aligned numbers."""
    lines = [unit_line(line) for line in lines_of(text)]
    shown = lines[0] if len(lines) == 1 else _stack(lines, numeric)
    return f"{{{shown}}}" if numeric else shown


def _stack(lines: Sequence[str], numeric: bool) -> str:
    rule = r"\rule{0pt}{2.3ex}"
    return f"\\shortstack[{'c' if numeric else 'l'}]{{{rule}{(chr(92) * 2).join(lines)}}}"


def unit_line(text: str) -> str:
    """A line of a head; a unit in brackets is set by siunitx."""
    match = re.fullmatch(r"\((.+)\)", text)
    words = re.sub(r"(^|(?<= ))[a-zα-ω]$", lambda letter: f"${_GREEK.get(letter[0], letter[0])}$", text)
    if words != text:
        return words
    return f"({unit(match[1])})" if match and match[1] in _UNITS else text_with_symbols(text)


def _notes(table: Table) -> str:
    """Notes below a table."""
    notes = [f"\\item[{_MARKS.get(mark, mark)}] {text_with_symbols(note)}" for mark, note in table.remarks()]
    notes += [f"\\item {text_with_symbols(note)}" for note in table.notes]
    if not notes:
        return ""
    lines = "\n".join(notes)
    return f"\\begin{{tablenotes}}[flushleft]\\footnotesize\n{lines}\n\\end{{tablenotes}}\n"
