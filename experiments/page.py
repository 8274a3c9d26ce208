"""Pages that hold everything they show: tables from CSV files, figures, style."""

import base64
import csv
import html
from collections.abc import Container, Sequence
from pathlib import Path

STYLE = """
body { font: 16px/1.5 Georgia, serif; max-width: 58rem; margin: 0 auto; padding: 1rem; color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc; }
figure { margin: 1rem 0; text-align: center; } img { width: 100%; max-width: 34rem; height: auto; }
figcaption, .note { font-size: .9rem; color: #555; text-align: left; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font: .85rem/1.4 ui-monospace, monospace; }
caption { text-align: left; font: italic .95rem Georgia, serif; padding: .6rem 0 .2rem; }
th, td { padding: .15rem .6rem; text-align: right; white-space: nowrap; border-bottom: 1px solid #eee; }
th { border-bottom: 1px solid #888; } th.text, td.text { text-align: left; }
th:first-child, td:first-child { position: sticky; left: 0; background: #fff; }
pre { font-size: .75rem; white-space: pre-wrap; overflow-wrap: anywhere; background: #f6f6f6; padding: .6rem; }
@media print { body { max-width: none; font-size: 10pt; } h2 { break-after: avoid; }
  figure, table { break-inside: avoid; }
  .scroll { overflow: visible; } table { font-size: 7pt; } th, td { padding: .1rem .25rem; white-space: normal; } }
"""


def document(title: str, parts: Sequence[str]) -> str:
    """A whole page of HTML parts."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body></html>\n"
    )


def table(
    path: Path, caption: str, differences: dict[str, tuple[str, str]] | None = None, marked: Container[str] = ()
) -> str:
    """A CSV file as an HTML table, with columns of differences added."""
    with path.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    for row in rows:
        row |= {name: str(float(row[a]) - float(row[b])) for name, (a, b) in (differences or {}).items()}
    for row in rows:
        row |= {name: f"{text}*" for name, text in row.items() if text in marked}
    numeric = {name: all(not row[name] or _is_number(row[name]) for row in rows) for name in rows[0]}
    head = "".join(f"<th{_css(numeric[name])}>{html.escape(name.replace('_', ' '))}</th>" for name in rows[0])
    cells = (
        "".join(f"<td{_css(numeric[name])}>{_cell(x, numeric[name])}</td>" for name, x in row.items()) for row in rows
    )
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return (
        f'<div class="scroll"><table><caption>{html.escape(caption)}</caption><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def figure(path: Path, caption: str) -> str:
    """A PNG file, embedded."""
    data = base64.b64encode(path.read_bytes()).decode()
    text = html.escape(caption)
    return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _css(numeric: bool) -> str:
    return "" if numeric else ' class="text"'


def _cell(text: str, numeric: bool) -> str:
    return f"{round(float(text), 3) + 0.0:.3f}" if numeric and "." in text else html.escape(text)
