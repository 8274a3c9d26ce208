"""Identifies a simulated person on two force plates who holds a rail, from a prior that is wrong by a fifth."""

import argparse
import os
from dataclasses import replace
from typing import TYPE_CHECKING

from experiments.cli import options, running
from ident.errors import InputError

if TYPE_CHECKING:
    from experiments.document.writer import Document, Output


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    report(args, options.output_of(args))


def report(args: argparse.Namespace, out: "Output") -> "Document":
    """Runs the study that the command's options state, writes and prints its results, and returns its document."""
    from experiments.cli.options import progress
    from experiments.document.result_folder import provenance, writable
    from experiments.document.writer import write
    from experiments.reports import human_report
    from experiments.studies import person_on_plates

    if args.persons == 1 and (args.resume or not args.rail):
        raise InputError("--no-rail and --resume belong to --persons; one person is studied with the rail and without.")
    laboratory = replace(person_on_plates.laboratory(args.source, float(args.rate), args.noise), rail=args.rail)
    shared = {"seed": args.seed, "laboratory": laboratory, "activities": args.activities}
    choices = {
        key: getattr(args, key) for key in ("seed", "seconds", "activities", "rate", "source", "rail", "persons")
    }
    choices |= {"noise": None if laboratory.markers else laboratory.angle_deg, "formats": out.formats}
    origin, seconds = provenance(choices), float(args.seconds)
    with writable(out.folder):
        if args.persons > 1:
            counts = person_on_plates.counts(args.persons, seconds, out.folder, options.workers_of(args), **shared)
            document = human_report.count(counts, laboratory, origin)
        else:
            both = person_on_plates.with_and_without_rail(seconds, workers=args.workers, report=progress, **shared)
            document = human_report.document(*both, origin)
    return write(document, out, stale=human_report.OUTPUTS)


OPTIONS: options.Options = {
    **options.output("results/human", *options.PRINTED),
    "--seed": ("of motions, noise and the wrong prior", {"type": options.whole_number(0), "default": 0}),
    "--seconds": ("length of each recording", {"type": options.whole_number(2, 120), "default": 4}),
    "--activities": ("what is recorded, by default all that a person does", {"nargs": "+"}),
    "--rate": ("samples per second", {"type": options.whole_number(20, 200), "default": 50}),
    "--from": (
        "where angles come from: noise that is white, or correlated at 0.9 from sample to sample; or markers with "
        "2 mm on skin that moves",
        {"dest": "source", "choices": ("angles", "correlated", "markers"), "default": "angles"},
    ),
    "--noise": ("standard deviation of angles not from markers, degrees, by default 0.5", {"type": options.NUMBER}),
    "--persons": (
        "persons, each with other motions, noise and another wrong prior, of whom it is counted how often "
        "intervals hold, in place of the results of one person",
        {"type": options.whole_number(1, 1000), "default": 1},
    ),
    "--no-rail": ("with --persons: who stand on the plates alone", {"dest": "rail", "action": "store_false"}),
    **options.RESUME,
    **options.workers(min(2, os.cpu_count() or 1)),
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.human", __doc__, run, OPTIONS)
