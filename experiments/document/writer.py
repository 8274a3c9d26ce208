"""Writing of documents: HTML, TeX, Markdown, CSV and JSON files, and figures in a folder; text on the screen."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.document import drawn_data, figures, print_table, styles
from experiments.document.document import Document
from experiments.document.page import page
from experiments.document.result_folder import OUTPUTS, results_folder, write_json
from experiments.document.tabular import Table
from ident.files.atomic import replacing

PAGE = "report.html"
"""Name of the page in a folder of results."""


@dataclass(frozen=True)
class Output:
    """A folder for documents, and the formats of figures."""

    folder: Path
    formats: Sequence[str]

    @property
    def choices(self) -> dict[str, Any]:
        """Columns of the page if they are not the default, for the provenance."""
        columns = styles.page_columns()
        return {} if columns == 2 else {"page_columns": columns}


def write(
    document: Document, out: Output, *, stale: Sequence[str] = OUTPUTS, inputs: Sequence[Path] = (), then: str = ""
) -> Document:
    """Writes a document into its folder with a page, prints it and returns it.

    Args:
        document: The document.
        out: Its folder.
        stale: Patterns of files of an earlier run to remove.
        inputs: Input files, which are never replaced.
        then: What to do next, in a sentence.
    """
    written(document, out, stale=stale, inputs=inputs)
    print(document.text())
    end(document, out, then)
    return document


def end(document: Document, out: Output, then: str = "") -> None:
    """Prints where everything is and how to load recordings."""
    print(f"Everything is in {out.folder}; open {PAGE}.")
    for line in filter(None, (document.loading(out.folder), then)):
        print(line)


def written(document: Document, out: Output, *, stale: Sequence[str] = OUTPUTS, inputs: Sequence[Path] = ()) -> None:
    """Writes a document into its folder with a page, arguments as for `write`."""
    with results_folder(out.folder, stale=stale, inputs=inputs) as folder:
        write_parts(document, replace(out, folder=folder))
        for name, recording in document.recordings.items():
            recording.save(folder / name)
        for name, save in document.files.items():
            if save is not None:
                save(folder / name)
        write_page(document, folder, out.formats)


def write_parts(document: Document, out: Output) -> None:
    """Writes tables, figures with their data, and numbers into a folder."""
    for name, table in document.tables.items():
        _write_table(table, out.folder, name)
    for name, (figure, caption) in document.figures.items():
        figures.save(figure, out.folder, name, out.formats)
        (out.folder / f"{name}.csv").write_text(drawn_data.csv_text(figure), encoding="utf-8")
        if "pdf" in out.formats:
            content = print_table.figure(name, caption, float(figure.get_figwidth()))
            (out.folder / f"{name}.tex").write_text(content, encoding="utf-8")
    for name, numbers in document.numbers.items():
        write_json(out.folder / f"{name}.json", numbers)


def _write_table(table: Table, folder: Path, name: str) -> None:
    """Writes `name.csv`, `name.md` and `name.tex` into a folder."""
    forms = {"csv": table.csv(), "md": table.markdown(), "tex": print_table.tex(table, name)}
    for suffix, content in forms.items():
        (folder / f"{name}.{suffix}").write_text(content, encoding="utf-8")


def write_page(document: Document, folder: Path, formats: Iterable[str]) -> None:
    """Writes `report.html` into a folder that holds the document's other files, with links to them."""
    moving = None if document.replay is None else document.replay.to_page()
    content = page("report.html", folder, {"": document}, formats, replay=moving)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(content, encoding="utf-8", errors="backslashreplace")
