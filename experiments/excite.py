"""Designs the joint motion that determines a mechanism's base parameters best, within limits and without collisions.

The motion is a finite Fourier series for every joint, which starts and ends at rest. It is judged by the predicted
standard deviations of the base parameters, given the sensors' noise; they are printed before and after. For the double
pendulum the limits are those of the paper's excitation, and the design is compared with it.
"""

import argparse
from dataclasses import fields, replace
from pathlib import Path

import scenes
from experiments.cli import options, running
from experiments.cli.options import NUMBER, POSITIVE
from experiments.data.paper import ACCELERATION, CRITERIA, MARGIN, NOISE, SECONDS, SENSORS, VELOCITY
from ident.errors import InputError

SHARE = options.decimal("a number from 0 to below 0.5", lambda x: 0 <= x < 0.5)
"""Type of the share of a range at each of its ends."""


def run(args: argparse.Namespace) -> None:
    """Designs a motion, and writes and prints it."""
    from experiments.document.result_folder import provenance
    from experiments.document.writer import write
    from experiments.reports import motion_report
    from experiments.studies.designed_excitation import DesignSearch, designed, problem_of

    options.check_model(args.model, scenes.NAMES)
    kinds = {**options.of_model(args), "drive": options.drives(args.drive)}
    kinds |= {key: getattr(args, key) for key in ("joints", "sensors", "noise")}
    if args.floor is not None and args.collisions == "ignore":
        raise InputError("--floor belongs to --collisions avoid; leave one of them out.")
    search = DesignSearch(**{each.name: getattr(args, each.name) for each in fields(DesignSearch)})
    search = replace(search, clearance=None) if args.collisions == "ignore" else search
    design = designed(problem_of(args.model, **kinds), args.model, search)
    source = {"series": design.series, "base_parameters": list(design.problem.parameters.names)}
    document = motion_report.excitation_document(design, args.model, provenance(options.as_text(args), source))
    write(document, options.output_of(args), inputs=[Path(args.model), *filter(None, [args.log, args.columns])])


LIMIT = "for every joint; {:g} or the peak of the paper's if not given"
"""Help on a limit."""

OPTIONS: options.Options = {
    **options.output("results/excite", "svg"),
    "model": (f"an MJCF or URDF file, or a scene: {', '.join(scenes.NAMES)}", {}),
    "--seconds": (f"duration; {SECONDS:g} or the paper's if not given", {"type": POSITIVE}),
    "--joints": ("hinge and slide joints to move; all if not given, the others rest", {"nargs": "+"}),
    **options.MECHANISM,
    "--position": (
        "rad or m; the model's range if not given",
        {"nargs": 2, "type": NUMBER, "metavar": ("LOW", "HIGH")},
    ),
    "--margin": ("share of the model's range that stays free at each stop", {"type": SHARE, "default": MARGIN}),
    **options.drive("none"),
    "--velocity": (f"largest, rad/s or m/s, {LIMIT.format(VELOCITY)}", {"type": POSITIVE}),
    "--acceleration": (f"largest, rad/s² or m/s², {LIMIT.format(ACCELERATION)}", {"type": POSITIVE}),
    "--criterion": (
        "; ".join(f"{key}, {what}" for key, what in CRITERIA.items()),
        {"choices": CRITERIA, "default": "deviations"},
    ),
    "--sensors": ("what is measured: the base wrench or joint torques", {"choices": SENSORS, "default": "wrench"}),
    "--noise": (
        "standard deviations of noise; the model's sensors', else {:g} and {:g}, if not given".format(*NOISE),
        {"nargs": 2, "type": POSITIVE, "metavar": ("N", "NM")},
    ),
    "--harmonics": ("terms of the series", {"type": options.whole_number(2, 100), "default": 5}),
    "--starts": (
        "random motions to begin from, and then half as many near the best",
        {"type": options.whole_number(1, 10_000), "default": 24},
    ),
    "--iterations": ("largest number for each start", {"type": options.whole_number(1, 100_000), "default": 100}),
    "--seed": ("seed of the starts", {"type": options.whole_number(0), "default": 0}),
    "--collisions": ("whether motions avoid them", {"choices": ("avoid", "ignore"), "default": "avoid"}),
    "--clearance": ("distance in m that counts as a collision", {"type": POSITIVE, "default": 0.005}),
    "--floor": (
        "height of a table or a floor in the world's frame, m, which no moving body may touch",
        {"type": NUMBER, "metavar": "Z"},
    ),
    "--log": ("your own recording, to compare the designed motion with", options.FILE),
    "--columns": ("TOML file that says which columns of the log hold what", options.FILE),
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.excite", __doc__, run, OPTIONS)
