"""Symbols and words of parameters and channels, and escapes of arbitrary texts, for TeX, Markdown, CSV and pages."""

import re
from collections.abc import Iterator, Sequence

import numpy as np

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
