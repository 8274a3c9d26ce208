"""A recorded person who bows on a force plate: estimates of legs and trunk by several estimators, and predictions."""

import argparse
from pathlib import Path

from experiments.cli import options, print_options, running


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.cli.own_model import progress
    from experiments.document.provenance import provenance
    from experiments.document.result_folder import writable
    from experiments.document.writer import write
    from experiments.in_vivo import report
    from experiments.in_vivo.study import study

    out = print_options.output_of(args)
    with writable(args.out):
        results = study(args.data, progress)
    write(report.document(results, provenance({"formats": args.formats, **out.choices})), out)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("in_vivo", __doc__)
    out.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="folder of the recording, which is not ours to ship"
    )
    options.add_film(out)
    return out


main = running.main(__name__, run, parser)
