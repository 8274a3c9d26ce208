"""Command-line options: tables of them, and what they say of folders, models and logs."""

import argparse
import hashlib
import json
import re
import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import fields
from math import inf
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import scenes
from experiments.data.paper import FORMATS, REDRAWN, TRAJECTORY_TRIALS
from ident.errors import InputError
from ident.tolerances import DRIVE, HOLDOUT, HUGE

if TYPE_CHECKING:
    from experiments.document.writer import Output
    from experiments.runs.workers import Workers
    from ident.estimation.preparation import Part
    from ident.mechanism.mechanism import Mechanism

N = TypeVar("N", int, float)

LOGS = (
    "CSV (also .gz), npz, mat, jsonl, mot, sto, parquet or C3D file, ROS bag, LeRobot dataset with its episode, "
    "DATASET#3, or FILE+FILE: angles in one, forces in another"
)
"""Help on the formats of a log."""

UNSEEN = ("out", "name", "verbose", "formats", "workers", "rerun", "max_size")
"""Options without effect on numbers."""

NONE = "none"
"""Format of figures that are not drawn."""

PRINTED = "pdf", "png"
"""Formats of the figures of studies: for print, and for the page."""


def _number(kind: Callable[[str], N], needed: str, holds: Callable[[N], bool]) -> Callable[[str], N]:
    """Type of an option: a number of a kind for which a condition holds; `needed` says which, for messages."""

    def number(text: str) -> N:
        with suppress(ValueError):
            if holds(value := kind(text)):
                return value
        raise argparse.ArgumentTypeError(f"needs {needed}, got '{text}'")

    return number


def decimal(needed: str, holds: Callable[[float], bool]) -> Callable[[str], float]:
    """Type of an option: a number for which a condition holds; `needed` says which, for messages."""
    return _number(float, needed, holds)


NUMBER = decimal(f"a number within ±{HUGE:g}", lambda x: abs(x) < HUGE)
POSITIVE = decimal(f"a positive number from {1 / HUGE:g} to below {HUGE:g}", lambda x: 1 / HUGE <= x < HUGE)
"""Types of quantities."""

TILT = decimal("an angle as a number from 0° to below 90°", lambda x: 0 <= x < 90)
AZIMUTH = decimal("a number for an azimuth of at most 360°", lambda x: abs(x) <= 360)
"""Types of the angles of a tilt, as for `scenes.load`."""

FRACTION = decimal("a number from 0.05 to 0.9, or 0", lambda x: x == 0 or 0.05 <= x <= 0.9)
"""Type of the fraction of a recording that is held out."""


def whole_number(minimum: int, maximum: int | None = None, *, also: int | None = None) -> Callable[[str], int]:
    """Type of an option: a whole number in a range, or one value outside it."""
    needed = f"at least {minimum}" if maximum is None else f"{minimum} to {maximum}"
    needed, most = needed if also is None else f"{needed}, or {also}", inf if maximum is None else maximum
    return _number(int, f"a whole number of {needed}", lambda x: x == also or minimum <= x <= most)


def as_text(value: Any) -> Any:
    """An option as JSON, or all of them by name."""
    if isinstance(value, argparse.Namespace):
        return {name: as_text(each) for name, each in vars(value).items()}
    if isinstance(value, list):
        return [as_text(each) for each in value]
    return str(value) if isinstance(value, Path) else value


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Help that shows defaults as they are typed, except None, empty lists and those of flags."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if isinstance(action.default, list) and action.default:
            return f"{action.help} (default: {' '.join(map(str, action.default))})"
        plain = action.default in (None, []) or action.const is not None
        return action.help if plain else super()._get_help_string(action)


