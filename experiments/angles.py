"""Joint angles from the positions of markers, their noise, and the lengths of segments."""

import argparse
from pathlib import Path

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Fits a trial, and writes and prints the results."""
    from experiments.studies import angles

    angles.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("angles", __doc__)
    out.add_argument(
        "model",
        type=Path,
        help="MJCF, URDF or OpenSim file with sites or markers named like the labels, or see --places",
    )
    out.add_argument("markers", type=Path, help=".trc or .c3d file, or a table with columns time, LABEL.x, .y and .z")
    out.add_argument(
        "--places",
        type=Path,
        metavar="TOML",
        help="file that says which sites, or places on bodies, markers stand for; their weights, unit and upward axis, "
        "and which bodies scale alike",
    )
    out.add_argument(
        "--base",
        help="body whose frame is {0}, by default the one with the model's only free joint, or the world",
    )
    options.add_fixed(out)
    out.add_argument(
        "--wrenches",
        type=Path,
        metavar="LOG",
        help="CSV or npz file with wrenches on the same clock, columns time, NAME_force.x to NAME_torque.z, to go into "
        "the same file as the angles",
    )
    scale = out.add_argument_group("lengths of segments")
    scale.add_argument(
        "--scale", action="store_true", help="find a factor on the lengths of each body, and write the model with them"
    )
    scale.add_argument("--symmetric", action="store_true", help="the left side is as long as the right one")
    scale.add_argument(
        "--scale-from",
        type=Path,
        metavar="MARKERS",
        help="another trial to find them from, as one that stands still in several postures",
    )
    scale.add_argument("--mass", type=float, metavar="KG", help="mass of the whole scaled model, by default as it is")
    return out


main = options.main(__name__, run, parser)
