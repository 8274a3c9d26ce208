"""The dynamic identification model of a mechanism in closed form: LaTeX, Python and C."""

import argparse

from experiments.cli import options, running
from experiments.runs.environment import extra


def run(args: argparse.Namespace) -> None:
    """Derives a model and writes it."""
    with extra("symbolic"):
        from experiments.symbols import derivation
    derivation.run(args.mechanism, args.base, args.ignore, args.out)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.command_parser("derive", __doc__)
    out.epilog = (
        "The regressor Y and the base parameters are those of the wrench at the base, which rests; parameters are "
        "regrouped with gravity along -Z of the base frame."
    )
    out.add_argument("mechanism", help="table_1 or table_2 for the paper's double pendulum, or an MJCF or URDF file")
    out.add_argument("--base", help="body whose frame is {0}; by default the world's frame is")
    out.add_argument("--ignore", nargs="*", default=[], help="equality constraints and tendons to leave out")
    return out


main = running.main(__name__, run, parser)