class _Distinct(argparse.Action):
    """Stores several values without repetitions, in their order."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option: str | None = None) -> None:
        distinct = list(dict.fromkeys(values))
        if NONE in distinct and len(distinct) > 1:
            parser.error(f"argument {option}: '{NONE}' stands alone, got {' '.join(distinct)}")
        setattr(namespace, self.dest, distinct)


Options = dict[str, Any]
"""Rows of options by their names: help and arguments of `add_argument`; under a title, the rows of a group."""


def add(parser: argparse._ActionsContainer, options: Options) -> None:
    """Adds options to a parser."""
    for names, row in options.items():
        if isinstance(row, dict):
            add(parser.add_argument_group(names), row)
        else:
            parser.add_argument(*names.split(), help=row[0], **row[1])


def parser(module: str, description: str | None, options: Options, epilog: str = "") -> argparse.ArgumentParser:
    """Parser of the command of a module, with a text below its help."""
    made = argparse.ArgumentParser(f"python -m {module}", description=description, epilog=epilog or None)
    made.formatter_class = _Help
    add(made, options)
    return made


def output_of(args: argparse.Namespace, folder: Path | None = None) -> "Output":
    """Folder, another one if given, and formats of figures that the options ask for."""
    from experiments.document.writer import Output

    return Output(folder or args.out, [each for each in getattr(args, "formats", ()) if each != NONE])


def workers_of(args: argparse.Namespace) -> "Workers":
    """Workers that `WORKERS` and `RESUME` ask for."""
    from experiments.runs.workers import Workers

    return Workers(args.workers, args.resume)


def check_model(given: str, names: Collection[str]) -> None:
    """Refuses what is neither a file nor a name of a model of this package."""
    if given not in names and not Path(given).is_file():
        choices = f"one of {', '.join(names)}, or an MJCF, URDF or OpenSim file that exists"
        raise InputError(f"A model is {choices}, got '{given}'.")


def of_model(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `sim.mechanism` by the options `MECHANISM`."""
    if missing := [str(folder) for folder in args.packages if not folder.is_dir()]:
        raise InputError(f"--packages needs folders that exist, got {', '.join(missing)}.")
    same = {"base": args.base, "ignore": tuple(args.ignore), "packages": args.packages}
    return same | {"fix": fixed(args.fix), "base_rpy_deg": args.base_rpy}


def fixed(given: Sequence[Sequence[str]]) -> dict[str, list[float]]:
    """Coordinates of fixed joints by joint name, as for `tree_from_model`."""
    coordinates = {}
    for joint, *values in given:
        try:
            coordinates[joint] = [float(value) for value in values]
        except ValueError:
            raise InputError(f"--fix takes a joint and where it stands, got {' '.join((joint, *values))}.") from None
    return coordinates


def drives(given: Sequence[str]) -> tuple[str, ...] | None:
    """Kinds of drives to fit, as for `ident.identify`; None for the default."""
    if len(given) > 1 and (alone := {"auto", "none"}.intersection(given)):
        raise InputError(f"--drive takes {alone.pop()} alone, or a list out of {', '.join(DRIVE)}.")
    return None if list(given) == ["auto"] else tuple(kind for kind in given if kind != "none")


def size_limit(args: argparse.Namespace) -> int:
    """Largest size of a log in memory, bytes."""
    from ident.files.limits import LIMIT

    return LIMIT if args.max_size is None else 1_000_000 * args.max_size


def folder(args: argparse.Namespace) -> Path:
    """Folder of the results; one with an input or, unless it is named, results of other files is refused."""
    name = args.name or _default_name(args)
    if not name.isprintable() or Path(name).name != name or name in (".", ".."):
        raise InputError(f"--name is the name of one folder under --out, got {name!r}.")
    out: Path = args.out / name
    for given in inputs(args):
        if Path(realpath(given)).parent == Path(realpath(out)):
            raise InputError(f"The results need a folder without inputs, but '{out}' holds '{given}'; choose another.")
    check_different(args)
    if not args.name and (other := _other_file(args, out)):
        raise InputError(
            f"'{out}' holds results of other files than '{other}': --name NAME writes into another folder, "
            f"--name {name} replaces them."
        )
    return out


def _default_name(args: argparse.Namespace) -> str:
    """Name of a folder, of the model or body, the logs and an estimator that is not the default."""
    logs = [log_name(log) for log in args.logs]
    # Of many logs the first and the number of others, since names of folders have a limit.
    several = "+".join(logs) if len(logs) < 4 else f"{logs[0]}+{len(logs) - 1}"
    estimator = getattr(args, "estimator", "trajectory")
    return f"{args.model.stem if args.model else args.body}-{several}" + f"-{estimator}" * (estimator != "trajectory")


def _other_file(args: argparse.Namespace, out: Path) -> Path | None:
    """A model or log that the results in a folder are not of, neither by its path nor by its contents."""
    (earlier, sums), files = _earlier(out), [*filter(None, [args.model]), *args.logs]
    for file in (file for file in files if earlier and json.dumps(str(file)) not in json.dumps(earlier)):
        with suppress(OSError):  # A missing file has its own sentence.
            if not sums.issuperset(_sums(json.dumps(file_entry(file)))):
                return file
    return None


def of_replaced(args: argparse.Namespace, out: Path) -> str:
    """Sentence on results of other options that the folder holds so far; empty if there are none."""
    earlier, _ = _earlier(out)
    given = {key: value for key, value in as_text(args).items() if key not in (*UNSEEN, "model", "logs")}
    others = [f"--{key.replace('_', '-')}" for key, value in given.items() if earlier.get(key, value) != value]
    listed = ", ".join(others)
    return f"These results replaced those of other options ({listed}); --name NAME keeps both." if others else ""


