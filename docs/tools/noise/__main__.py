"""Biases and spreads of estimators with noisy sensors, friction and bad motions, and coverage of their intervals."""

import argparse
from dataclasses import asdict
from functools import partial

from docs.tools.noise import counts
from docs.tools.noise.conditions import CONDITIONS
from experiments.cli import options, running
from experiments.document.result_folder import provenance
from experiments.document.writer import Document, write
from experiments.runs.workers import Checkpoint
from ident.errors import InputError

FILE = "fits.npz"
"""File in the output folder with the fits of each recording."""


def run(args: argparse.Namespace) -> None:
    """Identifies all recordings, and writes and prints the results."""
    if unknown := [name for name in args.conditions or () if name not in CONDITIONS]:
        raise InputError(f"Conditions are {', '.join(CONDITIONS)}; got '{unknown[0]}'.")
    chosen = {name: asdict(CONDITIONS[name]) for name in CONDITIONS if name in (args.conditions or CONDITIONS)}
    identity = {"seed": args.seed, "conditions": chosen}
    args.out.mkdir(parents=True, exist_ok=True)
    todo, kept = counts.tasks(args.recordings, tuple(chosen)), Checkpoint("fits", args.out / FILE, identity)
    outcomes = options.workers_of(args).collected(partial(counts.fits, args.seed), todo, kept)
    answers = counts.by_estimator(todo, outcomes)
    tables = {"table_coverage": counts.table_coverage(answers), "table_parameters": counts.table_parameters(answers)}
    origin = provenance({**identity, "recordings": args.recordings})
    numbers = {"summary": {"setup_reported": counts.reported(answers)}, "provenance": origin}
    document = Document(
        "Bad motions and sensors", tables=tables, numbers=numbers, screen=tables["table_coverage"].text()
    )
    write(document, options.output_of(args))


OPTIONS: options.Options = {
    **options.output("results/noise"),
    "--seed": ("seed of all noise", {"type": int, "default": 0}),
    "--recordings": ("recordings of each condition", {"type": options.whole_number(2), "default": 5}),
    "--conditions": ("rows of CONDITIONS, by default all", {"nargs": "+", "metavar": "NAME"}),
    **options.WORKERS,
}
"""Options of the command."""

parser, main = running.command(__name__, "docs.tools.noise", __doc__, run, OPTIONS)
