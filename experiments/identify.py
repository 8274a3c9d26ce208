"""Base parameters of your own mechanism from your own recording, and whether to believe them."""

import argparse
from pathlib import Path

from experiments.cli import options
from ident.errors import InputError
from ident.tolerances import DRIVE, HOLDOUT


def run(args: argparse.Namespace) -> None:
    """Identifies and writes and prints what was found."""
    from experiments.output import identify_report, report
    from experiments.studies.identification import prepare
    from ident.identification import identified

    out = _folder(args)
    known = {"base": args.base, "columns": args.columns, "cutoff": args.cutoff}
    known |= {"drive": tuple(args.drive), "ignore": tuple(args.ignore), "fix": options.fixed(args.fix)}
    known |= {"limit": options.size_limit(args)}
    prepared = prepare(args.model, args.log, **known)
    other = None if args.held_out is None else prepare(args.model, args.held_out, **known)
    result = identified(
        prepared,
        offsets=args.offsets,
        weighted=not args.ordinary,
        holdout=args.holdout,
        other=other,
        axes=args.axes,
    )
    given = {key: str(value) if isinstance(value, Path) else value for key, value in vars(args).items()}
    with report.results_folder(out, stale=identify_report.OUTPUTS, inputs=_inputs(args)) as folder:
        identify_report.write(result, folder, args.model, args.log, report.provenance(given))
    print(identify_report.text(result))
    print(f"Everything is in {out}; open report.html.")


def _folder(args: argparse.Namespace) -> Path:
    """Folder of the results; one that holds an input is refused, so that no file of the user's is replaced."""
    name = args.name or f"{args.model.stem}-{args.log.stem}"
    if not name.isprintable() or Path(name).name != name or name in (".", ".."):
        raise InputError(f"--name is the name of one folder under --out, got {name!r}.")
    out = args.out / name
    for given in _inputs(args):
        if given.resolve().parent == out.resolve():
            raise InputError(f"The results need a folder without inputs, but '{out}' holds '{given}'; choose another.")
    if args.held_out is not None and args.held_out.resolve() == args.log.resolve():
        raise InputError("The log to judge by (--held-out) has to be another one than the log that is fitted.")
    return out


def _inputs(args: argparse.Namespace) -> list[Path]:
    return [given for given in (args.model, args.log, args.held_out, args.columns) if given is not None]


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.command_parser("identify", __doc__)
    out.set_defaults(out=Path("results"))
    out.add_argument("model", type=Path, help="MJCF or URDF file")
    out.add_argument("log", type=Path, help="CSV or npz file")
    out.add_argument("--name", help="name of the folder under --out, by default made of the files' names")
    options.add_mechanism(out)
    options.add_fit(out)
    out.add_argument(
        "--cutoff", help="cut-off of the low-pass in Hz, or 'auto'; by default the log's own derivatives if it has any"
    )
    out.add_argument(
        "--holdout", type=_fraction, default=HOLDOUT, help="fraction of the recording kept to judge by; 0 judges by all"
    )
    out.add_argument("--axes", action=argparse.BooleanOptionalAction, default=True, help="look for axes that are off")
    out.add_argument("--ordinary", action="store_true", help="ordinary least squares: no weights, outliers count fully")
    out.add_argument("--drive", nargs="*", choices=DRIVE, default=[], help="columns for joint torques")
    return out


def _fraction(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if value != 0 and not 0.05 <= value <= 0.9:
        raise argparse.ArgumentTypeError(f"needs a number from 0.05 to 0.9, or 0, got '{text}'")
    return value


main = options.main(__name__, run, parser)
