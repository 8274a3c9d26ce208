"""Runs a study over the values of one of its options: `[sweep]` of a study file, under its former name."""

import argparse
import sys

from experiments import study
from experiments.cli import options, running

FORMER = (
    "`sweep` is a table [sweep] of a study file now, for `study FILE`, and goes with the next version; see "
    "docs/study_files.md."
)
"""Sentence printed before the study."""


def run(args: argparse.Namespace) -> None:
    """Says what to use instead, and runs the study with its sweep."""
    from experiments.studies.simulation import Trials
    from experiments.studies.study_entries import packaged, with_sweep

    print(FORMER, file=sys.stderr)
    option, *texts = args.over
    sweep = {"option": option, "values": [*map(_value, texts)], "seeds": args.seeds, "numbers": args.numbers}
    out = options.output_of(args, args.out / args.study / option)
    study.report(with_sweep(packaged(args.study), sweep), out, Trials(0, 0, "all", options.workers_of(args)))


def _value(text: str) -> int | float | str:
    """A value of an option as a study file would have it."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


OPTIONS: options.Options = {
    **options.output("results/sweep", *options.PRINTED),
    "study": ("study to run", {"choices": ("misaligned", "multicontact")}),
    "--over": ("option of the study, and its values", {"nargs": "+", "required": True, "metavar": ("OPTION", "VALUE")}),
    "--seeds": ("runs of each value", {"type": options.whole_number(1, 10_000), "default": 1}),
    "--numbers": ("numbers of the summary in the chart", {"nargs": "+", "default": [], "metavar": "NAME"}),
    **options.WORKERS,
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.sweep", __doc__, run, OPTIONS)
