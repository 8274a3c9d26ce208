"""Designs the joint motion that determines a mechanism's base parameters best, within limits and without collisions.

The motion is a finite Fourier series for every joint, which starts and ends at rest. It is judged by the predicted
standard deviations of the base parameters, given the sensors' noise; they are printed before and after. For the double
pendulum the limits are those of the paper's excitation, and the design is compared with it.
"""

import argparse
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
    from experiments.document.provenance import provenance
    from experiments.document.writer import write
    from experiments.reports import excite_report
    from experiments.studies.designed_excitation import Bounds, designed, problem_of

    options.check_model(args.model, scenes.NAMES)
    kinds = {**options.of_model(args), "drive": options.drives(args.drive)}
    kinds |= {key: getattr(args, key) for key in ("joints", "sensors", "noise")}
    search = {key: getattr(args, key) for key in ("seconds", "harmonics", "criterion", "starts", "iterations", "seed")}
    search |= {key: getattr(args, key) for key in ("floor", "log", "columns")}
    search |= {"bounds": Bounds(args.position, args.margin, args.velocity, args.acceleration)}
    search |= {"clearance": None if args.collisions == "ignore" else args.clearance}
    if args.floor is not None and args.collisions == "ignore":
        raise InputError("--floor belongs to --collisions avoid; leave one of them out.")
    design = designed(problem_of(args.model, **kinds), args.model, **search)
    source = {"series": design.series, "base_parameters": list(design.problem.parameters.names)}
    document = excite_report.document(design, args.model, provenance(options.as_text(args), source))
    write(document, options.output_of(args), inputs=[Path(args.model), *filter(None, [args.log, args.columns])])


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("excite", __doc__)
    out.add_argument("model", help=f"an MJCF or URDF file, or a scene: {', '.join(scenes.NAMES)}")
    out.add_argument("--seconds", type=POSITIVE, help=f"duration; {SECONDS:g} or the paper's if not given")
    out.add_argument("--joints", nargs="+", help="hinge and slide joints to move; all if not given, the others rest")
    options.add_mechanism(out)
    out.add_argument(
        "--position", nargs=2, type=NUMBER, metavar=("LOW", "HIGH"), help="rad or m; the model's range if not given"
    )
    free = "share of the model's range that stays free at each stop"
    out.add_argument("--margin", type=SHARE, default=MARGIN, help=free)
    options.add_drive(out, default="none")
    limits = "for every joint; {:g} or the peak of the paper's if not given"
    out.add_argument("--velocity", type=POSITIVE, help=f"largest, rad/s or m/s, {limits.format(VELOCITY)}")
    out.add_argument("--acceleration", type=POSITIVE, help=f"largest, rad/s² or m/s², {limits.format(ACCELERATION)}")
    out.add_argument(
        "--criterion",
        choices=CRITERIA,
        default="deviations",
        help="; ".join(f"{key}, {what}" for key, what in CRITERIA.items()),
    )
    out.add_argument("--sensors", choices=SENSORS, default="wrench", help="what the regressor explains")
    out.add_argument(
        "--noise",
        nargs=2,
        type=POSITIVE,
        metavar=("N", "NM"),
        help="standard deviations of noise; the model's sensors', else {:g} and {:g}, if not given".format(*NOISE),
    )
    out.add_argument("--harmonics", type=options.whole_number(2, 100), default=5, help="terms of the series")
    begin = "random motions to begin from, and then half as many near the best"
    out.add_argument("--starts", type=options.whole_number(1, 10_000), default=24, help=begin)
    out.add_argument("--iterations", type=options.whole_number(1, 100_000), default=100, help="at most, each start")
    out.add_argument("--seed", type=options.whole_number(0), default=0, help="seed of the starts")
    out.add_argument("--collisions", choices=("avoid", "ignore"), default="avoid", help="what to do about them")
    out.add_argument("--clearance", type=POSITIVE, default=0.005, help="distance in m that counts as a collision")
    floor = "height of a table or a floor in the world's frame, m, which no moving body may touch"
    out.add_argument("--floor", type=NUMBER, metavar="Z", help=floor)
    out.add_argument("--log", type=Path, help="your own recording, to compare the designed motion with")
    out.add_argument("--columns", type=Path, help="TOML file that says which columns of the log hold what")
    return out


main = running.main(__name__, run, parser)
