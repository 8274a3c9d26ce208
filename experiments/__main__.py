"""Runs everything: the mechanism, both studies, several contacts at once, and a person; and writes one page of all."""

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments import human, mechanism, study
from experiments.cli import options, running

if TYPE_CHECKING:
    from experiments.document.tabular import Cell, Table
    from experiments.document.writer import Document

PERSON = ["--seconds", "3"]
"""Options of the simulated person: recordings long enough to predict all channels of unseen motions at least three
times better than the prior, with and without a rail (`docs/human.md`), and short enough to take a minute or two."""

STUDIES = ("misaligned", "multicontact", "several_contacts")
"""Simulated studies."""


def run(args: argparse.Namespace) -> None:
    """Runs every study with its defaults, into folders of their own."""
    from experiments.studies.simulation import FILE
    from experiments.studies.study_entries import packaged

    out = options.output_of(args)
    documents = {"mechanism": mechanism.report(replace(out, folder=args.out / "mechanism"))}
    print()
    for name in STUDIES:
        own = replace(out, folder=args.out / name)
        # A study that the interrupted run had not begun starts from the beginning.
        trials = study.trials_of(args)
        resume = args.resume and (own.folder / FILE).exists()
        trials = replace(trials, workers=replace(trials.workers, resume=resume))
        documents[name] = study.report(packaged(name), own, trials)
        print()
    person = human.parser().parse_args([*PERSON, "--workers", str(args.workers)])
    documents["human"] = human.report(person, replace(out, folder=args.out / "human"))
    print()
    write_index(args.out, documents, out.formats)
    print(f"Everything on one page: {args.out / 'index.html'}")


def write_index(out: Path, results: "Mapping[str, Document]", formats: Iterable[str]) -> None:
    """Writes `out/index.html`, one self-contained page with all tables and figures beside the paper's numbers.

    Args:
        out: Folder of the studies' folders.
        results: Documents of the studies of `python -m experiments`, by folder name.
        formats: Formats of the figures.
    """
    from experiments.data import paper
    from experiments.document.writer import page
    from ident.files.atomic import replacing

    shown = dict[str, "Document"]()
    for folder, document in results.items():
        own = {f"{name}_printed": printed(document.tables[name]) for name in PRINTED.get(folder, ())}
        tables = {name: compared(table) for name, table in document.tables.items()}
        shown[folder] = replace(document, tables=tables | own)
    with replacing(out / "index.html") as temporary:
        temporary.write_text(page("index.html", out, shown, formats, paper=paper), encoding="utf-8")


PRINTED = {"misaligned": ("table_3",), "multicontact": ("table_4",)}
"""The paper's tables of parameters, by the folder of their study."""


def printed(table: "Table") -> "Table":
    """A table's columns that the paper prints, each beside ours."""
    from experiments.document.tabular import heading

    pairs = {f"paper_{name}": name for name in table.columns if f"paper_{name}" in table.columns}
    pairs = {ours: theirs for ours, theirs in TRUE.items() if ours in table.columns} | pairs
    words = {each: table.heads.get(each, heading(each)) for pair in pairs.items() for each in pair}
    heads = {theirs: f"{words[ours].removesuffix(', scene')}, paper" for theirs, ours in pairs.items()}
    heads |= {ours: f"{words[ours].removesuffix(', scene')}, ours" for ours in pairs.values()}
    columns = (table.columns[0], *(name for pair in pairs.items() for name in pair))
    kept = [table.columns.index(name) for name in columns]
    rows = [[row[k] for k in kept] for row in table.rows]
    digits = {each: table.digits[pair[0]] for pair in pairs.items() if pair[0] in table.digits for each in pair}
    shown = replace(table, title=table.caption, columns=columns, rows=rows, heads=heads, notes=())
    return replace(shown, digits=digits, deviations={})


TRUE = {"true_paper": "true_scene"}
"""Column of the paper's true values, and of ours."""


def compared(table: "Table") -> "Table":
    """A table with the deviations of its columns from the paper's."""
    names = [name for name in table.columns if f"paper_{name}" in table.columns]
    pairs = [(table.columns.index(name), table.columns.index(f"paper_{name}")) for name in names]
    rows = [(*row, *(_difference(row[ours], row[printed]) for ours, printed in pairs)) for row in table.rows]
    deviations = {name: name.replace("error", "deviation") for name in names}
    printed = {name: f"paper_{name}" for name in names}
    digits = {deviations[name]: table.digits[each] for name, each in printed.items() if each in table.digits}
    columns = (*table.columns, *deviations.values())
    return replace(table, columns=columns, rows=rows, digits={**table.digits, **digits})


def _difference(a: "Cell", b: "Cell") -> "Cell":
    return a - b if isinstance(a, float) and isinstance(b, float) else None


OPTIONS: options.Options = {**options.output("results", *options.PRINTED), **options.TRIALS}
"""Options of the command."""

parser, main = running.command(__name__, "experiments", __doc__, run, OPTIONS)
