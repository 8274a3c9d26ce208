"""Compares results of identify side by side: differences of parameters and settings."""

import argparse
from os.path import realpath
from pathlib import Path

from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Compares results, and writes and prints the differences."""
    from experiments.data.comparison import read_results
    from experiments.document.result_folder import provenance
    from experiments.document.writer import write
    from experiments.reports import compare_report
    from ident.errors import InputError

    compared, out = read_results(args.results), options.output_of(args)
    if realpath(args.out) in map(realpath, args.results):
        raise InputError(f"The comparison needs a folder of its own, but '{args.out}' holds one of the results.")
    origin = provenance({"results": list(map(str, args.results))})
    inputs = compare_report.inputs(args.results)
    write(compare_report.document(compared, origin), out, stale=compare_report.OUTPUTS, inputs=inputs)


OPTIONS: options.Options = {
    **options.output("results/compare", "svg"),
    "results": (
        "folders that identify has written; the first against all",
        {"type": Path, "nargs": "+", "metavar": "RESULT"},
    ),
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.compare", __doc__, run, OPTIONS)
