"""Escapes of arbitrary names and texts, so that TeX, Markdown, CSV and matplotlib show them literally.

HTML pages use the standard library's `html.escape`.
"""

import re

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
