"""The double pendulum itself: Figure 1 and Table II from the scene's own geometry, and Table I as printed."""

import argparse

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Writes and prints the mechanism."""
    from experiments.studies import mechanism

    mechanism.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    return options.output_parser("mechanism", __doc__)


main = options.main(__name__, run, parser)
