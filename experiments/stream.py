"""The former name of `identify --estimator ordinary --holdout 0`, for one more version."""

import argparse
import sys

from experiments import identify
from experiments.cli import running

FORMER = (
    "`stream` is `identify --estimator ordinary --holdout 0` now, and goes with the next version. For logs larger than "
    "memory see docs/long_recordings.md."
)
"""Sentence printed before the estimate."""


def run(args: argparse.Namespace) -> None:
    """Says what to use instead, and identifies."""
    print(FORMER, file=sys.stderr)
    identify.run(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options, those of `identify`."""
    out = identify.parser()
    out.prog, out.description = "python -m experiments.stream", __doc__
    out.set_defaults(estimator="ordinary", holdout=0.0)
    return out


main = running.main(__name__, run, parser)
