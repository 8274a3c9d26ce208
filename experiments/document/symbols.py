"""Symbols of parameters, of channels of wrenches, and of cells that are a symbol, in TeX and as parts for pages."""

import re
from collections.abc import Iterator, Sequence

from experiments.document import escape
from ident.geometry.inertia import body_of_parameter

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
    """Plain text with minus signs before numbers and between terms; a hyphen alone stays."""
    return re.sub(r"(?<![^\s(])-(?=(?: ?\d[\d.]*(?:[\s,;)%]|$))| $)", "\N{MINUS SIGN}", text)


def _symbol(match: re.Match[str]) -> Symbol:
    mass, moment, axes, inertia, kind, axis = match.groups()
    if kind:
        return ((kind, axis),)
    if axes:
        return (("I", f"{axes},{inertia}"),)
    return (("m", mass), ("r", f"{moment},{mass}")) if moment else (("m", mass),)


def parameter_symbol(name: str) -> str:
    """A parameter's name as in the paper, in TeX: `m2rz2` becomes `$m_{2}r_{z,2}$`."""
    match = PARAMETER.fullmatch(name)
    if match is None:
        return escape.label(name)
    mass, moment, axes, inertia = match.groups()
    if axes:
        return f"$I_{{{axes},{inertia}}}$"
    return f"$m_{{{mass}}}$" if moment is None else f"$m_{{{mass}}}r_{{{moment},{mass}}}$"


def named_symbol(name: str, bodies: Sequence[str]) -> str:
    """A parameter's symbol with the name of its body, bodies numbered from 1, for labels in figures."""
    body = body_of_parameter(name, bodies)
    return parameter_symbol(name) + (f", {escape.label(body)}" if body else "")


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
