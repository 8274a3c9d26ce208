"""Fits joint angles to the positions of markers, with their noise, and the lengths of segments."""

import argparse
import shlex
from typing import TYPE_CHECKING

from experiments.cli import options, running
from ident.errors import InputError

if TYPE_CHECKING:
    from experiments.studies.user_files import Angles


def run(args: argparse.Namespace) -> None:
    """Fits a trial, and writes and prints the results."""
    from experiments.document.result_folder import provenance
    from experiments.document.writer import write
    from experiments.reports import motion_report
    from experiments.studies.user_files import Scale, angles

    for option in ("symmetric", "scale_from", "mass"):
        if getattr(args, option) and not args.scale:
            raise InputError(f"--{option.replace('_', '-')} is about lengths that --scale finds; give --scale as well.")
    scale = Scale(args.scale_from, args.symmetric, args.mass) if args.scale else None
    given = {"places": args.places, "base": args.base, "wrenches": args.wrenches}
    given |= {"fix": options.fixed(args.fix), "scale": scale}
    result = angles(args.model, args.markers, **given)
    document = motion_report.angles_document(result, args.model, args.markers, provenance(options.as_text(args)))
    inputs = [*filter(None, (args.model, args.markers, args.places, args.scale_from, args.wrenches))]
    out = options.output_of(args)
    then = _next(args, result)
    write(document, out, stale=motion_report.ANGLES, inputs=inputs, then=then)


def _next(args: argparse.Namespace, result: "Angles") -> str:
    """The command to run next, and what it needs."""
    from ident.estimation.equations import channels_out_of_plane
    from ident.recordings.wrench import GROUND
    from sim.models.model_mechanism import mechanism

    first = "Then" if args.wrenches else "With forces of plates on the same clock, then"
    if placed := not {*result.recording.wrenches} <= {GROUND}:
        first = "With a file that says on which bodies the wrenches act, then"
    log = f"{args.out / 'angles.csv'}" + ("" if args.wrenches else "+PLATES.mot")
    words = ["multicontact", "identify", str(args.model), log, *(["--base", result.base] if result.base else [])]
    words += ["--columns", "COLUMNS.toml"] if placed else []
    words += [word for fixed in args.fix for word in ("--fix", *fixed)]
    words += [word for name in result.postures.undetermined for word in ("--fix", name)]
    sideways = () if result.base else channels_out_of_plane(mechanism(args.model, fix=options.fixed(args.fix)))
    command = shlex.join([*words, *(["--leave-out", *sideways] if sideways else [])])
    return f"{first}:\n{command}"


OPTIONS: options.Options = {
    **options.output("results/angles", "svg"),
    "model": ("MJCF, URDF or OpenSim file with sites or markers named like the labels, or see --places", options.FILE),
    "markers": (".trc or .c3d file, or a table with columns time, LABEL.x, .y and .z", options.FILE),
    "--places": (
        "file that says which sites, or places on bodies, markers stand for; their weights, unit and upward axis, "
        "and which bodies scale alike",
        {**options.FILE, "metavar": "TOML"},
    ),
    "--base": ("body that is the base, by default the one with the model's only free joint, or the world", {}),
    **options.FIX,
    "--wrenches": (
        "CSV or npz file with wrenches on the same clock, columns time, NAME_force.x to NAME_torque.z, to go into "
        "the same file as the angles",
        {**options.FILE, "metavar": "LOG"},
    ),
    "lengths of segments": {
        "--scale": ("find a factor on the lengths of each body, and write the model with them", options.FLAG),
        "--symmetric": ("the left side is as long as the right one", options.FLAG),
        "--scale-from": (
            "another trial to find them from, as one that stands still in several postures",
            {**options.FILE, "metavar": "MARKERS"},
        ),
        "--mass": ("mass of the whole scaled model, by default as it is", {"type": options.POSITIVE, "metavar": "KG"}),
    },
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.angles", __doc__, run, OPTIONS)
