"""A recorded person who bows on a force plate: estimates of legs and trunk by several estimators, and predictions."""

import argparse
from pathlib import Path

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.in_vivo import report

    report.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("in_vivo", __doc__)
    out.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="folder of the recording, which is not ours to ship"
    )
    options.add_film(out)
    return out


main = options.main(__name__, run, parser)
