"""Checks of what users state in Python and in mapping files: standard deviations, names out of a list, fractions."""

from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

from ident.errors import InputError
from ident.tolerances import HUGE

OF_BODIES = ("mass", "center", "inertia")
"""What may be known of a body beforehand."""

LEAST = 1e-12
"""Standard deviation below which something is known exactly."""


def checked_deviations(
    where: str, given: Any, choices: Iterable[str], error: type[InputError] = InputError
) -> dict[str, float]:
    """Standard deviations by what they are of, zero for what is exactly as stated.

    Args:
        where: What a message calls them.
        given: What was stated: numbers, or False for zero.
        choices: Names of what may be known.
        error: Error that is raised.

    Raises:
        InputError: They are no mapping, a name is none of those, or a number is negative, NaN, infinite or none.
    """
    names = tuple(choices)
    if not isinstance(given, Mapping):
        raise error(f"{where} needs standard deviations by name, out of {', '.join(names)}; got {_short(given)}.")
    for name, value in given.items():
        if name not in names:
            raise error(f"{where} has no entry '{_short(name)}'; valid are {', '.join(names)}.")
        if value is not False and not (_is_number(value) and 0 <= value < HUGE):
            raise error(f"{where}.{name} needs a standard deviation, zero or false, got {_short(value)}.")
    return {name: float(value) if value >= LEAST else 0.0 for name, value in given.items()}


def checked_names(where: str, given: Any, choices: Iterable[str]) -> tuple[str, ...]:
    """Names out of a list, each once.

    Args:
        where: What a message calls them.
        given: What was stated.
        choices: Names that there are.

    Raises:
        InputError: It is a single text or no list, or a name is none of those.
    """
    names = tuple(choices)
    wrong = (
        [given] if isinstance(given, str) or not isinstance(given, Iterable) else [x for x in given if x not in names]
    )
    if wrong:
        raise InputError(f"{where} needs a list out of {', '.join(names)}; got {', '.join(map(_short, wrong))}.")
    return tuple(dict.fromkeys(given))


def check_holdout(value: Any) -> None:
    """Refuses a part to hold out that is no number from 0 to less than 1."""
    if not (_is_number(value) and 0 <= value < 1):
        raise InputError(f"holdout needs a fraction of the recording, from 0 to less than 1, got {_short(value)}.")


def _is_number(value: Any) -> bool:
    """True for real numbers, which True and False are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _short(value: Any) -> str:
    """What was given, cut to fit a message."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
