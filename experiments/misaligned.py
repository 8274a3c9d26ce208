"""Studies a 5° tilt of the joint axes and a model that neglects it (Section VI: Table III, Figures 2 and 3)."""

import argparse

from experiments import study
from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.studies.study_entries import packaged

    file = study.with_options(packaged("misaligned"), args)
    study.report(file, options.output_of(args), study.trials_of(args))


OPTIONS = options.study("results/misaligned") | options.TILTED
parser, main = running.command(__name__, "experiments.misaligned", __doc__, run, OPTIONS)
