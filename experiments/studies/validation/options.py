"""Options that an entry of the registry may have: those that the recording's documentation decides.

A choice that only the outcome could suggest is refused: a cut-off, weights, thresholds, knots, priors' sizes, samples
to leave out, the estimator or its columns.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ident.errors import InputError
from ident.files.table import short
from ident.recordings.columns.entries import toml

ALLOWED = {
    "base": "the body that the ground's wrench is about",
    "columns": "the columns of the log and their units",
    "fix": "joints that the model has and the log has not",
    "gaps": "whether samples may be missing",
    "ignore": "couplings of the model to leave out",
    "leave_out": "channels that the model cannot explain because it moves in a plane",
    "prior": "whether the model's bodies are a prior",
}
"""Options of `identify` that an entry may have, and what decides each."""

OF_COLUMNS = ("time", "rate", "joints", "motors", "wrenches", "base", "file", "segments")
"""Tables of a columns file that an entry may have: not `setup`, `known` and `select`."""

UNCERTAINTIES = ("kp_std", "torque_std")
"""Keys of a joint that an entry's columns file may not have."""


def check_options(where: str, options: Mapping[str, Any]) -> None:
    """Refuses options that a user could not have known beforehand.

    Raises:
        InputError: There is one; the message names it and the valid ones.
    """
    for name in options:
        if name not in ALLOWED:
            raise InputError(
                f"{where}: an entry has options that the recording's documentation decides ({', '.join(ALLOWED)}), "
                f"got '{short(name)}'."
            )
    kinds = {"base": str, "columns": str, "gaps": bool, "prior": bool, "fix": dict, "ignore": list, "leave_out": list}
    for name, value in options.items():
        if not isinstance(value, kinds[name]):
            raise InputError(f"{where}: option '{name}' is of the wrong kind, got {short(value)}.")
    for name in ("ignore", "leave_out"):
        if wrong := [x for x in options.get(name, []) if not isinstance(x, str)]:
            raise InputError(f"{where}: option '{name}' needs a list of names, got {short(wrong[0])}.")
    for joint, at in options.get("fix", {}).items():
        if not isinstance(at, list) or any(isinstance(x, bool) or not isinstance(x, int | float) for x in at):
            raise InputError(f"{where}: option 'fix' needs a list of numbers for '{joint}', got {short(at)}.")


def check_columns(path: Path) -> None:
    """Refuses a columns file with choices that a user could not have known beforehand.

    Raises:
        InputError: It has one, or cannot be read.
    """
    entries = toml(path)
    _check_keys(path, entries, OF_COLUMNS)
    for joint, quantities in entries.get("joints", {}).items():
        if unfit := [key for key in UNCERTAINTIES if key in quantities]:
            raise InputError(f"{path}: joint '{joint}' states {unfit[0]}, which the recording does not decide.")


def _check_keys(path: Path, entries: Mapping[str, Any], choices: Sequence[str]) -> None:
    for key in entries:
        if key not in choices:
            raise InputError(
                f"{path}: an entry's columns say what a recording holds ({', '.join(choices)}), got '{short(key)}'."
            )
