"""Decimals of numbers as an author prints them: two significant digits of a standard deviation, and no more."""

import math
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from numbers import Integral

from ident.display.text import decimals_of

LEAST = 12
"""Largest number of decimals; numbers whose standard deviations need more are rounded, or powers of ten if smaller."""

HUGE = 1e6
"""Size from which numbers are powers of ten."""

Decimals = Sequence[int | None]
"""Decimals of each row of a column, negative for tens and hundreds; None for the table's."""


def number(value: float, decimals: int = 3) -> str:
    """A number as text with so many decimals, or as a power of ten if it is large or small.

    Integers, also numpy's, have no decimals; booleans have.

    >>> [number(2.5187, 3), number(1234.0, -1), number(2e6), number(2e6, -4), number(3.14e-14, 15), number(7)]
    ['2.519', '1230', '2.00e+06', '2.00e+06', '3.1e-14', '7']
    """
    if is_whole(value):
        return str(value)
    if abs(value) >= HUGE:
        power = int(f"{value:e}".partition("e")[2])
        return f"{value:.{2 if decimals > 0 else max(power + decimals, 0)}e}"
    if decimals > LEAST and 0 < abs(value) < 0.5 * 10**-LEAST:
        return f"{value:.1e}"
    shown = min(decimals, LEAST)
    # Adding zero turns a rounded -0.0 into 0.0.
    return f"{round(value, shown) + 0.0:.{max(shown, 0)}f}"


def is_whole(value: float) -> bool:
    """True for a count, by its type."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def of_numbers(std: Iterable[float | None]) -> Decimals:
    """Decimals of numbers with these standard deviations."""
    return tuple(map(decimals_of, std))


def of_deviations(std: Iterable[float | None]) -> Decimals:
    """Decimals of the standard deviations themselves; none if one is zero."""
    return tuple(0 if x == 0 else decimals_of(x) for x in std)


def as_stated(numbers: Iterable[float]) -> int:
    """Decimals of a set of stated numbers: those of the one that has most.

    >>> as_stated([0.32, -1.0, 20.99])
    2
    """
    exponents = (Decimal(repr(float(x))).normalize().as_tuple().exponent for x in numbers if math.isfinite(x))
    return max([0, *(-int(exponent) for exponent in exponents)])


def lacking(texts: Sequence[str]) -> list[str]:
    """Text that each number lacks to have all the decimals of its column, so that decimal points can be aligned.

    >>> lacking(["1.25", "-30", "0.1", "2.00e+06", ""])
    ['', '.00', '0', '', '']
    """
    parts = [re.fullmatch(r"[-+]?\d+(?:\.(\d+))?", text) for text in texts]
    most = max((len(part[1] or "") for part in parts if part), default=0)
    return ["" if part is None else ("." + "0" * most)[_shown(part[1], most) :] for part in parts]


def _shown(decimals: str | None, most: int) -> int:
    """Letters of a column's decimals, with their point, that a number has."""
    return 1 + len(decimals) if decimals else 0 if most else 1
