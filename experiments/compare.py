"""Results of identify side by side: differences of parameters with their intervals, prediction, set-up, settings."""

import argparse
from pathlib import Path

from experiments.cli import options, print_options


def run(args: argparse.Namespace) -> None:
    """Compares results, and writes and prints the differences."""
    from experiments.document import report
    from experiments.document.page import PAGE
    from experiments.reports import compare_report
    from experiments.studies.result_files import read_results
    from ident.errors import InputError

    compared, layout = read_results(args.results), print_options.layout_of(args)
    if args.out.resolve() in {folder.resolve() for folder in args.results}:
        raise InputError(f"The comparison needs a folder of its own, but '{args.out}' holds one of the results.")
    origin = report.provenance({"results": list(map(str, args.results)), **print_options.author_choices(args)})
    inputs = compare_report.inputs(args.results)
    with report.results_folder(args.out, stale=compare_report.OUTPUTS, inputs=inputs) as folder:
        shown = compare_report.results(compared, origin, layout)
        compare_report.write(shown, compared, folder, layout)
    print(compare_report.text(shown, compared))
    print(f"Everything is in {args.out}; open {PAGE}.")


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.print_parser("compare", __doc__)
    out.add_argument(
        "results",
        type=Path,
        nargs="+",
        metavar="RESULT",
        help="folders that identify has written, the first against all",
    )
    return out


main = options.main(__name__, run, parser)
