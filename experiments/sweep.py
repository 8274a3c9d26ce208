"""A study over the values of one of its options and several seeds: a table, a chart, and all its numbers."""

import argparse

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the sweep and writes and prints its results."""
    from experiments.studies import sweep

    sweep.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("sweep", __doc__)
    out.add_argument("study", choices=("misaligned", "multicontact"), help="study to run")
    out.add_argument(
        "--over", nargs="+", required=True, metavar=("OPTION", "VALUE"), help="option of the study, and its values"
    )
    out.add_argument("--seeds", type=options.whole_number(1, 10_000), default=1, help="runs of each value")
    out.add_argument("--numbers", nargs="+", metavar="NAME", help="numbers of the study's summary that the chart shows")
    options.add_workers(out)
    return out


main = options.main(__name__, run, parser)
