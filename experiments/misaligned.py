"""Section VI: what a 5° tilt of the joint axes does to a model that neglects it (Table III, Figures 2 and 3)."""

import argparse

from experiments.cli import options
from experiments.cli.defaults import AZIMUTH_DEG
from experiments.studies import paper


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.output import tilted_axes_report

    tilted_axes_report.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("misaligned", __doc__)
    out.add_argument("--tilt-deg", type=float, default=paper.TILT_DEG, help="angle of both joint axes from X")
    out.add_argument("--azimuth-deg", type=float, default=AZIMUTH_DEG, help="direction of the tilt, from +Y to +Z")
    return out


main = options.main(__name__, run, parser)
