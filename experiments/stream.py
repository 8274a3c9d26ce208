"""Identifies as `identify --estimator ordinary --holdout 0` does, under its former name, for one more version."""

import argparse
import sys

from experiments import identify
from experiments.cli import options, running

FORMER = (
    "`stream` is `identify --estimator ordinary --holdout 0` now, and goes with the next version. For logs larger than "
    "memory see docs/long_recordings.md."
)
"""Sentence printed before the estimate."""


def run(args: argparse.Namespace) -> None:
    """Says what to use instead, and identifies."""
    print(FORMER, file=sys.stderr)
    identify.run(args)


def with_default(name: str, value: object) -> options.Options:
    """A row of `identify`'s options with another default."""
    text, given = identify.OPTIONS[name]
    return {name: (text, given | {"default": value})}


OPTIONS = {**identify.OPTIONS, **with_default("--estimator", "ordinary"), **with_default("--holdout", 0.0)}
parser, main = running.command(__name__, "experiments.stream", __doc__, run, OPTIONS)
