"""What readers of other programs' files share: libraries that may be missing, and errors of any class for damage."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ident.errors import InputError, LogError
from ident.recordings.column import UNITS
from ident.recordings.npz import reason

SI = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
"""All units that are known, as factors to SI."""


@contextmanager
def library(extra: str) -> Iterator[None]:
    """Turns a failing import of a block into a sentence that names the extra to install.

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
    """Says in one sentence what is no such file, whatever a library says of it.

    Args:
        what: What the file needs to be, for the message.

    Raises:
        LogError: The block failed.
    """
    try:
        yield
    except LogError:
        raise
    # Each library has a dozen classes of errors for damage, and sizes that are damaged ask for any memory.
    except Exception as error:
        raise LogError(f"the file needs to be {what} ({reason(error)}).") from error


def checked_rate(rate: float, what: str) -> float:
    """A rate in Hz.

    Raises:
        LogError: It is none.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise LogError(f"{what} needs to be positive, the file says {rate:g} Hz.")
    return float(rate)
