"""Common parts of the readers of other programs' files: missing libraries, and errors of any class for damage."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ident.errors import InputError, LogError
from ident.files.column import UNITS
from ident.files.limits import reason

SI = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
"""All known units, as factors to SI."""


@contextmanager
def library(extra: str) -> Iterator[None]:
    """Turns a failed import in a block into a sentence that names the extra to install.

    Raises:
        InputError: The import failed.
    """
    try:
        yield
    except ImportError as error:
        package = error.name or str(error)
        raise InputError(
            f"This log needs the package '{package}', which the extra '{extra}' brings: "
            f"pip install multicontact[{extra}]."
        ) from None


@contextmanager
def undamaged(what: str) -> Iterator[None]:
    """Turns any error that a library raises in a block into one sentence on the damaged file.

    Args:
        what: Kind of file that is needed, for the message.

    Raises:
        LogError: The block failed.
    """
    try:
        yield
    except LogError:
        raise
    # Each library has a dozen classes of errors for damage, and a damaged size may ask for any amount of memory.
    except Exception as error:
        raise LogError(f"the file needs to be {what} ({reason(error)}).") from error


def checked_rate(rate: float, what: str) -> float:
    """The rate in Hz, checked to be positive and finite.

    Raises:
        LogError: It is not.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise LogError(f"{what} needs to be positive, the file says {rate:g} Hz.")
    return float(rate)
