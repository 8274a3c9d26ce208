"""Results of identify, or models, side by side: differences of parameters and settings, or of bodies and drives."""

import argparse
from dataclasses import replace
from pathlib import Path

from experiments.cli import options, print_options, running


def run(args: argparse.Namespace) -> None:
    """Compares results or models, and writes and prints the differences."""
    from ident.errors import InputError

    files = [path for path in args.results if path.is_file()]
    if files and len(files) < len(args.results):
        raise InputError("A comparison is of folders of results or of model files, not of both.")
    _compare_models(args) if files else _compare_results(args)


def _compare_models(args: argparse.Namespace) -> None:
    from experiments.document.provenance import provenance
    from experiments.document.writer import write
    from experiments.reports import compare_models_report
    from experiments.studies.model_files import compared_models

    compared, out = compared_models(args.results, args.base), print_options.output_of(args, formats=())
    origin = provenance({"models": list(map(str, args.results)), "base": args.base, **out.choices})
    document = compare_models_report.document(compared, origin)
    write(document, out, stale=compare_models_report.OUTPUTS, inputs=args.results)


def _compare_results(args: argparse.Namespace) -> None:
    from experiments.document.provenance import provenance
    from experiments.document.writer import write
    from experiments.reports import compare_report
    from experiments.studies.result_files import read_results
    from ident.errors import InputError

    if args.base is not None:
        raise InputError("--base is for model files; results have the base that they were identified with.")
    compared, out = read_results(args.results), print_options.output_of(args, formats=("pdf", "svg", "png"))
    if args.out.resolve() in {folder.resolve() for folder in args.results}:
        raise InputError(f"The comparison needs a folder of its own, but '{args.out}' holds one of the results.")
    origin = provenance({"results": list(map(str, args.results)), **out.choices})
    document = compare_report.document(compared, origin, out.layout)
    out, inputs = replace(out, checked=True), compare_report.inputs(args.results)
    write(document, out, stale=compare_report.OUTPUTS, inputs=inputs)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.print_parser("compare", __doc__)
    out.add_argument(
        "results",
        type=Path,
        nargs="+",
        metavar="RESULT",
        help="folders that identify has written, or MJCF, URDF or OpenSim files; the first against all",
    )
    out.add_argument("--base", help="of models: body whose frame is {0}, by default the world")
    return out


main = running.main(__name__, run, parser)