def _earlier(out: Path) -> tuple[dict[str, Any], set[str]]:
    """Options of the results in a folder, and the SHA-256 sums of their files; nothing without any."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        text = (out / "provenance.json").read_text(encoding="utf-8")
        return dict(json.loads(text)["options"]), _sums(text)
    return {}, set()


def _sums(text: str) -> set[str]:
    return set(re.findall(r'"sha256": "(\w+)"', text))


def log_name(log: Path) -> str:
    """Name of a log in the names of folders, that of its first file."""
    # In the address of a page, a name would end at the mark of a dataset's episode.
    return _files(log)[0].stem.replace("#", "-")


def check_different(args: argparse.Namespace) -> None:
    """Refuses a log that is given twice, or to be fitted and to judge by."""
    fitted, judges = ([_resolved(log) for log in several] for several in _logs(args))
    if any(log in fitted for log in judges):
        raise InputError("The log to judge by (--held-out) has to be another one than the log that is fitted.")
    if twice := [log for log, own in zip(_logs(args)[0], fitted, strict=True) if fitted.count(own) > 1]:
        raise InputError(f"A log can be fitted once only, but '{twice[-1]}' is given twice.")


def inputs(args: argparse.Namespace) -> list[Path]:
    """All input files."""
    logs = [file for several in _logs(args) for log in several for file in _files(log)]
    return [*filter(None, [args.model]), *logs, *filter(None, [args.columns])]


def _logs(args: argparse.Namespace) -> tuple[list[Path], list[Path]]:
    """Logs that are fitted, and logs to judge by."""
    return [*args.logs, *getattr(args, "loaded", ())], getattr(args, "held_out", [])


def _files(log: Path) -> tuple[Path, ...]:
    from ident.files.readers import files_of

    return files_of(log)


def _resolved(log: Path) -> list[str]:
    """Places of a log's files in sorted order, so that logs can be compared."""
    return sorted(realpath(file) for file in _files(log))


def progress(round_: int, step: float) -> None:
    """Prints the progress of the estimate, if stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\rround {round_ + 1}: parameters move by {step:.2g} of their deviations ", end="", file=sys.stderr)


def provenance(args: argparse.Namespace, logs: Sequence["Part[slice]"]) -> dict[str, Any]:
    """Options, versions and commit, and the input files with their SHA-256 sums, so that a log can be recognized.

    Args:
        args: The options.
        logs: The fitted parts of the logs.
    """
    from experiments.document.result_folder import provenance as origin

    fitted = [
        file_entry(path)
        | {"samples": len(log.samples), "rate_hz": log.recording.rate, "fitted": [part.start, part.stop]}
        for path, (log, part) in zip(args.logs, logs, strict=True)
    ]
    judges = [file_entry(path) for path in _logs(args)[1]]
    files = {"model": args.model and file_entry(args.model), "logs": fitted, "held_out": judges}
    given = {key: value for key, value in as_text(args).items() if key != "workers"}
    return origin(given, files | ({"columns": file_entry(args.columns)} if args.columns else {}))


def file_entry(path: Path) -> dict[str, Any]:
    """Name and SHA-256 sum of a file, or of each file of a log in several files or in a folder."""
    from ident.files.readers import files_in

    files = [each for file in _files(path) for each in files_in(file)]
    sums = [{"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()} for file in files]
    return {"files": sums} if path.is_dir() or len(sums) > 1 else sums[0]


def model_sum(mechanism: "Mechanism") -> str:
    """SHA-256 sum of what was read of a model, from whichever files; not of what is only shown, such as meshes."""
    import numpy as np

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        return {each.name: getattr(value, each.name) for each in fields(value) if each.name != "source"}

    return hashlib.sha256(json.dumps(mechanism, default=plain).encode()).hexdigest()


FLAG, FILE, FILES = {"action": "store_true"}, {"type": Path}, {"type": Path, "nargs": "+", "default": []}
NAMES = {"nargs": "*", "default": []}
"""Arguments of options that are true or false, files, and names."""

MODEL: Options = {"model": ("MJCF, URDF or OpenSim file", FILE)}


def logs(text: str, **more: Any) -> Options:
    """The user's recordings."""
    return {"logs": (f"{LOGS}; {text}", {"type": Path, "nargs": "+", "metavar": "log", **more})}


def output(folder: str, *formats: str) -> Options:
    """Folder of the results, none by default if it is empty, and formats of figures if there are any.

    By default these are the one that the page shows, for studies also the one for print.
    """
    text = "formats of the figures, each drawn once, or none; pages show png or svg"
    choices = {"nargs": "+", "choices": (*FORMATS, NONE), "default": [*formats], "action": _Distinct}
    out: Options = {"--out": ("folder for the results", {**FILE, "default": Path(folder) if folder else None})}
    return {**out, "--formats": (text, choices)} if formats else out


