"""One self-contained page with every table and figure of the studies beside the paper's numbers."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from experiments.output.page import rendered
from experiments.output.results import Results
from experiments.studies import paper
from ident.recordings.atomic import replacing


def write_index(out: Path, results: Mapping[str, Results], formats: Iterable[str]) -> None:
    """Writes `out/index.html`.

    Args:
        out: Folder that holds those of the studies.
        results: What the studies of `python -m experiments` have written, by the names of their folders.
        formats: Formats of the figures, PNG among them.
    """
    with replacing(out / "index.html") as temporary:
        temporary.write_text(rendered("index.html", out, results, formats, paper=paper), encoding="utf-8")
