"""Section VII: identification with a contact at the end of the second link, or several (Table IV, Figures 4 and 5)."""

import argparse

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.reports import study_report
    from experiments.studies.study_entries import packaged

    chosen = {"contact": " ".join(args.contact)} if args.contact else {}
    study_report.run(args, packaged("multicontact", **chosen))


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("multicontact", __doc__)
    options.add_contact(out)
    return out


main = options.main(__name__, run, parser)