FIX: Options = {
    "--fix": (
        "a joint that does not move and need not be recorded, as of a finger, and where it stands in rad or m, by "
        "default as the model draws it; once for each",
        {"nargs": "+", "action": "append", "default": [], "metavar": ("JOINT", "VALUE")},
    )
}
"""Joints that do not move; `fixed` returns them."""

MECHANISM: Options = {
    "--base": ("body that is the base, in whose frame its wrench is; by default the world, or that of a scene", {}),
    "--base-rpy": (
        "orientation of the base in the world in degrees, as 180 0 0 upside down; by default as in the model",
        {"type": NUMBER, "nargs": 3, "metavar": ("ROLL", "PITCH", "YAW")},
    ),
    "--ignore": ("equality constraints and tendons to leave out", NAMES),
    "--packages": (
        "folders of ROS packages, for meshes of a URDF file at package://; the file's own folder, those above it, "
        "ROS_PACKAGE_PATH and AMENT_PREFIX_PATH are searched as well",
        {**FILES, "metavar": "FOLDER"},
    ),
    **FIX,
}
"""Reading of a user's model; `of_model` returns them."""

SIZE: Options = {
    "--max-size": (
        "memory that a log may take, by default 500; a small file can unpack to more than there is",
        {"type": whole_number(1, 1_000_000), "metavar": "MB"},
    )
}
"""The memory limit of a log; `size_limit` returns it in bytes."""

READING: Options = {
    "--columns": (
        "TOML file that says which columns hold what, and in which unit, or OpenSim's ExternalLoads (.xml)",
        FILE,
    ),
    "--offsets": ("fit constant offsets", {"action": argparse.BooleanOptionalAction, "default": True}),
    **SIZE,
}
"""Reading of a user's recordings, and the choice to fit offsets."""

HELD_BACK = {"type": FRACTION, "default": HOLDOUT}
"""Fraction of a recording to judge by."""


def drive(default: str) -> Options:
    """Choice of drives; `drives` returns it."""
    text = (
        "drives to determine from joint torques; auto: rotor inertia, viscous and Coulomb friction of all joints, "
        "the model's springs, and Stribeck friction where recordings ask for it"
    )
    return {"--drive": (text, {"nargs": "*", "choices": ("auto", "none", *DRIVE), "default": [default]})}


def workers(default: int | None, otherwise: str = "") -> Options:
    """Number of local processes; `otherwise` explains a default of None."""
    text = f"local processes that share the work{otherwise}"
    return {"--workers": (text, {"type": whole_number(1, 1024), "default": default})}


RESUME: Options = {"--resume": ("go on from what an interrupted run has done", FLAG)}
WORKERS: Options = {**workers(1), **RESUME}
"""Options of runs that several workers share."""

TRIALS: Options = {
    "Monte Carlo": {
        "--trials": ("trials with noise drawn anew", {"type": whole_number(2, 1_000_000, also=0), "default": 0}),
        "--trajectory-trials --joint-trials": (
            "how many of the trials, at most, the trajectory estimate is made of too; it takes a second for each",
            {"type": whole_number(2, also=0), "default": TRAJECTORY_TRIALS},
        ),
        "--redraw": (
            "noise to draw anew: " + "; ".join(f"{key}, {what}" for key, what in REDRAWN.items()),
            {"choices": REDRAWN, "default": "all"},
        ),
        **WORKERS,
    }
}
"""Options of Monte Carlo runs."""


def study(folder: str) -> Options:
    """Options of every simulated study."""
    return {**output(folder, *PRINTED), **STUDY}


STUDY: Options = {
    "--seed": ("seed of all noise; by default the study file's", {"type": whole_number(0)}),
    "--samples": ("samples recorded at 100 Hz; by default the study file's", {"type": whole_number(1)}),
    "--noise-scale": (
        "factor on the scene's and the excitation's noise; by default the study file's",
        {"type": NUMBER},
    ),
    **TRIALS,
}
"""Those beside its output."""

TILTED: Options = {
    "--tilt-deg": ("angle of all joint axes from where they are drawn", {"type": TILT}),
    "--azimuth-deg": ("direction of the tilt, from +Y to +Z", {"type": AZIMUTH}),
}
"""Tilt of the joint axes."""

CONTACT: Options = {
    "--contact": (
        "what touches the second link; of both at the same time the pad does, and the handle holds the first",
        {"nargs": "+", "choices": scenes.CONTACTS},
    )
}
"""Contacts of the mechanism."""
