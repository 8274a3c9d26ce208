"""Results as HTML for notebooks: tables that inherit the notebook's colours, with all text escaped."""

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from ident.display import text
from ident.display.parameters import Parameter

PAGES: "WeakKeyDictionary[Any, Path]" = WeakKeyDictionary()
"""Pages that were written of estimates, for the links to them."""

RIGHT = ' style="text-align: right"'


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table, columns of numbers aligned to the right."""
    right = set(numbers)

    def row(cells: Sequence[str], tag: str) -> str:
        return "".join(f"<{tag}{RIGHT * (k in right)}>{escape(x)}</{tag}>" for k, x in enumerate(cells))

    body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in rows)
    return f"<table><thead><tr>{row(heads, 'th')}</tr></thead><tbody>{body}</tbody></table>"


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
    rows = [(*row[:5], row[5].replace(" ", "\N{NO-BREAK SPACE}"), *row[6:]) for row in text.parameter_rows(parameters)]
    items = [f"<li>{'<strong>Doubt:</strong> ' * doubt}{escape(sentence)}</li>" for sentence, doubt in findings]
    parts = [
        f"<p><strong>{escape(headline)}</strong></p>",
        f"<p>{escape(verdict)}</p>",
        table(text.HEADS, rows, (2, 3, 4, 6)),
        *(f"<p>{escape(sentence)}</p>" for sentence in sentences if sentence),
        f"<details><summary>{len(items)} findings</summary><ul>{''.join(items)}</ul></details>" if items else "",
        _link(page),
    ]
    return f"<div>{''.join(parts)}</div>"


def _link(page: Path | None) -> str:
    """Link to a page that replays an estimate."""
    return f'<p><a href="{escape(page.as_posix())}" target="_blank">Replay and figures</a></p>' if page else ""
