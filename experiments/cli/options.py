"""Command-line options that the commands share."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import scenes
from experiments.data.paper import FORMATS, REDRAWN, TRAJECTORY_TRIALS
from ident.errors import InputError
from ident.tolerances import DRIVE, HUGE

if TYPE_CHECKING:
    from experiments.document.writer import Output
    from experiments.runs.workers import Workers

LOGS = (
    "CSV (also .gz), npz, mat, jsonl, mot, sto, parquet or C3D file, ROS bag, LeRobot dataset with its episode, "
    "DATASET#3, or FILE+FILE: angles in one, forces in another"
)
"""Help on the formats of a log."""

NONE = "none"
"""Format of figures that are not drawn."""

PRINTED = "pdf", "png"
"""Formats of the figures of studies: for print, and for the page."""


def decimal(needed: str, holds: Callable[[float], bool]) -> Callable[[str], float]:
    """Type of an option: a number for which a condition holds; `needed` says which, for messages."""

    def number(text: str) -> float:
        with suppress(ValueError):
            if holds(value := float(text)):
                return value
        raise argparse.ArgumentTypeError(f"needs {needed}, got '{text}'")

    return number


NUMBER = decimal(f"a number within ±{HUGE:g}", lambda x: abs(x) < HUGE)
POSITIVE = decimal(f"a positive number, {1 / HUGE:g} or more", lambda x: 1 / HUGE <= x < HUGE)
"""Types of quantities."""

TILT = decimal("an angle as a number from 0° to below 90°", lambda x: 0 <= x < 90)
AZIMUTH = decimal("a number for an azimuth of at most 360°", lambda x: abs(x) <= 360)
"""Types of the angles of a tilt, as for `scenes.load`."""

FRACTION = decimal("a number from 0.05 to 0.9, or 0", lambda x: x == 0 or 0.05 <= x <= 0.9)
"""Type of the fraction of a recording that is held out."""


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Help that shows defaults, except None and empty lists."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default in (None, []) else super()._get_help_string(action)


class _Distinct(argparse.Action):
    """Stores several values without repetitions, in their order."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        distinct = list(dict.fromkeys(values or ()))
        if NONE in distinct and len(distinct) > 1:
            parser.error(f"argument {option_string}: '{NONE}' stands alone, got {' '.join(distinct)}")
        setattr(namespace, self.dest, distinct)


def plain_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """Parser of any command; arguments as for `command_parser`."""
    prog = f"python -m experiments.{name}".rstrip(".")
    return argparse.ArgumentParser(prog=prog, description=description, formatter_class=_Help)


def command_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """Parser of a command that writes results.

    Args:
        name: Name of the command, `python -m experiments.NAME`.
        description: Description for `--help`.
    """
    parser = plain_parser(name, description)
    parser.add_argument("--out", type=Path, default=Path("results") / name, help="folder for the results")
    return parser


def output_parser(name: str, description: str | None, formats: Sequence[str] = ("svg",)) -> argparse.ArgumentParser:
    """Parser of a command that writes tables and figures; arguments as for `command_parser` and `add_formats`."""
    parser = command_parser(name, description)
    add_formats(parser, formats)
    return parser


def output_of(args: argparse.Namespace, folder: Path | None = None) -> "Output":
    """Folder, another one if given, and formats of figures that the options ask for."""
    from experiments.document.writer import Output

    return Output(folder or args.out, [each for each in getattr(args, "formats", ()) if each != NONE])


def add_formats(parser: argparse.ArgumentParser, default: Sequence[str]) -> None:
    """Adds the formats of figures, by default the one that the page shows, for studies also the one for print."""
    parser.add_argument(
        "--formats",
        nargs="+",
        choices=(*FORMATS, NONE),
        default=[*default],
        action=_Distinct,
        help="formats of the figures, each drawn once, or none; pages show png or svg",
    )


