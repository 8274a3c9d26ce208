"""Values of a study file: choices, lists of them, numbers and texts; wrong ones are errors that name the entry."""

from collections.abc import Collection
from typing import Any

from ident.errors import InputError
from ident.files.table import short
from ident.tolerances import HUGE


def choice(where: str, value: Any, choices: Collection[str]) -> str:
    """The value, if it is one of the choices.

    Raises:
        InputError: It is not.
    """
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{where} needs one of {', '.join(choices) or 'none'}, got '{short(value)}'.")
    return value


def several(where: str, value: Any, choices: Collection[str]) -> tuple[str, ...]:
    """The list as a tuple, if all are different and among the choices; errors as for `choice`."""
    if not isinstance(value, list) or len({str(x) for x in value}) < len(value):
        raise InputError(f"{where} needs a list of different ones of {', '.join(choices)}, got {short(value)}.")
    return tuple(choice(where, each, choices) for each in value)


def number(where: str, value: Any, low: float = 0.0, *, whole: bool = False) -> Any:
    """The value, if it is a number of at least `low`; errors as for `choice`."""
    kinds: tuple[type, ...] = (int,) if whole else (int, float)
    if type(value) not in kinds or not low <= value < HUGE:
        raise InputError(f"{where} needs a {'whole ' * whole}number of at least {low:g}, got {short(value)}.")
    return value if whole else float(value)


def text_of(where: str, value: Any) -> str:
    """The value, if it is a text; errors as for `choice`."""
    if not isinstance(value, str):
        raise InputError(f"{where} needs a text, got {short(value)}.")
    return value
