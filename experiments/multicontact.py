"""Studies a contact at the end of the second link, or several (Section VII: Table IV, Figures 4 and 5)."""

import argparse

from experiments import study
from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.studies.study_entries import packaged

    chosen = {"contact": " ".join(args.contact)} if args.contact else {}
    file = study.with_options(packaged("multicontact", **chosen), args)
    study.report(file, options.output_of(args), study.trials_of(args))


OPTIONS = options.study("results/multicontact") | options.CONTACT
parser, main = running.command(__name__, "experiments.multicontact", __doc__, run, OPTIONS)
