"""Guesses what the columns of your logs hold, from names, numbers and the model, and writes a mapping to correct."""

import argparse
import shlex
from os.path import realpath

from experiments.cli import options, running
from ident.errors import InputError
from ident.tolerances import HUGE

HEADS = ("quantity", "column", "unit", "certainty", "reasons")
"""Heads of the table of what the columns probably hold."""

RATE = options.decimal("a number of samples per second, in Hz", lambda x: 1e-3 <= x < HUGE)
"""Type of a rate, as for `ident.recordings.mapping.Rate`."""


def run(args: argparse.Namespace) -> None:
    """Guesses the columns of the logs, prints them, and writes them as a mapping."""
    from experiments.document import typography
    from experiments.guesses.belief import rows, write_mapping
    from experiments.guesses.guess import believed
    from experiments.guesses.log_contents import TRIAL
    from ident.display.brief import listed
    from ident.estimation.equations import channels_out_of_plane
    from ident.files.readers import files_of
    from ident.files.table import LISTED
    from sim.models.model_mechanism import mechanism

    files = [file for log in args.logs for file in files_of(log)]
    out = args.out or files[0].with_name(files[0].name.partition(".")[0] + ".toml")
    if realpath(out) in map(realpath, (args.model, *files)):
        raise InputError(f"The mapping needs a file of its own, but '{out}' is read; choose another by --out.")
    arm = mechanism(args.model, **options.of_model(args))
    belief = believed(arm, args.logs, base=args.base, limit=options.size_limit(args), rate=args.rate or 0.0)
    write_mapping(out, belief, force=args.force)
    log, found = belief.log, typography.table(HEADS, rows(belief), [False] * len(HEADS))
    lines = [f"Open: {sentence}" for sentence in belief.open] + [f"Note: {sentence}" for sentence in belief.notes]
    lines += [f"Columns that are not used: {listed(belief.unused, LISTED)}."] if belief.unused else []
    lines = [*log.summary(), "", *found, *[""] * bool(lines), *lines]
    print(typography.wrapped("\n".join(lines)))
    carried = next((group for group in belief.groups.values() if group.is_inner and not group.is_doubtful), None)
    command, given, end = "identify", [*map(str, args.logs), "--columns", str(out)], list[str]()
    then = f"Correct {out}; {'then' if belief.complete else 'then, when every joint has a position'}"
    if log.markers and not belief.complete:
        command, given = "angles", [str(next((file for file in files if file.suffix.lower() == TRIAL), files[0]))]
        then = "Angles come from the markers, by a command that also says how to go on"
    elif carried is not None:
        command, end = "payload", ["--body", str(carried.entries["body"].value), "--sensor", carried.name]
    else:
        sideways = channels_out_of_plane(arm) if belief.groups else ()
        end = (["--leave-out", *sideways] if sideways else []) + (["--gaps"] if log.has_gaps else [])
    print(f"\n{then}:\n{shlex.join(['multicontact', command, str(args.model), *given, *_model(args, command), *end])}")


def _model(args: argparse.Namespace, command: str) -> list[str]:
    """Options on the model for the next command."""
    words = ["--base", args.base] if args.base else []
    if command != "angles":
        words += ["--base-rpy", *(f"{angle:g}" for angle in args.base_rpy)] if args.base_rpy else []
        words += ["--ignore", *args.ignore] if args.ignore else []
        words += ["--packages", *map(str, args.packages)] if args.packages else []
    return words + [word for joint in args.fix for word in ("--fix", *joint)]


OPTIONS: options.Options = {
    **options.MODEL,
    **options.logs("all of the same columns"),
    "--out": ("file to write, by default beside the first log, with its name and .toml", options.FILE),
    "--force": ("replace the file if there is one", options.FLAG),
    "--rate": ("samples per second, if the logs have no column of times", {"type": RATE, "metavar": "HZ"}),
    **options.MECHANISM,
    **options.SIZE,
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.columns", __doc__, run, OPTIONS)
