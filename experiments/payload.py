"""Mass, centre and inertia of what your robot carries beyond a wrist sensor, or of a body whose pose you measure."""

import argparse
from pathlib import Path

from experiments.cli import options, own_model, print_options, running
from ident.errors import InputError
from ident.tolerances import HOLDOUT


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints the results."""
    from experiments.document.writer import write
    from experiments.reports import payload_report
    from ident.files.readers import is_log
    from ident.mechanism.mechanism import Mechanism
    from ident.payload.identification import identify_payload
    from ident.payload.mounting import place_of
    from ident.recordings.log import read_log
    from sim.models.mechanism import mechanism

    if is_log(args.model):
        args.model, args.logs = None, [args.model, *args.logs]
    elif not args.logs:
        raise InputError(f"payload needs a model and logs, or logs of a body alone; got '{args.model}', no log.")
    folder = own_model.folder(args)
    robot = mechanism(args.model, **options.of_model(args)) if args.model else Mechanism.lone_body(args.body)
    if args.flange:
        place_of(robot, args.body, args.flange)
    logs = [read_log(log, robot, args.columns, limit=options.size_limit(args)) for log in args.logs]
    fitting = {"offsets": args.offsets, "holdout": args.holdout, "report": own_model.progress}
    payload = identify_payload(robot, logs, body=args.body, sensor=args.sensor, **fitting)
    report = payload_report.PayloadReport(payload, args.flange or args.body)
    document = report.document(args.model, args.logs, own_model.provenance(args, payload.estimate.logs))
    out = print_options.output_of(args, folder)
    write(document, out, stale=payload_report.OUTPUTS, inputs=own_model.inputs(args))


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("payload", __doc__)
    out.set_defaults(out=Path("results"))
    out.add_argument(
        "model",
        type=Path,
        help="MJCF or URDF file of the robot; left out for a body alone, whose pose is [base] of the columns file",
    )
    out.add_argument(
        "logs", type=Path, nargs="*", metavar="log", help=f"joint angles and the sensor's readings: {options.LOGS}"
    )
    out.add_argument("--body", required=True, help="body that has, with all on it, what the sensor carries")
    out.add_argument("--sensor", required=True, help="name of the wrench, as [wrenches.NAME] in the columns file")
    out.add_argument("--flange", help="body or site in whose frame controllers want the payload, by default --body")
    out.add_argument("--name", help="name of the folder under --out, by default made of the files' names")
    options.add_mechanism(out)
    options.add_reading(out)
    out.add_argument(
        "--holdout", type=own_model.fraction, default=HOLDOUT, help="fraction of each log kept to judge by"
    )
    return out


main = running.main(__name__, run, parser)
