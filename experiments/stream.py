"""Base parameters from recordings of any length, read and worked on piece by piece.

Results are those of `identify --estimator ordinary --holdout 0` with the same options: other estimators need all
residuals at once and several passes, and a held-out fraction needs the number of samples before the first is read.
"""

import argparse
from pathlib import Path

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints the results."""
    from experiments.studies import stream

    stream.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.print_parser("stream", __doc__)
    out.add_argument("model", type=Path, help="MJCF, URDF or OpenSim file")
    out.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        help="CSV or npz files with the channels JOINT_position, JOINT_velocity, JOINT_acceleration of every joint, "
        "ground_force and ground_torque, or what --columns says",
    )
    options.add_mechanism(out)
    options.add_fit(out)
    out.add_argument("--contact", nargs="*", default=[], help="wrenches at the sites of the same names")
    out.add_argument("--without", nargs="*", default=[], help="wrenches to leave out")
    out.add_argument("--piece", type=options.whole_number(1, 10_000_000), help="samples read at a time")
    options.add_workers(out.add_argument_group("workers"))
    return out


main = options.main(__name__, run, parser)
