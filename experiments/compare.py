"""Results of identify, or models, side by side: differences of parameters and settings, or of bodies and drives."""

import argparse
from dataclasses import replace
from pathlib import Path

from experiments.cli import options, print_options, running


def run(args: argparse.Namespace) -> None:
    """Compares results or models, and writes and prints the differences."""
    from experiments.studies.model_files import is_model
    from ident.errors import InputError

    models = [path for path in args.results if is_model(path)]
    if not models:
        _compare_results(args)
    elif len(models) == len(args.results):
        _compare_models(args)
    else:
        raise InputError("A comparison is of folders of results or of model files, not of both.")


def _compare_models(args: argparse.Namespace) -> None:
    from experiments.document.provenance import provenance
    from experiments.document.writer import write
    from experiments.reports import compare_models_report
    from experiments.studies.model_files import compared_models

    read = options.of_model(args)
    compared = compared_models(args.results, **read)
    out = print_options.output_of(args)
    own = {"models": list(map(str, args.results)), "packages": list(map(str, args.packages))}
    origin = provenance({**read, **own, **out.choices})
    document = compare_models_report.document(compared, origin, out.layout)
    write(document, replace(out, checked=True), stale=compare_models_report.OUTPUTS, inputs=args.results)


def _compare_results(args: argparse.Namespace) -> None:
    from experiments.document.provenance import provenance
    from experiments.document.writer import write
    from experiments.reports import compare_report
    from experiments.studies.result_files import read_results
    from ident.errors import InputError

    for name in ("base", "ignore", "packages", "fix"):
        if getattr(args, name):
            raise InputError(f"--{name} is for model files; results are compared as they were identified.")
    compared, out = read_results(args.results), print_options.output_of(args)
    if args.out.resolve() in {folder.resolve() for folder in args.results}:
        raise InputError(f"The comparison needs a folder of its own, but '{args.out}' holds one of the results.")
    origin = provenance({"results": list(map(str, args.results)), **out.choices})
    document = compare_report.document(compared, origin, out.layout)
    out, inputs = replace(out, checked=True), compare_report.inputs(args.results)
    write(document, out, stale=compare_report.OUTPUTS, inputs=inputs)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("compare", __doc__)
    out.add_argument(
        "results",
        type=Path,
        nargs="+",
        metavar="RESULT",
        help="folders that identify has written, or MJCF, URDF or OpenSim files; the first against all",
    )
    options.add_mechanism(out.add_argument_group("model files"))
    return out


main = running.main(__name__, run, parser)