def study_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """Parser with the options of every simulated study; arguments as for `output_parser`."""
    parser = output_parser(name, description, PRINTED)
    otherwise = "; by default the study file's"
    parser.add_argument("--seed", type=whole_number(0), help=f"seed of all noise{otherwise}")
    parser.add_argument("--samples", type=whole_number(1), help=f"samples recorded at 100 Hz{otherwise}")
    parser.add_argument(
        "--noise-scale", type=NUMBER, help=f"factor on the scene's and the excitation's noise{otherwise}"
    )
    add_trials(parser)
    return parser


def add_tilt(parser: argparse.ArgumentParser) -> None:
    """Adds the tilt of the joint axes."""
    parser.add_argument("--tilt-deg", type=TILT, help="angle of all joint axes from where they are drawn")
    parser.add_argument("--azimuth-deg", type=AZIMUTH, help="direction of the tilt, from +Y to +Z")


def add_contact(parser: argparse.ArgumentParser) -> None:
    """Adds the contacts of the mechanism."""
    parser.add_argument(
        "--contact",
        nargs="+",
        choices=scenes.CONTACTS,
        help="what touches the second link; of both at the same time the pad does, and the handle holds the first",
    )


def add_trials(parser: argparse.ArgumentParser) -> None:
    """Adds the options of Monte Carlo runs."""
    several = parser.add_argument_group("Monte Carlo")
    several.add_argument("--trials", type=whole_number(2, also=0), default=0, help="trials with noise drawn anew")
    several.add_argument(
        "--trajectory-trials",
        "--joint-trials",
        type=whole_number(2, also=0),
        default=TRAJECTORY_TRIALS,
        help="how many of the trials, at most, the trajectory estimate is made of too; it takes a second for each",
    )
    several.add_argument(
        "--redraw",
        choices=REDRAWN,
        default="all",
        help="noise to draw anew: " + "; ".join(f"{key}, {what}" for key, what in REDRAWN.items()),
    )
    add_workers(several)


def add_workers(group: argparse._ActionsContainer) -> None:
    """Adds the options of runs that several workers share."""
    add_local_workers(group, default=1)
    add_resume(group)


def add_resume(group: argparse._ActionsContainer) -> None:
    """Adds the choice to go on with an interrupted run."""
    group.add_argument("--resume", action="store_true", help="go on from what an interrupted run has done")


def workers_of(args: argparse.Namespace) -> "Workers":
    """Workers that `add_workers` asks for."""
    from experiments.runs.workers import Workers

    return Workers(args.workers, args.resume)


def add_local_workers(group: argparse._ActionsContainer, *, default: int | None, otherwise: str = "") -> None:
    """Adds the number of local processes; `otherwise` explains a default of None."""
    text = f"local processes that share the work{otherwise}"
    group.add_argument("--workers", type=whole_number(1, 1024), default=default, help=text)


def add_mechanism(parser: argparse._ActionsContainer) -> None:
    """Adds the options of a user's model; `of_model` returns them."""
    parser.add_argument("--base", help="body that is the base; if not given the world, or that of a scene")
    parser.add_argument(
        "--base-rpy",
        type=NUMBER,
        nargs=3,
        metavar=("ROLL", "PITCH", "YAW"),
        help="orientation of the base in the world in degrees, as 180 0 0 upside down; by default as in the model",
    )
    parser.add_argument("--ignore", nargs="*", default=[], help="equality constraints and tendons to leave out")
    parser.add_argument(
        "--packages",
        type=Path,
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="folders of ROS packages, for meshes of a URDF file at package://; the file's own folder, those above it "
        "and ROS_PACKAGE_PATH are searched as well",
    )
    add_fixed(parser)


def check_model(given: str, names: Sequence[str]) -> None:
    """Refuses what is neither a file nor a name of a model of this package."""
    if given not in names and not Path(given).is_file():
        choices = f"one of {', '.join(names)}, or an MJCF, URDF or OpenSim file that exists"
        raise InputError(f"A model is {choices}, got '{given}'.")


