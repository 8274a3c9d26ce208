"""Identifies mass, centre and inertia of what your robot carries: beyond a wrist sensor, or with and without it."""

import argparse
from pathlib import Path

from experiments.cli import options, running
from ident.errors import InputError, about


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints the results."""
    from experiments.document.writer import write
    from experiments.reports import payload_report
    from ident.files.readers import is_log
    from ident.mechanism.mechanism import Mechanism
    from ident.payload import Payload, place_of
    from ident.payload.beyond_sensor import check_wrench, identify_payload
    from ident.payload.load import identify_load
    from ident.recordings.log import read_log
    from sim.models.model_mechanism import mechanism

    if is_log(args.model):
        args.model, args.logs = None, [args.model, *args.logs]
    elif not args.logs:
        raise InputError(f"payload needs a model and logs, or logs of a body alone; got '{args.model}', no log.")
    if bool(args.loaded) is (args.sensor is not None):
        raise InputError("payload needs either --sensor NAME, or --loaded LOG beside logs without the load.")
    if args.loaded and args.model is None:
        raise InputError(f"--loaded needs the model of what carries the load, before logs; got '{args.logs[0]}' first.")
    if args.mass is not None and not args.loaded:
        raise InputError("--mass is the known mass of a load, which --loaded needs.")
    if not args.body and not (args.loaded and args.columns):
        raise InputError('payload needs --body NAME, or [load] with body = "NAME" in the columns file of a load.')
    folder = options.folder(args)
    replaced = options.of_replaced(args, folder)
    robot = mechanism(args.model, **options.of_model(args)) if args.model else Mechanism.lone_body(args.body)
    logs, loaded = (
        [read_log(log, robot, args.columns, limit=options.size_limit(args)) for log in several]
        for several in (args.logs, args.loaded)
    )
    body = args.body or loaded[0].loaded
    if args.flange:
        place_of(robot, body, args.flange)
    fitting = {"body": body, "offsets": args.offsets, "holdout": args.holdout, "report": options.progress}
    payload: Payload
    if loaded:
        payload = identify_load(robot, logs, loaded, mass=args.mass, **fitting)
    else:
        for log, recording in zip(args.logs, logs, strict=True):
            with about(log):
                check_wrench(recording, args.sensor, body)
        payload = identify_payload(robot, logs, sensor=args.sensor, **fitting)
    report = payload_report.PayloadReport(payload, args.flange or body)
    origin = options.provenance(args, payload.estimate.logs)
    document = report.document(args.model, [*args.logs, *args.loaded], origin)
    out = options.output_of(args, folder)
    write(
        document,
        out,
        stale=payload_report.OUTPUTS,
        inputs=options.inputs(args),
        then=replaced,
        verbose=args.verbose,
    )


OPTIONS: options.Options = {
    **options.output("results", "svg"),
    "model": (
        "MJCF or URDF file of the robot; left out for a body alone, whose pose is [base] of the columns file",
        options.FILE,
    ),
    "logs": (f"joint angles and the sensor's readings: {options.LOGS}", {"type": Path, "nargs": "*", "metavar": "log"}),
    "--body": (
        "body that has, with all on it, what the sensor carries, or to which the load is fixed; by default of "
        "[load] in the columns file",
        {},
    ),
    "--sensor": ("name of the wrench, as [wrenches.NAME] in the columns file", {}),
    "--loaded": ("logs with the load, where the others have none", {**options.FILES, "metavar": "LOG"}),
    "--mass": ("mass of that load by a scale, kg; it fixes the scale of the torques", {"type": options.POSITIVE}),
    "--flange": ("body or site in whose frame controllers want the payload, by default --body", {}),
    "--name": ("name of the folder under --out, by default made of the files' names", {}),
    "--verbose": ("print more than a screen: deviations, sensor and forms", options.FLAG),
    **options.MECHANISM,
    **options.READING,
    "--holdout": ("fraction of each log kept to judge by", options.HELD_BACK),
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.payload", __doc__, run, OPTIONS)
