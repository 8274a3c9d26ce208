"""Section VI: effect of a 5° tilt of the joint axes on a model that neglects it (Table III, Figures 2 and 3)."""

import argparse

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.reports import study_report
    from experiments.studies.study_entries import packaged

    study_report.run(args, packaged("misaligned"))


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("misaligned", __doc__)
    options.add_tilt(out)
    return out


main = options.main(__name__, run, parser)
