"""Bodies with intervals, as text and as a data frame."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ident.display.frames import frame_of
from ident.display.text import aligned, decimals_of

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = ("mass", "center x", "center y", "center z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Mass, centre of mass, and inertia about the origin of the body's frame."""

UNITS = ("kg", "m", "m", "m", *["kg m²"] * 6)

HEADS = ("body", "mass, kg", "from data", "centre x, m", "centre y, m", "centre z, m")


class BodyValue(NamedTuple):
    """One quantity of a body.

    Attributes:
        body: Name of the body.
        quantity: One of `QUANTITIES`.
        unit: Its unit.
        value: Its value, as of the updated model.
        lower: Lower limit of its 95 % interval, NaN without one.
        upper: Upper limit.
        model: The model's value; None if the model states no mass.
        share: Share of the data in what is known of it, from 0 to 1.
        determined: True if that is at least half.
        stated: True if it is known exactly beforehand.
    """

    body: str
    quantity: str
    unit: str
    value: float
    lower: float
    upper: float
    model: float | None
    share: float
    determined: bool
    stated: bool

    def __str__(self) -> str:
        return f"{self.body}: {self.quantity} {self.words}"

    @property
    def words(self) -> str:
        """Value and interval: `1.20 (1.15 to 1.26)`, `not determined (more than 0.3)`."""
        low, high = bool(np.isfinite(self.lower)), bool(np.isfinite(self.upper))
        decimals = decimals_of((self.upper - self.lower) / 4) if low and high else None
        value, lower, upper = (_number(x, decimals) for x in (self.value, self.lower, self.upper))
        if self.stated:
            return f"{_number(self.value, None)} (as stated)"
        if np.isnan(self.lower):
            return f"{value} (no interval)"
        limits = f"{lower} to {upper}" if low and high else f"more than {lower}" if low else f"less than {upper}"
        if self.determined:
            return f"{value} ({limits})"
        return f"not determined ({limits})" if low or high else "not determined"


def _number(x: float, decimals: int | None) -> str:
    """A number with some decimals, without those with three significant digits."""
    return f"{x:.3g}" if decimals is None else f"{round(x, decimals) + 0.0:.{max(decimals, 0)}f}"


def bodies_text(rows: Sequence[BodyValue]) -> str:
    """Mass and centre of mass of each body with their intervals, a line each."""
    each = [rows[k : k + len(QUANTITIES)] for k in range(0, len(rows), len(QUANTITIES))]
    lines = [(own[0].body, own[0].words, f"{own[0].share:.0%}", *(x.words for x in own[1:4])) for own in each]
    return "\n".join(aligned(HEADS, lines, (2,)))


def bodies_frame(rows: Sequence[BodyValue]) -> "pd.DataFrame":
    """Data frame of the quantities of bodies, indexed by body and quantity.

    Raises:
        InputError: pandas is not installed.
    """
    return frame_of(BodyValue._fields, rows, index=2)
