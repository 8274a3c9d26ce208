"""One self-contained page with all tables and figures of the studies beside the paper's numbers."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from experiments.data import paper
from experiments.document.document import Document
from experiments.document.tabular import Cell, Table
from experiments.document.writer import page
from ident.files.atomic import replacing


def write_index(out: Path, results: Mapping[str, Document], formats: Iterable[str]) -> None:
    """Writes `out/index.html`.

    Args:
        out: Folder of the studies' folders.
        results: Documents of the studies of `python -m experiments`, by folder name.
        formats: Formats of the figures.
    """
    shown = {
        folder: replace(study, tables={name: compared(table) for name, table in study.tables.items()})
        for folder, study in results.items()
    }
    with replacing(out / "index.html") as temporary:
        temporary.write_text(page("index.html", out, shown, formats, paper=paper), encoding="utf-8")


def compared(table: Table) -> Table:
    """A table with the deviations of its columns from the paper's."""
    names = [name for name in table.columns if f"paper_{name}" in table.columns]
    pairs = [(table.columns.index(name), table.columns.index(f"paper_{name}")) for name in names]
    rows = tuple((*row, *(_difference(row[ours], row[printed]) for ours, printed in pairs)) for row in table.rows)
    deviations = {name: name.replace("error", "deviation") for name in names}
    printed = {name: f"paper_{name}" for name in names}
    digits = {deviations[name]: table.digits[each] for name, each in printed.items() if each in table.digits}
    columns = (*table.columns, *deviations.values())
    return replace(table, columns=columns, rows=rows, digits={**table.digits, **digits})


def _difference(a: Cell, b: Cell) -> Cell:
    return a - b if isinstance(a, float) and isinstance(b, float) else None
