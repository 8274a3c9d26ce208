"""Text in print, pages and terminals: symbols and words of parameters, escapes of any texts, lines and columns."""

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest
from typing import TypeVar

import numpy as np

from ident.display.brief import WIDTH
from ident.geometry.inertia import body_index, body_of_parameter
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters


def order(name: str) -> int:
    """Order of a parameter as a moment of mass: 0, 1 or 2.

    >>> [order(name) for name in ("m1", "m2rz2", "Ixx3")]
    [0, 1, 2]
    """
    return 2 if name.startswith("I") else int("r" in name)


def in_words(name: str, arm: Mechanism) -> str:
    """A parameter, or another coefficient, in words."""
    match = PARAMETER.fullmatch(name)
    if match is None:
        return name.replace("offset(", "constant offset of ").rstrip(")") if name.startswith("offset(") else name
    body = arm.tree.bodies[arm.tree.inertial[body_index(name) or 0]]
    _, moment, axes, _ = match.groups()
    if axes:
        about = f"moment of inertia of {body.name} about {axes[0]}"
        kind = about if axes[0] == axes[1] else f"product of inertia {axes} of {body.name}"
        return f"{kind}, at {_origin(body)}"
    return f"first moment of {body.name} along {moment} about {_origin(body)}" if moment else f"mass of {body.name}"


def regrouped_in_words(base: BaseParameters, k: int, arm: Mechanism) -> str:
    """The k-th base parameter and its regrouped terms, in words."""
    parts = list(_parts(base, k, arm))
    named = in_words(base.names[k], arm)
    return f"{named}, which also includes: {'; '.join(parts)}" if parts else named


def _parts(base: BaseParameters, k: int, arm: Mechanism) -> Iterator[str]:
    """The other parameters in a base parameter, each with its factor, whose unit is a power of metres.

    Factors to three decimals: those that are zero then are left out, as is a factor of one.
    """
    own, zero = order(base.names[k]), 0.0005
    for coefficient, d in zip(base.beta[k], base.dependent, strict=True):
        if abs(coefficient) > zero:
            power = own - order(base.parameters[d])
            metres = {0: "", 1: " m", 2: " m²", -1: " 1/m", -2: " 1/m²"}[power]
            factor = "" if not metres and abs(coefficient - 1) < zero else f"{coefficient:.3g}{metres} × "
            yield f"{factor}the {in_words(base.parameters[d], arm)}"


def _origin(body: Body) -> str:
    """The origin of a body's frame in words: its joint if the joint's axis passes through it."""
    on_axis = body.moves and not np.any(body.twist[:3]) and bool(body.joint)
    return f"joint {body.joint}" if on_axis else f"the origin of the frame of {body.name}"


_TEX = {
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "²": "$^2$",
    "π": r"$\pi$",
    "θ": r"$\theta$",
    "τ": r"$\tau$",
}


def tex(text: str) -> str:
    """A text in one line of a LaTeX document that needs no packages."""
    escaped = re.sub("-(?=-)", "-{}", "".join(_TEX.get(letter, letter) for letter in _line(text)))
    # At the start of a row these would be read as arguments of the previous row's end.
    return re.sub(r"^( *)([*\[])", r"\1{\2}", escaped)


def markdown(text: str) -> str:
    """A text in a cell of a Markdown table; underscores within words are literal there, and stay."""
    return re.sub(r"[\\`*{}\[\]<>|~$&#!]|(?<![^\W_])_|_(?![^\W_])", r"\\\g<0>", _line(text))


def cell(text: str) -> str:
    """A text in a cell of a CSV file, after an apostrophe if spreadsheets could read it as a formula.

    A sign before letters, digits, points and slashes alone is harmless, and stays.

    >>> [cell(text) for text in ("=1+2", "@x", "-2+cmd|' /C calc'!A0", "-π/2", "m2rz2")]
    ["'=1+2", "'@x", "'-2+cmd|' /C calc'!A0", '-π/2', 'm2rz2']
    """
    return f"'{text}" if re.match(r"\s*[=@]|\s*[-+](?![\w/. ]*$)|[\t\r]", text) else text


def label(text: str) -> str:
    """A text in a matplotlib figure, where text between dollar signs would be a formula."""
    return _line(text).replace("$", r"\$")


def visible(text: str) -> str:
    """A text without marks and overrides of writing direction, which would reverse adjacent text."""
    return re.sub(r"[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]", "", text)


def _line(text: str) -> str:
    """The text in one line, without control characters."""
    return re.sub(r"[\x00-\x1f\x7f\x85\u2028\u2029]+", " ", visible(text))


