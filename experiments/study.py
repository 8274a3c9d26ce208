"""Runs a simulated study of your own, stated in one file: its tables and figures as in print."""

import argparse
import hashlib
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.cli import options, running

if TYPE_CHECKING:
    from experiments.data.study_file import StudyFile
    from experiments.document.writer import Document, Output
    from experiments.studies.simulation import Trials


def run(args: argparse.Namespace) -> None:
    """Runs the study, and writes and prints its results."""
    from experiments.studies.study_entries import PACKAGED, packaged, read

    own = str(args.file) not in PACKAGED
    file = read(args.file) if own else packaged(str(args.file))
    if args.contact:
        file = file.with_options(contact=" ".join(args.contact))
    out = options.output_of(args, args.out or Path("results") / args.file.stem)
    report(with_options(file, args), out, trials_of(args), args.file if own else None)


def with_options(file: "StudyFile", args: argparse.Namespace) -> "StudyFile":
    """The study with the values of the command line, which precede the file's."""
    given = {name: getattr(args, name, None) for name in ("seed", "samples", "tilt_deg", "azimuth_deg", "noise_scale")}
    return file.with_options(**{name: value for name, value in given.items() if value is not None})


def trials_of(args: argparse.Namespace) -> "Trials":
    """Trials that the command line asks for."""
    from experiments.studies.simulation import Trials

    return Trials(args.trials, args.trajectory_trials, args.redraw, options.workers_of(args))


def report(file: "StudyFile", out: "Output", trials: "Trials", source: Path | None = None) -> "Document":
    """Runs a study and its trials, writes and prints their results, and returns their document.

    Args:
        file: The study.
        out: Folder of the results, and formats of figures.
        trials: How many trials to run, and how.
        source: Path of the study's file; None for a study of the package.
    """
    from experiments.data.fitting import ESTIMATORS
    from experiments.document.result_folder import provenance
    from experiments.document.writer import end, write_page, written
    from experiments.reports import paper_report, study_report
    from experiments.studies.simulation import check_numbers, distributions, draw_of, simulated, swept

    study, inputs = simulated(file), [] if source is None else [source]
    check_numbers(study)
    origin = provenance({**file.options, "formats": out.formats}, study.recording.provenance)
    origin["estimators"] = ESTIMATORS
    draw = draw_of(study, trials, out.folder)
    if source is not None:
        origin["study"] = {"file": source.name, "sha256": hashlib.sha256(source.read_bytes()).hexdigest()}
    document = study_report.document(study, origin)
    written(document, out, stale=study_report.OUTPUTS, inputs=inputs)
    print(document.text())
    if trials.trials:
        drawn = distributions(study, draw, trials, out.folder)
        document |= added(paper_report.trials_document(drawn, study, trials.redraw, provenance(draw.identity)), out)
    if file.sweep:
        of_sweep = provenance({**draw.identity, **asdict(file.sweep)})
        runs = swept(draw, trials, out.folder)
        document |= added(paper_report.sweep_document(runs, file.title, file.sweep.numbers, of_sweep), out)
    if trials.trials or file.sweep:
        write_page(document, out.folder, out.formats)
    end(document, out)
    return document


def added(more: "Document", out: "Output") -> "Document":
    """Writes the tables, figures and numbers of a document into a folder of results, prints it, and returns it."""
    from experiments.document.result_folder import results_folder
    from experiments.document.writer import write_parts

    with results_folder(out.folder) as folder:
        write_parts(more, replace(out, folder=folder))
    print(more.text())
    return more


OPTIONS: options.Options = {
    **options.study(""),
    "file": ("TOML file, or the name of one that comes with this package, such as misaligned", options.FILE),
    **options.TILTED,
    **options.CONTACT,
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.study", __doc__, run, OPTIONS)