def of_model(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `sim.mechanism` by the options of `add_mechanism`."""
    if missing := [str(folder) for folder in args.packages if not folder.is_dir()]:
        raise InputError(f"--packages needs folders that exist, got {', '.join(missing)}.")
    same = {"base": args.base, "ignore": tuple(args.ignore), "packages": args.packages}
    return same | {"fix": fixed(args.fix), "base_rpy_deg": args.base_rpy}


def add_fixed(parser: argparse._ActionsContainer) -> None:
    """Adds the joints that do not move; `fixed` returns them."""
    parser.add_argument(
        "--fix",
        nargs="+",
        action="append",
        default=[],
        metavar=("JOINT", "VALUE"),
        help="a joint that does not move and need not be recorded, as of a finger, and where it stands in rad or m, by "
        "default as the model draws it; once for each",
    )


def fixed(given: Sequence[Sequence[str]]) -> dict[str, list[float]]:
    """Coordinates of fixed joints by joint name, as for `tree_from_model`."""
    coordinates = {}
    for joint, *values in given:
        try:
            coordinates[joint] = [float(value) for value in values]
        except ValueError:
            raise InputError(f"--fix takes a joint and where it stands, got {' '.join((joint, *values))}.") from None
    return coordinates


def add_drive(parser: argparse.ArgumentParser, default: str = "auto") -> None:
    """Adds the choice of drives; `drives` returns it."""
    parser.add_argument(
        "--drive",
        nargs="*",
        choices=("auto", "none", *DRIVE),
        default=[default],
        help="drives to determine from joint torques; auto: rotor inertia, viscous and Coulomb friction of all joints, "
        "the model's springs, and Stribeck friction where recordings ask for it",
    )


def drives(given: Sequence[str]) -> tuple[str, ...] | None:
    """Kinds of drives to fit, as for `ident.identify`; None for the default."""
    if len(given) > 1 and (alone := {"auto", "none"}.intersection(given)):
        raise InputError(f"--drive takes {alone.pop()} alone, or a list out of {', '.join(DRIVE)}.")
    return None if list(given) == ["auto"] else tuple(kind for kind in given if kind != "none")


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Adds how a user's recordings are read, and the choice to fit offsets."""
    parser.add_argument(
        "--columns",
        type=Path,
        help="TOML file that says which columns hold what, and in which unit, or OpenSim's ExternalLoads (.xml)",
    )
    parser.add_argument("--offsets", action=argparse.BooleanOptionalAction, default=True, help="fit constant offsets")
    add_size(parser)


def add_size(parser: argparse.ArgumentParser) -> None:
    """Adds the memory limit of a log; `size_limit` returns it in bytes."""
    parser.add_argument(
        "--max-size",
        type=whole_number(1, 1_000_000),
        metavar="MB",
        help="memory that a log, or a piece of one that is read in pieces, may take, by default that of a million "
        "samples of sixty channels; a small file can unpack to more than there is",
    )


def as_text(value: Any) -> Any:
    """An option as JSON, or all of them by name."""
    if isinstance(value, argparse.Namespace):
        return {name: as_text(each) for name, each in vars(value).items()}
    if isinstance(value, list):
        return [as_text(each) for each in value]
    return str(value) if isinstance(value, Path) else value


def size_limit(args: argparse.Namespace) -> int:
    """Largest size of a log in memory, bytes."""
    from ident.files.limits import LIMIT

    return LIMIT if args.max_size is None else 1_000_000 * args.max_size


def whole_number(minimum: int, maximum: int | None = None, *, also: int | None = None) -> Callable[[str], int]:
    """Type of an option: a whole number in a range, or one value outside it."""
    needed = f"at least {minimum}" if maximum is None else f"{minimum} to {maximum}"
    needed = needed if also is None else f"{needed}, or {also}"

    def number(text: str) -> int:
        with suppress(ValueError):
            value = int(text)
            if value == also or minimum <= value <= (value if maximum is None else maximum):
                return value
        raise argparse.ArgumentTypeError(f"needs a whole number of {needed}, got '{text}'")

    return number
