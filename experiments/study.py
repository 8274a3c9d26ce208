"""A simulated study of your own, stated in one file: its tables and figures as in print."""

import argparse
from pathlib import Path

from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs the study, and writes and prints its results."""
    from experiments.reports import study_report
    from experiments.studies.study_entries import PACKAGED, packaged, read

    own = str(args.file) not in PACKAGED
    file = read(args.file) if own else packaged(str(args.file))
    if args.contact:
        file = file.with_options(contact=" ".join(args.contact))
    args.out = args.out or Path("results") / args.file.stem
    study_report.run(args, file, args.file if own else None)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("study", __doc__)
    out.set_defaults(out=None)
    out.add_argument("file", type=Path, help="TOML file, or the name of one that comes with this package: misaligned")
    options.add_tilt(out)
    options.add_contact(out)
    return out


main = options.main(__name__, run, parser)
