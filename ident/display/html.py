"""Results as HTML for notebooks: tables that inherit the notebook's colours, with all text escaped."""

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from ident.display import text

if TYPE_CHECKING:
    from ident.estimate import Estimate

PAGES: "WeakKeyDictionary[Estimate, Path]" = WeakKeyDictionary()
"""Pages that were written of estimates, for the links to them."""

RIGHT = ' style="text-align: right"'


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table, columns of numbers aligned to the right."""
    right = set(numbers)

    def row(cells: Sequence[str], tag: str) -> str:
        return "".join(f"<{tag}{RIGHT * (k in right)}>{escape(x)}</{tag}>" for k, x in enumerate(cells))

    body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in rows)
    return f"<table><thead><tr>{row(heads, 'th')}</tr></thead><tbody>{body}</tbody></table>"


def estimate_html(estimate: "Estimate") -> str:
    """Verdict, parameters and findings of an estimate, with a link to its page if one was written."""
    verdict, (parameters, more) = estimate.verdict(), text.first_parameters(estimate)
    # Units stay on one line.
    rows = [(*row[:5], row[5].replace(" ", "\N{NO-BREAK SPACE}"), *row[6:]) for row in text.parameter_rows(parameters)]
    items = [f"<li>{'<strong>Doubt:</strong> ' * each.doubt}{escape(each.text)}</li>" for each in estimate.findings]
    parts = [
        f"<p><strong>{escape(text.headline(estimate))}</strong></p>",
        f"<p>{escape(str(verdict))}</p>",
        table(text.HEADS, rows, (2, 3, 4, 6)),
        f"<p>{escape(more)}</p>" if more else "",
        f"<p>Residual over signal: {escape(text.ratios(estimate))}</p>",
        f"<details><summary>{len(items)} findings</summary><ul>{''.join(items)}</ul></details>" if items else "",
        _link(PAGES.get(estimate)),
    ]
    return f"<div>{''.join(parts)}</div>"


def _link(page: Path | None) -> str:
    """Link to a page that replays an estimate."""
    return f'<p><a href="{escape(page.as_posix())}" target="_blank">Replay and figures</a></p>' if page else ""
