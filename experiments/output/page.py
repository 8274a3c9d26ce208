"""Pages that hold everything they show: results, their tables and figures in templates of HTML."""

import base64
import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from experiments.output import figures
from experiments.output.report import Cell, Table
from experiments.output.results import Results


def rendered(template: str, root: Path, shown: Mapping[str, Results], formats: Iterable[str], **values: object) -> str:
    """A page in one file.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Results by the names of their folders in `root`, or by an empty name those in `root` itself; they are
            written, with figures as PNG.
        formats: Formats of the figures.
        values: What else the template takes.
    """

    def png(folder: str, name: str) -> str:
        return base64.b64encode((root / folder / f"{name}.png").read_bytes()).decode()

    environment = Environment(
        loader=PackageLoader("experiments.output"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"parameters": figures.PARAMETER.split, "indented": _indented, "compared": compared}
    environment.globals |= {"results": shown, "formats": sorted(set(formats)), "png": png}
    return environment.get_template(template).render(values)


def compared(table: Table) -> Table:
    """A table with the differences between its columns and the paper's."""
    pairs = [
        (name, table.columns.index(name), table.columns.index(f"paper_{name}"))
        for name in table.columns
        if f"paper_{name}" in table.columns
    ]
    names = [name.replace("error", "deviation") for name, *_ in pairs]
    rows = tuple((*row, *(_difference(row[ours], row[paper]) for _, ours, paper in pairs)) for row in table.rows)
    return replace(table, columns=(*table.columns, *names), rows=rows)


def _difference(a: Cell, b: Cell) -> Cell:
    return a - b if isinstance(a, float) and isinstance(b, float) else None


def _indented(content: Any) -> str:
    """JSON for readers."""
    return json.dumps(content, indent=1, ensure_ascii=False)
