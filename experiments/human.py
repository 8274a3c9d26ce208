"""A simulated person on two force plates who holds a rail: segment estimates from a prior that is wrong by a fifth."""

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from experiments.cli import options, running
from ident.errors import InputError

if TYPE_CHECKING:
    from experiments.document.document import Document
    from experiments.document.writer import Output


GIVEN = "seed", "activities", "rate", "source", "noise", "rail", "persons", "workers", "resume"
"""Options of the study besides the length of recordings."""


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    given = {name: getattr(args, name) for name in GIVEN}
    report(options.output_of(args), args.seconds, **given)


def report(
    out: "Output",
    seconds: int,
    *,
    seed: int = 0,
    activities: Sequence[str] | None = None,
    rate: int = 50,
    source: str = "angles",
    noise: float | None = None,
    rail: bool = True,
    persons: int = 1,
    workers: int = 1,
    resume: bool = False,
) -> "Document":
    """Runs the study, writes and prints its results, and returns its document; arguments are the command's options."""
    from experiments.cli.own_model import progress
    from experiments.document.provenance import provenance
    from experiments.document.result_folder import writable
    from experiments.document.writer import write
    from experiments.reports import human_report
    from experiments.runs.workers import Workers
    from experiments.studies import human

    if persons == 1 and (resume or not rail):
        raise InputError("--no-rail and --resume belong to --persons; one person is studied with the rail and without.")
    laboratory = replace(human.laboratory(source, float(rate), noise), rail=rail)
    shared: dict[str, Any] = {"seed": seed, "laboratory": laboratory, "activities": activities}
    choices: dict[str, Any] = {"seed": seed, "seconds": seconds, "activities": activities, "rate": rate}
    choices |= {"source": source, "noise": None if laboratory.markers else laboratory.angle_deg}
    origin = provenance({**choices, "rail": rail, "persons": persons, "formats": out.formats, **out.choices})
    with writable(out.folder):
        if persons > 1:
            counts = human.counts(persons, float(seconds), out.folder, Workers(workers, resume=resume), **shared)
            document = human_report.count(counts, laboratory, origin)
        else:
            both = human.with_and_without_rail(float(seconds), workers=workers, report=progress, **shared)
            document = human_report.document(*both, origin)
    return write(document, out, stale=human_report.OUTPUTS)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("human", __doc__, options.PRINTED)
    out.add_argument("--seed", type=options.whole_number(0), default=0, help="of motions, noise and the wrong prior")
    out.add_argument("--seconds", type=options.whole_number(2, 120), default=4, help="length of each recording")
    out.add_argument("--activities", nargs="+", help="what is recorded, by default all that a person does")
    out.add_argument("--rate", type=options.whole_number(20, 200), default=50, help="samples per second")
    out.add_argument(
        "--from",
        dest="source",
        choices=("angles", "correlated", "markers"),
        default="angles",
        help="where angles come from: noise that is white, or correlated at 0.9 from sample to sample; or markers with "
        "2 mm on skin that moves",
    )
    noise = "standard deviation of angles not from markers, degrees, by default 0.5"
    out.add_argument("--noise", type=float, help=noise)
    out.add_argument(
        "--persons",
        type=options.whole_number(1, 1000),
        default=1,
        help="persons, each with other motions, noise and another wrong prior, of whom it is counted how often "
        "intervals hold, in place of the results of one person",
    )
    out.add_argument("--no-rail", dest="rail", action="store_false", help="persons who stand on the plates alone")
    options.add_resume(out)
    options.add_local_workers(out, default=min(2, os.cpu_count() or 1))
    return out


main = running.main(__name__, run, parser)