PARAMETER = re.compile(r"\bm(\d+)(?:r([xyz])\1)?\b|\bI([xyz]{2})(\d+)\b")
"""Names of parameters of φ, as in `m2rz2 + 0.425 m3`: a mass and its moment, or axes and number of an inertia."""

SYMBOL = re.compile(r"(-?)([A-Za-zα-ω])_(\w)|(-?)([α-ω])(/\d)?|(alpha|theta|omega)")
"""Cells and heads that are a symbol: a letter with an index, a Greek letter or its name."""

_NAMED = re.compile(rf"{PARAMETER.pattern}|(?<![\w'])([FMτ])([xyz])(?![\w'])")

_GREEK = {"Delta": "Δ", "tau": "τ", "theta": "θ", "psi": "ψ"}
"""Letters that formulas in figures name."""

Symbol = tuple[tuple[str, str], ...]
"""Letters, each with its index."""


def pieces(text: str) -> Iterator[tuple[str, Symbol]]:
    """Yields pairs of plain text and the symbol after it; the last symbol is empty.

    >>> list(pieces("m2rz2 and Fx"))
    [('', (('m', '2'), ('r', 'z,2'))), (' and ', (('F', 'x'),)), ('', ())]
    """
    if match := SYMBOL.fullmatch(text):
        sign, letter, index, minus, greek, part, _ = (group or "" for group in match.groups())
        if letter or greek:
            yield "\N{MINUS SIGN}" if sign or minus else "", ((letter or greek, index),)
            yield part, ()
            return
    end = 0
    for match in _NAMED.finditer(text):
        yield _with_minus(text[end : match.start()]), _symbol(match)
        end = match.end()
    yield _with_minus(text[end:]), ()


def _with_minus(text: str) -> str:
    """Plain text with minus signs before numbers and between terms; a hyphen alone stays, as do those that are to copy.

    >>> _with_minus("off by -2, so write rpy_deg = [0, -90, 0] or --base-rpy 0 -90 0")
    'off by −2, so write rpy_deg = [0, -90, 0] or --base-rpy 0 -90 0'
    """
    copied = r"\w+ = (?:\[[^]]*\]|\S+)|--[a-z][\w-]*(?: -?\d[\d.]*)*"
    minus = r"(?<![^\s(])-(?=(?: ?\d[\d.]*(?:[\s,;)%]|$))| $)"
    return re.sub(f"({copied})|{minus}", lambda match: match[1] or "\N{MINUS SIGN}", text)


def _symbol(match: re.Match[str]) -> Symbol:
    *_, kind, axis = match.groups()
    return ((kind, axis),) if kind else _parameter(match)


def _parameter(match: re.Match[str]) -> Symbol:
    mass, moment, axes, inertia = match.groups()[:4]
    if axes:
        return (("I", f"{axes},{inertia}"),)
    return (("m", mass), ("r", f"{moment},{mass}")) if moment else (("m", mass),)


def parameter_symbol(name: str) -> str:
    """A parameter's name as in the paper, in TeX: `m2rz2` becomes `$m_{2}r_{z,2}$`."""
    match = PARAMETER.fullmatch(name)
    return label(name) if match is None else f"${''.join(f'{a}_{{{index}}}' for a, index in _parameter(match))}$"


def named_symbol(name: str, bodies: Sequence[str]) -> str:
    """A parameter's symbol with the name of its body, bodies numbered from 1, for labels in figures."""
    body = body_of_parameter(name, bodies)
    return parameter_symbol(name) + (f", {label(body)}" if body else "")


def plain(label: str) -> str:
    r"""A label of a figure as plain text, with names of parameters as in CSV files.

    >>> [plain(label) for label in (r"$|\Delta \tau_x|$ (N m)", "$m_{2}r_{z,2}$, shank", "knee\n(N m)", r"\$a_b")]
    ['|Δτx| (N m)', 'm2rz2, shank', 'knee (N m)', '$a_b']
    """
    text = re.sub(r"(?<!\\)\$(.*?)(?<!\\)\$", lambda formula: _plain_formula(formula[1]), label)
    return " ".join(text.replace(r"\$", "$").split())


def _plain_formula(formula: str) -> str:
    """A formula in TeX as letters alone."""
    greek = re.sub(r"\\([A-Za-z]+) ?", lambda name: _GREEK.get(name[1], name[1]), formula)
    return re.sub(r"[{}_,]", "", greek)


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
    broken = textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
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
