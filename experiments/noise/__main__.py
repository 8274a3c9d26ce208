"""Biases and spreads of estimators with noisy sensors, friction and bad motions, and coverage of their intervals."""

import argparse

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.noise import report

    report.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("noise", __doc__)
    out.add_argument("--seed", type=options.whole_number(0), default=0, help="seed of all noise")
    out.add_argument(
        "--recordings", type=options.whole_number(2, 100_000), default=5, help="recordings of each kind of noise"
    )
    out.add_argument(
        "--conditions",
        nargs="+",
        metavar="NAME",
        help="conditions to look at, by default all of them; a wrong name lists them",
    )
    options.add_workers(out)
    return out


main = options.main(__name__, run, parser)
