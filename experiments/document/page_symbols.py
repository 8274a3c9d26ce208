"""Symbols in the texts of pages: parameters, channels of wrenches, and cells that are a symbol."""

import re
from collections.abc import Iterator

from experiments.document.figures import PARAMETER
from experiments.document.print_table import SYMBOL

_NAMED = re.compile(rf"{PARAMETER.pattern}|(?<![\w'])([FMτ])([xyz])(?![\w'])")

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
        yield text[end : match.start()], _symbol(match)
        end = match.end()
    yield text[end:], ()


def _symbol(match: re.Match[str]) -> Symbol:
    mass, moment, axes, inertia, kind, axis = match.groups()
    if kind:
        return ((kind, axis),)
    if axes:
        return (("I", f"{axes},{inertia}"),)
    return (("m", mass), ("r", f"{moment},{mass}")) if moment else (("m", mass),)
