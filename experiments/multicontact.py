"""Section VII: identification with a contact at the end of the second link, or several (Table IV, Figures 4 and 5)."""

import argparse

import scenes
from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.output import contacts_report

    contacts_report.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("multicontact", __doc__)
    out.add_argument(
        "--contact",
        nargs="+",
        choices=scenes.CONTACTS,
        default=["pad"],
        help="what touches the second link; of both at the same time the pad does, and the handle holds the first",
    )
    return out


main = options.main(__name__, run, parser)
