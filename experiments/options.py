"""Command-line options that the studies share, and how they end."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from experiments.figures import FORMATS
from experiments.monte_carlo import REDRAWN
from sim.simulate import SAMPLES


def output_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """Parser with the options of everything that writes results.

    Args:
        name: Name of the study, `python -m experiments.NAME`.
        description: What it does, for `--help`.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m experiments.{name}".rstrip("."),
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--out", type=Path, default=Path("results") / name, help="folder for the results")
    parser.add_argument("--formats", nargs="+", choices=FORMATS, default=["pdf", "png"], help="formats of the figures")
    return parser


def study_parser(name: str, description: str | None) -> argparse.ArgumentParser:
    """Parser with the options of every simulated study; arguments as for `output_parser`."""
    parser = output_parser(name, description)
    parser.add_argument("--seed", type=_at_least(0), default=0, help="seed of all noise")
    parser.add_argument("--samples", type=_at_least(1), default=SAMPLES, help="samples recorded at 100 Hz")
    parser.add_argument(
        "--noise-scale", type=float, default=1.0, help="factor on the scene's and the excitation's noise"
    )
    several = add_trials(parser)
    several.add_argument(
        "--redraw",
        choices=REDRAWN,
        default="all",
        help="noise to draw anew: " + "; ".join(f"{key}, {what}" for key, what in REDRAWN.items()),
    )
    several.add_argument("--resume", action="store_true", help="go on from the trials of an interrupted run")
    return parser


def add_trials(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Adds the options that every Monte Carlo run has, and returns their group."""
    several = parser.add_argument_group("Monte Carlo")
    several.add_argument("--trials", type=_at_least(0), default=0, help="trials with noise drawn anew")
    several.add_argument("--workers", type=_at_least(1), default=1, help="processes for the trials")
    return several


def run(
    study: Callable[[argparse.Namespace], None], parser: argparse.ArgumentParser, argv: Sequence[str] | None
) -> int:
    """Runs a study and turns bad input into one sentence.

    Args:
        study: The study, given the parsed options.
        parser: Its parser.
        argv: Arguments, by default the command line's.

    Returns:
        Exit code: 0, 2 for bad input, or 130 when interrupted.
    """
    options = parser.parse_args(argv)
    try:
        study(options)
    except (ValueError, OSError) as error:
        print(f"{parser.prog}: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{parser.prog}: interrupted; earlier results are as they were.", file=sys.stderr)
        return 130
    return 0


def _at_least(minimum: int) -> Callable[[str], int]:
    def number(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = minimum - 1
        if value < minimum:
            raise argparse.ArgumentTypeError(f"needs a whole number of at least {minimum}, got '{text}'")
        return value

    return number
