"""Short text, HTML and data frames: digits of numbers, objects in a few lines, bodies with their intervals."""

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

WIDTH = 120
"""Longest line of a sentence."""

REPR_WIDTH = 100
"""Longest line of a `repr`."""


def decimals_of(std: float | None) -> int | None:
    """Decimals that leave a standard deviation two significant digits; None if it is zero or unknown.

    >>> [decimals_of(std) for std in (0.0312, 0.00996, 123.0, 0.0, float("nan"))]
    [3, 3, -1, None, None]
    """
    return 1 - int(f"{std:.1e}".partition("e")[2]) if std and math.isfinite(std) else None


def decimals_beside(value: float, std: float | None) -> int | None:
    """Decimals of an estimate: those of its standard deviation, or more where it would be printed as zero.

    >>> [decimals_beside(*each) for each in ((2.5, 0.031), (-0.0002, 0.031), (0.0, 0.031), (0.3, 740.0), (2.5, None))]
    [3, 4, 3, 1, None]
    """
    decimals = decimals_of(std)
    if decimals is None or not value or not math.isfinite(value) or round(value, decimals):
        return decimals
    return -int(f"{value:.0e}".partition("e")[2])


def rounded(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, with two significant digits of the latter."""
    if (decimals := decimals_of(std)) is None:
        return f"{value:.4g}", f"{std:.2g}"
    own = decimals_beside(value, std) or 0
    return f"{round(value, own) + 0.0:.{max(own, 0)}f}", f"{round(std, decimals):.{max(decimals, 0)}f}"


def aligned(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Iterable[int]) -> list[str]:
    """Lines of a table with columns two spaces apart, those of numbers aligned to the right."""
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    right = set(numbers)

    def line(cells: Sequence[str]) -> str:
        padded = [x.rjust(w) if k in right else x.ljust(w) for k, (x, w) in enumerate(zip(cells, widths, strict=True))]
        return "  ".join(padded).rstrip()

    return [line(heads), *map(line, rows)]


def short(kind: str, lines: Mapping[str, object]) -> str:
    """`repr` of an object: its kind and a few properties, a line each, cut to `REPR_WIDTH`."""
    rows = [f"  {name}: {' '.join(str(value).split())}" for name, value in lines.items() if value not in ("", None)]
    cut = (row if len(row) <= REPR_WIDTH else f"{row[: REPR_WIDTH - 1]}…" for row in rows)
    return "\n".join([f"<{kind}", *cut]) + ">"


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names with commas between them, at most so many, and the number of the others."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def properties(kind: str, lines: Mapping[str, object]) -> str:
    """HTML of an object: its kind and a few properties, a row each."""
    rows = [(name, str(value)) for name, value in lines.items() if value not in ("", None)]
    body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<div><strong>{escape(kind)}</strong><table><tbody>{body}</tbody></table></div>"


RIGHT = ' style="text-align: right"'


def html_table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table, columns of numbers aligned to the right."""
    right = set(numbers)

    def row(cells: Sequence[str], tag: str) -> str:
        return "".join(f"<{tag}{RIGHT * (k in right)}>{escape(x)}</{tag}>" for k, x in enumerate(cells))

    body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in rows)
    return f"<table><thead><tr>{row(heads, 'th')}</tr></thead><tbody>{body}</tbody></table>"


class Worded:
    """Base of classes that are printed as their sentences; data classes need `repr=False`."""

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return f"<p>{escape(str(self))}</p>"


class Brief:
    """Base of classes whose `repr` is a few properties; data classes need `repr=False`."""

    @property
    @abstractmethod
    def _in_short(self) -> Mapping[str, object]:
        """Properties that the `repr` shows, by name; empty ones and None are left out."""

    def __repr__(self) -> str:
        return short(type(self).__name__, self._in_short)

    def _repr_html_(self) -> str:
        return properties(type(self).__name__, self._in_short)


def frame_of(columns: Sequence[str], rows: Sequence[Sequence[Any]], index: int) -> "pd.DataFrame":
    """Data frame of rows, indexed by the first columns.

    Raises:
        InputError: pandas is not installed.
    """
    return imported_pandas().DataFrame.from_records(rows, columns=list(columns)).set_index(list(columns[:index]))


def channels_frame(time: "np.ndarray", channels: Mapping[str, "np.ndarray"]) -> "pd.DataFrame":
    """Data frame of channels (N,) or (N, d) by name, a column for each component, with the times as its index.

    Raises:
        InputError: pandas is not installed.
    """
    # A command's help is printed without numpy.
    from ident.files.table import vector_columns

    pd = imported_pandas()
    columns: dict[str, np.ndarray] = {}
    for name, x in channels.items():
        columns |= vector_columns(name, x)
    return pd.DataFrame(columns, index=pd.Index(time, name="time"))


def imported_pandas() -> Any:
    """The module pandas.

    Raises:
        InputError: It is not installed.
    """
    from ident.files.limits import library

    with library("pandas", "A data frame"):
        return import_module("pandas")


QUANTITIES = ("mass", "centre x", "centre y", "centre z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Mass, centre of mass, and inertia about the origin of the body's frame."""

UNITS = ("kg", "m", "m", "m", *["kg m²"] * 6)

BODY_HEADS = ("body", "mass, kg", "from data", "centre x, m", "centre y, m", "centre z, m")

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
        low, high = math.isfinite(self.lower), math.isfinite(self.upper)
        if low and high:
            return " to ".join(_number(x, self.decimals) for x in (self.lower, self.upper))
        # That masses are positive is no limit.
        return f"more than {self.lower:.3g}" if low and self.lower else f"less than {self.upper:.3g}" if high else ""

    @property
    def words(self) -> str:
        """Value and interval: `1.20 (1.15 to 1.26)`, `not determined (more than 0.3)`."""
        if math.isnan(self.lower) and self.estimate:
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
        if self.stated or not math.isfinite(half) or not (self.determined or self.with_prior):
            return self.words if self.stated else "-"
        return f"{_number(self.estimate, self.decimals)} ± {_number(half, self.decimals)}"

    @property
    def decimals(self) -> int | None:
        """Decimals of the value: two digits of a quarter of the interval; None without limits."""
        return decimals_of((self.upper - self.lower) / 4) if math.isfinite(self.lower) else None


def _number(x: float, decimals: int | None) -> str:
    """A number with some decimals, without those with three significant digits."""
    return f"{x:.3g}" if decimals is None else f"{round(x, decimals) + 0.0:.{max(decimals, 0)}f}"


def bodies_text(rows: Sequence[BodyValue]) -> str:
    """Mass and centre of mass of each body with their intervals, a line each; a dash: not determined."""
    masses = [(own[0], own[1:4]) for own in _by_body(rows)]
    lines = [(m.body, m.words, f"{100 * m.share:.0f} %", *(x.brief for x in centre)) for m, centre in masses]
    return "\n".join(aligned(BODY_HEADS, lines, (2,)))


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
