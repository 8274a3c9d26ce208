"""Base parameters from recordings of any length, read and worked on piece by piece.

Results are those of `identify --estimator ordinary --holdout 0` with the same options: other estimators need all
residuals at once and several passes, and a held-out fraction needs the number of samples before the first is read.
"""

import argparse
from pathlib import Path

from experiments.cli import options, own_model, running

OUTPUTS = (
    "report.html",
    "estimate.json",
    "provenance.json",
    *(f"base_parameters.{end}" for end in ("csv", "md", "tex")),
)
"""All files of results."""


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints the results."""
    from experiments.document.provenance import provenance
    from experiments.document.result_folder import check_inputs, writable
    from experiments.document.writer import write
    from experiments.reports import stream_report
    from experiments.studies import stream, stream_progress

    inputs, out = _inputs(args), options.output_of(args)
    own = {key: getattr(args, key) for key in ("piece", "contact", "without", "offsets")}
    read = {**own, **options.of_model(args), "columns": args.columns, "limit": options.size_limit(args)}
    settings = own | {key: getattr(args, key) for key in ("base", "ignore", "fix", "base_rpy")}
    reading = stream.reading(args.model, args.recordings, **read)
    settings["model_as_read"] = own_model.model_sum(reading.equations.mechanism)
    identity = stream.identity(args.model, args.columns, args.recordings, settings)
    check_inputs((args.out / name for name in (stream_progress.FILE, *OUTPUTS)), inputs)
    with writable(args.out):
        progress = stream_progress.Progress(args.out / stream_progress.FILE, identity)
        if args.resume:
            progress = progress.resumed(reading.equations)
        with options.workers_of(args).pool(args.workers) as pool:
            result = stream.streamed(progress, reading, pool, args.held_out)
    held = args.held_out and str(args.held_out)
    origin = provenance({**identity, "held_out": held, **out.choices})
    write(stream_report.document(result, args.model, args.recordings, origin), out, stale=(), inputs=inputs)


def _inputs(args: argparse.Namespace) -> list[Path]:
    """All input files."""
    from ident.errors import InputError

    inputs = [args.model, *args.recordings, *filter(None, [args.columns, args.held_out])]
    for file in inputs:
        if not file.is_file():
            raise InputError(f"There is no file '{file}'.")
    if args.held_out is not None and args.held_out.resolve() in [file.resolve() for file in args.recordings]:
        raise InputError("The log to judge by (--held-out) has to be another one than those that are fitted.")
    return inputs


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.command_parser("stream", __doc__)
    options.add_page(out)
    out.add_argument("model", type=Path, help="MJCF, URDF or OpenSim file")
    out.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        help="CSV or npz files with the channels JOINT_position, JOINT_velocity, JOINT_acceleration of every joint, "
        "ground_force and ground_torque, or what --columns says",
    )
    options.add_mechanism(out)
    options.add_fit(out)
    out.add_argument("--contact", nargs="*", default=[], help="wrenches at the sites of the same names")
    out.add_argument("--without", nargs="*", default=[], help="wrenches to leave out")
    out.add_argument("--piece", type=options.whole_number(1, 10_000_000), help="samples read at a time")
    options.add_workers(out.add_argument_group("workers"))
    return out


main = running.main(__name__, run, parser)
