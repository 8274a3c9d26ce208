"""Command-line options: tables of them, and what the commands share."""

import argparse
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import scenes
from experiments.data.paper import FORMATS, REDRAWN, TRAJECTORY_TRIALS
from ident.errors import InputError
from ident.tolerances import DRIVE, HOLDOUT, HUGE

if TYPE_CHECKING:
    from experiments.document.writer import Output
    from experiments.runs.workers import Workers

N = TypeVar("N", int, float)

LOGS = (
    "CSV (also .gz), npz, mat, jsonl, mot, sto, parquet or C3D file, ROS bag, LeRobot dataset with its episode, "
    "DATASET#3, or FILE+FILE: angles in one, forces in another"
)
"""Help on the formats of a log."""

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
    "--base": ("body that is the base; if not given the world, or that of a scene", {}),
    "--base-rpy": (
        "orientation of the base in the world in degrees, as 180 0 0 upside down; by default as in the model",
        {"type": NUMBER, "nargs": 3, "metavar": ("ROLL", "PITCH", "YAW")},
    ),
    "--ignore": ("equality constraints and tendons to leave out", NAMES),
    "--packages": (
        "folders of ROS packages, for meshes of a URDF file at package://; the file's own folder, those above it "
        "and ROS_PACKAGE_PATH are searched as well",
        {**FILES, "metavar": "FOLDER"},
    ),
    **FIX,
}
"""Reading of a user's model; `of_model` returns them."""

SIZE: Options = {
    "--max-size": (
        "memory that a log, or a piece of one that is read in pieces, may take, by default that of a million "
        "samples of sixty channels; a small file can unpack to more than there is",
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
