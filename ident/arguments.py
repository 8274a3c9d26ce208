"""Checks of arguments from Python and mapping files: types, paths, standard deviations, names, fractions."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from numbers import Real
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ident.errors import InputError
from ident.tolerances import HUGE

OF_BODIES = ("mass", "center", "inertia")
"""Properties of a body that may have a prior."""

LEAST = 1e-12
"""Standard deviation below which a value is taken as exact."""


def check_type(where: str, given: Any, kind: Any, needed: str) -> None:
    """Raises an InputError unless an argument is of a type.

    Args:
        where: Name of the argument in messages.
        given: The argument.
        kind: The type, or types joined by `|`.
        needed: What is needed, for the message.
    """
    if not isinstance(given, kind):
        raise InputError(f"{where} needs {needed}; got {described(given)}.")


def checked_path(where: str, given: Any, needed: str = "a path") -> Path:
    """A path; the name of the argument and what is needed are for messages.

    Raises:
        InputError: It is neither a text nor a path.
    """
    check_type(where, given, str | PathLike, needed)
    return Path(given)


def checked_target(path: str | PathLike[str], needed: str = "a path") -> Path:
    """Path of a file to write.

    Raises:
        InputError: It is neither a text nor a path, or a folder.
    """
    target = checked_path("path", path, needed)
    if target.is_dir():
        raise InputError(f"path needs the path of a file to write; '{target}' is a folder.")
    return target


def described(value: Any) -> str:
    """A value for messages: itself if it is plain, else its type."""
    if shape := getattr(value, "shape", ()):
        return f"an array {tuple(shape)} of {getattr(value, 'dtype', 'no numbers')}"
    if not isinstance(value, str | PathLike | Real | list | tuple | dict | None):
        return f"an object of type {type(value).__name__}"
    return " ".join(short(str(value) if isinstance(value, Real) else repr(value)).split())


def near(name: Any, choices: Iterable[str], others: int = 8) -> str:
    """End of a message: up to three choices that a name is close to, in upper or lower case, or else the first few."""
    names = list(choices)
    folded = [each.casefold() for each in names]
    close = get_close_matches(str(name).casefold(), folded, 3)
    if close:
        return f"near that are {', '.join(names[folded.index(each)] for each in dict.fromkeys(close))}."
    return f"there are {', '.join(names[:others])}{' and others' * (len(names) > others)}."


def checked_deviations(
    where: str,
    given: Any,
    choices: Iterable[str],
    error: type[InputError] = InputError,
    most: Mapping[str, float] = MappingProxyType({}),
) -> dict[str, float]:
    """Standard deviations by name, zero for exact values.

    Args:
        where: Name of the argument in messages.
        given: Mapping of names to numbers, or to False for zero.
        choices: Valid names.
        error: Type of the error to raise.
        most: Largest standard deviations by name, of those that have one; also of single joints, as `centre(elbow)`.

    Raises:
        InputError: It is no mapping, a name is not valid, or a value is negative, too large, NaN or no number.
    """
    names = tuple(choices)
    if not isinstance(given, Mapping):
        raise error(f"{where} needs standard deviations by name, out of {', '.join(names)}; got {short(given)}.")
    for name, value in given.items():
        if name not in names:
            raise error(f"{where} has no entry '{short(name)}'; valid are {', '.join(names)}.")
        largest = most.get(name.partition("(")[0], HUGE)
        if value is not False and not (is_number(value) and 0 <= value <= largest):
            limit = f"; the largest is {largest:g}" if is_number(value) and value > largest else ""
            raise error(f"{where}.{name} needs a standard deviation, zero or false, got {described(value)}{limit}.")
    return {name: float(value) if value >= LEAST else 0.0 for name, value in given.items()}


def by_joint(given: Any, kind: str) -> Any:
    """Standard deviations in which one kind's table of joints are names.

    >>> by_joint({"zero": 0, "centre": {"elbow": 0.01}}, "centre")
    {'zero': 0, 'centre(elbow)': 0.01}
    """
    own = given.get(kind) if isinstance(given, Mapping) else None
    if not isinstance(own, Mapping):
        return given
    return {name: x for name, x in given.items() if name != kind} | {f"{kind}({name})": x for name, x in own.items()}


def checked_names(where: str, given: Any, choices: Iterable[str]) -> tuple[str, ...]:
    """Names out of a list, each once.

    Args:
        where: Name of the argument in messages.
        given: List of names.
        choices: Valid names.

    Raises:
        InputError: It is a single string or no list, or a name is not valid.
    """
    names = tuple(choices)
    each = [given] if isinstance(given, str) or not isinstance(given, Iterable) else given
    wrong = [x for x in each if not isinstance(x, str) or x not in names or each is not given]
    if wrong:
        raise InputError(f"{where} needs a list out of {', '.join(names)}; got {', '.join(map(short, wrong))}.")
    return tuple(dict.fromkeys(given))


def checked_rpy(where: str, given: Any, error: type[InputError] = InputError) -> tuple[float, ...]:
    """Roll, pitch and yaw, degrees; arguments as for `checked_deviations`.

    Raises:
        InputError: They are no three finite numbers.
    """
    numbers = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else []
    if len(numbers) != 3 or not all(is_number(x) and abs(x) < HUGE for x in numbers):
        raise error(f"{where} needs roll, pitch and yaw in degrees, three numbers; got {short(given)}.")
    return tuple(map(float, numbers))


def rpy_text(rpy_deg: Iterable[float]) -> str:
    """Roll, pitch and yaw as they stand in a columns file."""
    return f"[{', '.join(f'{angle:.6g}' for angle in rpy_deg)}]"


def checked_coordinates(where: str, given: Any) -> dict[str, list[float]]:
    """Coordinates of joints by name, from numbers or lists by name; empty for joints that are only named.

    Raises:
        InputError: A joint has no name, or a coordinate is no number.
    """
    needed = f"{where} needs joints with where they stand, as {{'elbow': 0.5}}, or joints alone, as ['elbow']"
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, Iterable) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{needed}; got {described(given)}.")
    out = {}
    for name in names:
        stated: Any = given[name] if isinstance(given, Mapping) else ()
        values = [stated] if is_number(stated) or not isinstance(stated, Iterable) else list(stated)
        if not all(map(is_number, values)):
            raise InputError(f"{needed}; '{name}' is given {described(stated)}.")
        out[name] = [float(x) for x in values]
    return out


def check_holdout(value: Any) -> None:
    """Raises an InputError unless a fraction to hold out is a number from 0 to less than 1."""
    if not (is_number(value) and 0 <= value < 1):
        raise InputError(f"holdout needs a fraction of the recording, from 0 to less than 1, got {short(value)}.")


def is_number(value: Any) -> bool:
    """True for real numbers, except True and False."""
    return isinstance(value, Real) and not isinstance(value, bool)


def short(value: Any) -> str:
    """The value as one line of text, cut to fit a message."""
    text = str(value).replace("\n", " ") or "''"
    return text if len(text) <= 60 else f"{text[:57]}..."
