"""Bodies with intervals, as text and as a data frame."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ident.display.brief import frame_of
from ident.display.text import aligned, decimals_of

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = ("mass", "centre x", "centre y", "centre z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Mass, centre of mass, and inertia about the origin of the body's frame."""

UNITS = ("kg", "m", "m", "m", *["kg m²"] * 6)

HEADS = ("body", "mass, kg", "from data", "centre x, m", "centre y, m", "centre z, m")

INTERVALS = "95 % intervals, inertia about the frame's origin"
"""Beginning of comments on bodies in files."""


class BodyValue(NamedTuple):
    """One quantity of a body.

    Attributes:
        body: Name of the body.
        quantity: One of `QUANTITIES`.
        unit: Its unit.
        estimate: Its value, as of the updated model.
        lower: Lower limit of its 95 % interval, NaN without one.
        upper: Upper limit.
        model: The model's value; None if the model states no mass.
        share: Share of the data in what is known of it, from 0 to 1.
        determined: True if that is at least half.
        with_prior: True if the estimate includes a prior.
        stated: True if it is known exactly beforehand.
    """

    body: str
    quantity: str
    unit: str
    estimate: float
    lower: float
    upper: float
    model: float | None
    share: float
    determined: bool
    with_prior: bool
    stated: bool

    def __str__(self) -> str:
        return f"{self.body}: {self.quantity} {self.words}"

    @property
    def limits(self) -> str:
        """Its interval: `1.15 to 1.26`, `more than 0.3`, or "" without one."""
        low, high = bool(np.isfinite(self.lower)), bool(np.isfinite(self.upper))
        if low and high:
            return " to ".join(_number(x, self.decimals) for x in (self.lower, self.upper))
        # That masses are positive is no limit.
        return f"more than {self.lower:.3g}" if low and self.lower else f"less than {self.upper:.3g}" if high else ""

    @property
    def words(self) -> str:
        """Value and interval: `1.20 (1.15 to 1.26)`, `not determined (more than 0.3)`."""
        if np.isnan(self.lower) and self.estimate:
            return f"{self.estimate:.3g} (no interval)"
        if self.stated:
            return f"{self.estimate:.3g} (as stated)"
        if not (self.determined or self.with_prior):
            return f"not determined ({self.limits})" if self.limits else "not determined"
        notes = ", ".join(filter(None, (self.limits, "of the prior" * (not self.determined)))) or "no interval"
        return f"{_number(self.estimate, self.decimals)} ({notes})"

    @property
    def brief(self) -> str:
        """Value and largest distance of a limit: `0.076 ± 0.053`; a dash where it is not determined."""
        half = max(self.estimate - self.lower, self.upper - self.estimate)
        if self.stated or not np.isfinite(half) or not (self.determined or self.with_prior):
            return self.words if self.stated else "-"
        return f"{_number(self.estimate, self.decimals)} ± {_number(half, self.decimals)}"

    @property
    def decimals(self) -> int | None:
        """Decimals of the value: two digits of a quarter of the interval; None without limits."""
        return decimals_of((self.upper - self.lower) / 4) if np.isfinite(self.lower) else None


def _number(x: float, decimals: int | None) -> str:
    """A number with some decimals, without those with three significant digits."""
    return f"{x:.3g}" if decimals is None else f"{round(x, decimals) + 0.0:.{max(decimals, 0)}f}"


def bodies_text(rows: Sequence[BodyValue]) -> str:
    """Mass and centre of mass of each body with their intervals, a line each; a dash: not determined."""
    masses = [(own[0], own[1:4]) for own in _by_body(rows)]
    lines = [(m.body, m.words, f"{100 * m.share:.0f} %", *(x.brief for x in centre)) for m, centre in masses]
    return "\n".join(aligned(HEADS, lines, (2,)))


def comments(rows: Sequence[BodyValue]) -> dict[str, str]:
    """Intervals and the data's share of each body in ASCII, for a comment in a file, by the body's name."""
    out = {}
    for own in _by_body(rows):
        open_ = [each.quantity for each in own if each.words == "not determined"]
        known = [
            f"{each.quantity} {each.words} {each.unit}{f', {100 * each.share:.0f} % from data' * each.determined}"
            for each in own
            if each.quantity not in open_
        ]
        known += [f"not determined: {', '.join(open_)}"] * bool(open_)
        out[own[0].body] = f"{INTERVALS}: {'; '.join(known)}".replace("²", "2")
    return out


def _by_body(rows: Sequence[BodyValue]) -> list[Sequence[BodyValue]]:
    return [rows[k : k + len(QUANTITIES)] for k in range(0, len(rows), len(QUANTITIES))]


def bodies_frame(rows: Sequence[BodyValue]) -> "pd.DataFrame":
    """Data frame of the quantities of bodies, indexed by body and quantity.

    Raises:
        InputError: pandas is not installed.
    """
    return frame_of(BodyValue._fields, rows, index=2)
