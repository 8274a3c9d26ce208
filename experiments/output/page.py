"""Pages that hold everything they show: tables from CSV files, figures, style."""

import base64
import csv
import html
import re
from collections.abc import Container, Sequence
from itertools import count
from pathlib import Path
from urllib.parse import quote

from experiments.cli import defaults
from experiments.output import figures, report

FORMATS = ("csv", "tex", "md", *defaults.FORMATS)
"""Formats of tables and figures that a page links to."""

STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #222; --quiet: #555; --line: #ddd; --box: #f6f6f6;
  --edge: #0005; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #16181b; --ink: #ddd; --quiet: #aaa; --line: #3a3d42; --box: #202327; --edge: #fff6; }
  img { background: #fff; padding: .4rem; box-sizing: border-box; } a { color: #8ab4f8; } }
body { font: 16px/1.5 Georgia, serif; max-width: 58rem; margin: 0 auto; padding: 1rem;
  background: var(--paper); color: var(--ink); }
h1 { font-size: 1.5rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid var(--line); }
nav li { display: inline; } nav li + li::before { content: " · "; } nav ul { padding: 0; }
figure { margin: 1rem 0; text-align: center; } img { width: 100%; max-width: 34rem; height: auto; }
figcaption, .note { font-size: .9rem; color: var(--quiet); text-align: left; }
.files { font: .8rem Georgia, serif; }
/* A shadow lies at an edge beyond which a wide table goes on; covers that scroll with it hide it at its ends. */
.scroll { overflow-x: auto; scrollbar-width: thin; background: no-repeat local 0 0 / 3rem 100%
    linear-gradient(to right, var(--paper) 40%, transparent), no-repeat local 100% 0 / 3rem 100%
    linear-gradient(to left, var(--paper) 40%, transparent), no-repeat 0 0 / .8rem 100%
    linear-gradient(to right, var(--edge), transparent), no-repeat 100% 0 / .8rem 100%
    linear-gradient(to left, var(--edge), transparent); }
table { border-collapse: collapse; font: .85rem/1.4 ui-monospace, monospace; font-variant-numeric: tabular-nums; }
caption { text-align: left; font: italic .95rem Georgia, serif; padding: .6rem 0 .2rem; }
th, td { padding: .15rem .6rem; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { border-bottom: 1px solid var(--quiet); vertical-align: bottom; white-space: normal; }
th.text, td.text { text-align: left; }
td.long { white-space: normal; min-width: 16rem; }
th:first-child, td:first-child { position: sticky; left: 0; background: var(--paper); }
var { font-family: Georgia, serif; } sub { font-size: .7em; line-height: 0; }
pre { font-size: .75rem; white-space: pre-wrap; overflow-wrap: anywhere; background: var(--box); padding: .6rem; }
@media print { body { max-width: none; font-size: 10pt; } h2 { break-after: avoid; }
  figure, table { break-inside: avoid; } nav, .files { display: none; }
  .scroll { overflow: visible; } table { font-size: 7pt; } th, td { padding: .1rem .25rem; white-space: normal; } }
"""

LONG = 30
"""Characters from which a text in a table may wrap."""


def document(title: str, parts: Sequence[str]) -> str:
    """A whole page of HTML parts, the first of them its heading, with a list of its sections."""
    sections = [part[4:-5] for part in parts if part.startswith("<h2>")]
    links = "".join(f'<li><a href="#section-{k}">{name}</a></li>' for k, name in enumerate(sections))
    numbers = count()
    body = [f'<h2 id="section-{next(numbers)}">{part[4:]}' if part.startswith("<h2>") else part for part in parts]
    body.insert(1, f"<nav><ul>{links}</ul></nav>")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def table(
    path: Path,
    caption: str,
    differences: dict[str, tuple[str, str]] | None = None,
    marked: Container[str] = (),
    *,
    root: Path | None = None,
) -> str:
    """A CSV file as an HTML table, with columns of differences added.

    Args:
        path: The file; it is linked to, and so are files of other formats beside it.
        caption: What the table shows.
        differences: Names of further columns, and of the two whose difference each is.
        marked: First cells of the rows that get an asterisk.
        root: Folder of the page, by default the one above that of the file.
    """
    with path.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    for row in rows:
        row |= {name: str(float(row[a]) - float(row[b])) for name, (a, b) in (differences or {}).items()}
    for row in rows:
        row |= {name: f"{text}*" for name, text in row.items() if text in marked}
    numeric = {name: all(not row[name] or _is_number(row[name]) for row in rows) for name in rows[0]}
    head = "".join(f"<th{_css(numeric[name])}>{prose(report.heading(name))}</th>" for name in rows[0])
    cells = (
        "".join(f"<td{_css(numeric[name], x)}>{_cell(x, numeric[name])}</td>" for name, x in row.items())
        for row in rows
    )
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return (
        f'<div class="scroll" tabindex="0"><table><caption>{prose(caption)} {_files(path, root)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def figure(path: Path, caption: str, *, root: Path | None = None) -> str:
    """A PNG file, embedded, with links to it and its other formats; `root` as for a table."""
    data = base64.b64encode(path.read_bytes()).decode()
    return (
        f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{prose(caption)} {_files(path, root)}</figcaption></figure>"
    )


def _files(path: Path, root: Path | None) -> str:
    """Links to a file and to those of the same name in other formats."""
    found = [file for file in (path.with_suffix(f".{kind}") for kind in FORMATS) if file.exists()]
    hrefs = [quote(file.relative_to(root or path.parents[1]).as_posix()) for file in found]
    links = (f'<a href="{href}">{file.suffix[1:].upper()}</a>' for file, href in zip(found, hrefs, strict=True))
    return f'<span class="files">({", ".join(links)})</span>'


def prose(text: str) -> str:
    """Plain text as HTML, with parameters as symbols: `m2rz2` becomes m₂ r_z,2 with its indices below."""
    return figures.PARAMETER.sub(_symbol, html.escape(text))


def _symbol(match: re.Match[str]) -> str:
    mass, moment, axes, inertia = match.groups()
    if axes:
        return f"<var>I</var><sub>{axes},{inertia}</sub>"
    arm = f"<var>r</var><sub>{moment},{mass}</sub>" if moment else ""
    return f"<var>m</var><sub>{mass}</sub>{arm}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _css(numeric: bool, text: str = "") -> str:
    return "" if numeric else ' class="text long"' if len(text) > LONG else ' class="text"'


def _cell(text: str, numeric: bool) -> str:
    return report.number(float(text)) if numeric and ("." in text or "e" in text) else prose(text)
