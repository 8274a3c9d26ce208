"""Estimates as lines of text for the terminal, and as HTML for notebooks with all text escaped."""

import math
import textwrap
from collections.abc import Collection, Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from ident.display.brief import html_table
from ident.display.parameters import Parameter

PAGES: "WeakKeyDictionary[Any, Path]" = WeakKeyDictionary()
"""Pages that were written of estimates, for the links to them."""

WIDTH = 120
"""Longest line of a sentence."""


def decimals_of(std: float | None) -> int | None:
    """Decimals that leave a standard deviation two significant digits; None if it is zero or unknown.

    >>> [decimals_of(std) for std in (0.0312, 0.00996, 123.0, 0.0, float("nan"))]
    [3, 3, -1, None, None]
    """
    return 1 - int(f"{std:.1e}".partition("e")[2]) if std and math.isfinite(std) else None


def decimals_beside(value: float, std: float | None) -> int | None:
    """Decimals of an estimate: those of its standard deviation, or more where it would be printed as zero.

    >>> [decimals_beside(*each) for each in ((2.5, 0.031), (-0.0002, 0.031), (0.0, 0.031), (0.3, 740.0), (2.5, None))]
    [3, 4, 3, 1, None]
    """
    decimals = decimals_of(std)
    if decimals is None or not value or not math.isfinite(value) or round(value, decimals):
        return decimals
    return -int(f"{value:.0e}".partition("e")[2])


def rounded(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, with two significant digits of the latter."""
    if (decimals := decimals_of(std)) is None:
        return f"{value:.4g}", f"{std:.2g}"
    own = decimals_beside(value, std) or 0
    return f"{round(value, own) + 0.0:.{max(own, 0)}f}", f"{round(std, decimals):.{max(decimals, 0)}f}"


def parameter_rows(parameters: Iterable[Parameter]) -> list[tuple[str, ...]]:
    """Cells of a table of parameters: name, body, estimate, both standard deviations, unit, model, regrouping."""
    rows: list[tuple[str, ...]] = []
    for each in parameters:
        value, std = rounded(each.estimate, each.std)
        wider = rounded(each.estimate, each.std_setup)[1]
        model = "" if each.model is None else rounded(each.model, each.std)[0]
        regrouping = "" if each.expression == each.name else each.expression
        rows.append((each.name, each.body, value, std, wider, each.unit, model, regrouping))
    return rows


HEADS = ("parameter", "of", "estimate", "s.d.", "s.d. with set-up", "unit", "model", "regrouping")
"""Headings of `parameter_rows`."""


def aligned(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Iterable[int]) -> list[str]:
    """Lines of a table with columns two spaces apart, those of numbers aligned to the right."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    right = set(numbers)

    def line(cells: Sequence[str]) -> str:
        padded = [x.rjust(w) if k in right else x.ljust(w) for k, (x, w) in enumerate(zip(cells, widths, strict=True))]
        return "  ".join(padded).rstrip()

    return [line(heads), *map(line, rows)]


def first_parameters(parameters: Sequence[Parameter], undetermined: Collection[str]) -> tuple[list[Parameter], str]:
    """The first 30 determined parameters of each kind, and a sentence on the others, "" for none."""
    every = [each for each in parameters if each.name not in undetermined]
    kinds = dict.fromkeys(each.kind for each in every)
    out = [row for kind in kinds for row in [each for each in every if each.kind == kind][:30]]
    left = len(parameters) - len(out)
    return out, f"… and {left} more; estimate.to_frame() has all" if left else ""


def undetermined_sentence(names: Sequence[str], joints: Iterable[str]) -> str:
    """Sentence on the parameters that the motion does not determine since joints rest; empty for none."""
    if not names:
        return ""
    resting = ", ".join(sorted({*joints}))
    return (
        f"{resting} rest{'' if ',' in resting else 's'}, so that the motion does not determine "
        f"{', '.join(names)}: left out here, as near the model's values."
    )


def _short(regrouping: str) -> str:
    """The regrouping, or its beginning if it has more than 40 letters."""
    return regrouping if len(regrouping) <= 40 else f"{regrouping[:38]} …"


def summary_text(headline: str, parameters: Iterable[Parameter], sentences: Iterable[str]) -> str:
    """A headline, a table of parameters, and sentences."""
    rows = [(*row[:-1], _short(row[-1])) for row in parameter_rows(parameters)]
    lines = [f"{headline}, SI units", *aligned(HEADS, rows, (2, 3, 4, 6)), *map(_wrapped, sentences)]
    return "\n".join(filter(None, lines))


def _wrapped(sentence: str) -> str:
    """A sentence in lines of at most `WIDTH`, further ones indented as the first."""
    indent = " " * (len(sentence) - len(sentence.lstrip()))
    return textwrap.fill(sentence, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def headline(parameters: Sequence[Parameter], samples: int, logs: int) -> str:
    """Number of parameters, and of samples and recordings that they are from."""
    others = [each for each in parameters if each.kind != "base"]
    kinds = dict.fromkeys(f"{each.kind}s" for each in others)
    more = f" and {len(others)} of {' and '.join(kinds)}" if others else ""
    recordings = f" of {logs} recordings" if logs > 1 else ""
    return f"{len(parameters) - len(others)} base parameters{more} from {samples} samples{recordings}"


def estimate_html(
    headline: str,
    verdict: str,
    parameters: Iterable[Parameter],
    sentences: Iterable[str],
    findings: Iterable[tuple[str, bool]],
    page: Path | None,
) -> str:
    """Verdict, parameters, sentences and findings, True for a doubt, with a link to a page if one was written."""
    # Units stay on one line.
    rows = [(*row[:5], row[5].replace(" ", "\N{NO-BREAK SPACE}"), *row[6:]) for row in parameter_rows(parameters)]
    items = [f"<li>{'<strong>Doubt:</strong> ' * doubt}{escape(sentence)}</li>" for sentence, doubt in findings]
    parts = [
        f"<p><strong>{escape(headline)}</strong></p>",
        f"<p>{escape(verdict)}</p>",
        html_table(HEADS, rows, (2, 3, 4, 6)),
        *(f"<p>{escape(sentence)}</p>" for sentence in sentences if sentence),
        f"<details><summary>{len(items)} findings</summary><ul>{''.join(items)}</ul></details>" if items else "",
        f'<p><a href="{escape(page.as_posix())}" target="_blank">Replay and figures</a></p>' if page else "",
    ]
    return f"<div>{''.join(parts)}</div>"
