"""Validates on public recordings, with the defaults of identify: where it wins, and where it loses.

Each recording of the registry is identified unattended: parameters beside published ones, held-out residuals beside
those of the model as it came and of least squares at the best of five cut-offs, agreement of halves and of trials.
Recordings are not shipped; --data names a folder that holds them, or --fetch downloads those whose licence allows it.
"""

import argparse
import os
from pathlib import Path

from experiments.cli import options, running
from ident.errors import InputError

VARIABLE = "MULTICONTACT_DATA"
"""Environment variable with a folder of recordings."""


def run(args: argparse.Namespace) -> None:
    """Validates, and writes and prints the results."""
    from experiments.document.result_folder import provenance, writable
    from experiments.document.writer import write
    from experiments.reports import validation_report
    from experiments.runs.workers import Workers
    from experiments.studies.validation.files import Places, chosen, registry
    from experiments.studies.validation.validation_study import study

    data = args.data or (Path(os.environ[VARIABLE]) if os.environ.get(VARIABLE) else None)
    entries = chosen(args.names, registry())
    if data is None and not args.fetch:
        raise InputError(
            "The recordings are not shipped: --fetch downloads those whose licence allows it, --data FOLDER (or "
            f"{VARIABLE}) names a folder that holds them."
        )
    if data is not None and not data.is_dir():
        raise InputError(f"--data (or {VARIABLE}) needs a folder that exists, got '{data}'.")
    with writable(args.out):
        workers = Workers(args.workers or os.cpu_count() or 1, resume=args.resume)
        results = study(entries, Places(data, fetch=args.fetch), args.out, workers, peers=args.peers)
    origin = provenance({"names": args.names, "peers": args.peers, "formats": args.formats})
    write(validation_report.document(results, origin), options.output_of(args))


OPTIONS: options.Options = {
    **options.output("results/validate", *options.PRINTED),
    "names": ("recordings, by default all that are there", {"nargs": "*", "metavar": "NAME"}),
    "--data": (f"folder of recordings, by default {VARIABLE}", {**options.FILE, "metavar": "FOLDER"}),
    "--fetch": ("download what is missing, into the user's cache", options.FLAG),
    "--peers": (
        "compare with FIGAROH, mujoco.sysid (extra 'peers'), nimblephysics (extra 'nimble') and plain least squares",
        options.FLAG,
    ),
    **options.workers(None, ", by default one for each processor"),
    **options.RESUME,
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.validate", __doc__, run, OPTIONS)
