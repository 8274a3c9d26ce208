"""Results of identify side by side: differences of parameters and settings."""

import argparse
from os.path import realpath
from pathlib import Path

from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Compares results, and writes and prints the differences."""
    from experiments.data.comparison import read_results
    from experiments.document.provenance import provenance
    from experiments.document.writer import write
    from experiments.reports import compare_report
    from ident.errors import InputError

    compared, out = read_results(args.results), options.output_of(args)
    if realpath(args.out) in map(realpath, args.results):
        raise InputError(f"The comparison needs a folder of its own, but '{args.out}' holds one of the results.")
    origin = provenance({"results": list(map(str, args.results))})
    inputs = compare_report.inputs(args.results)
    write(compare_report.document(compared, origin), out, stale=compare_report.OUTPUTS, inputs=inputs)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("compare", __doc__)
    text = "folders that identify has written; the first against all"
    out.add_argument("results", type=Path, nargs="+", metavar="RESULT", help=text)
    return out


main = running.main(__name__, run, parser)
