"""Named columns of a file of any format, their units, and columns computed from others."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.arguments import short as short
from ident.errors import LogError

KINDS = {
    "position": ("{}_position", "q_{}", "{}"),
    "velocity": ("{}_velocity", "dq_{}"),
    "acceleration": ("{}_acceleration", "ddq_{}"),
    "torque": ("{}_torque", "tau_{}"),
}
"""Quantities of a joint and the names of their columns; for a ball, before the suffixes `.w`, `.x` and so on."""

COMMAND = "{}_command"
"""Name of the column of a hinge's or slide's commanded position."""

BALL = {"position": "wxyz", "velocity": "xyz", "acceleration": "xyz", "torque": "xyz"}
"""Suffixes of a ball's columns: a quaternion, and vectors in the body's frame."""

_SQUARED = ("^2", "2", "²")
_ANGLE = {"rad": 1.0, "deg": np.pi / 180}
_RATE = {f"{u}/s": f for u, f in _ANGLE.items()}
_ACCELERATION = {f"{u}/s{s}": f for u, f in _ANGLE.items() for s in _SQUARED}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_MOMENT = {"N m": 1.0, "Nm": 1.0, "N mm": 1e-3, "Nmm": 1e-3, "mN m": 1e-3, "mNm": 1e-3, "kN m": 1e3, "kNm": 1e3}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "hinge position": _ANGLE,
    "hinge velocity": _RATE | {"rpm": np.pi / 30},
    "hinge acceleration": _ACCELERATION,
    "hinge torque": _MOMENT,
    "hinge command": _ANGLE,
    "ball position": {"1": 1.0},
    "ball velocity": _RATE,
    "ball acceleration": _ACCELERATION,
    "ball torque": _MOMENT,
    "slide position": _LENGTH,
    "slide velocity": {f"{u}/s": f for u, f in _LENGTH.items()},
    "slide acceleration": {f"{u}/s{s}": f for u, f in _LENGTH.items() for s in _SQUARED},
    "slide torque": _FORCE,
    "slide command": _LENGTH,
    "force": _FORCE,
    "torque": _MOMENT,
    "length": _LENGTH,
}
"""Units of every quantity, as factors to SI; the first is the default."""

CURRENT = {"A": 1.0, "mA": 1e-3}
"""Units of a motor's current; a gain turns it into a torque in N m or a force in N."""

SUFFIXES = {3: "xyz", 4: "wxyz"}
"""Suffixes of the columns of a vector and of a quaternion: `ground_force.x`."""

TIME = "time"
"""Column of the times of a table that has its own, s."""

COUNT = "(number of the sample)"
"""Column of sample counts from zero, from which a rate makes times; no file has it."""

TRUE = "true:"
"""Prefix of the columns that hold true values."""

BASE = "base:pose"
"""Prefix of the columns of a file that hold the poses of a moving base, row by row."""

METADATA = {
    **dict.fromkeys(("units", "noise", "provenance", "sensors", "setup", "known", "known_bodies"), dict),
    **dict.fromkeys(("servos", "scales", "couplings", "followers", "stated", "trackers"), dict),
    **dict.fromkeys(("notes", "unused"), list),
}
"""Metadata of a file and their JSON types, by name."""


LISTED = 40
"""Names that a message lists at most."""

EPOCH = 1e6
"""First time above which a clock counts from an epoch, s; such times are counted from the first sample instead."""

FAR = 1e30
"""Upper limit of times, of a model's numbers and of those from which others are computed, as products of four."""


@dataclass(frozen=True)
class Sum:
    """A column computed from others: Σ weight · column + constant, or a constant alone.

    Attributes:
        columns: Names of the columns in the sum, each once.
        weights: Weight of each column.
        constant: Constant that is added.
    """

    columns: tuple[str, ...]
    weights: tuple[float, ...]
    constant: float = 0.0

    @property
    def name(self) -> str:
        """Name in messages and in a mapping, such as `0.5*qm5 + 0.5*qm6 - 3`."""
        terms = [f"{w:+.9g}*{name}" for w, name in zip(self.weights, self.columns, strict=True)]
        terms += [f"{self.constant:+.9g}"] if self.constant else []
        text = " ".join(terms).removeprefix("+").replace(" +", " + ").replace(" -", " - ")
        return text if self.columns else f"constant {self.constant:.9g}"

    def of(self, columns: Sequence[np.ndarray], samples: int) -> np.ndarray:
        """Values of the sum from those of its columns (N,), NaN where one of them is missing (N,)."""
        constant = np.full(samples, self.constant)
        return np.tensordot(self.weights, np.stack(columns), axes=1) + constant if columns else constant


@dataclass(frozen=True)
class Columns:
    """Columns that make one quantity.

    Attributes:
        names: Their names, "" for those that are missing.
        factor: Their unit as a factor to the SI's.
        unit: The SI's unit, "" unless a unit is stated.
        sums: Those of them that are computed; `names` has their names.
    """

    names: tuple[str, ...]
    factor: float = 1.0
    unit: str = ""
    sums: tuple[Sum, ...] = ()

    @property
    def read(self) -> tuple[str, ...]:
        """Names of the columns of the file that are read."""
        computed = {each.name: each.columns for each in self.sums}
        return tuple(column for name in filter(None, self.names) for column in computed.get(name, (name,)))

    @property
    def alone(self) -> tuple[str, ...]:
        """Names of the columns, no constants; a sum of one column counts as that column, of several by its own name."""
        single = {each.name: each.columns for each in self.sums if len(each.columns) < 2}
        return tuple(own for name in filter(None, self.names) for own in single.get(name, (name,)))

    @property
    def line(self) -> tuple[float, float]:
        """Factor and constant of a single quantity from one column, in SI units."""
        (term,) = self.sums or (Sum(self.names, (1.0,)),)
        return self.factor * term.weights[0], self.factor * term.constant


def combined(weights: Iterable[float], columns: Sequence[Columns]) -> Columns:
    """Σ weight · column in SI units, with columns that may be sums themselves expanded into one sum."""
    terms: dict[str, float] = {}
    constant = 0.0
    for weight, each in zip(weights, columns, strict=True):
        if not weight:
            continue
        (inner,) = each.sums or (Sum(each.names, (1.0,)),)
        scale = float(weight) * each.factor
        constant += scale * inner.constant
        for name, share in zip(inner.columns, inner.weights, strict=True):
            terms[name] = terms.get(name, 0.0) + scale * share
    total = Sum(tuple(terms), tuple(terms.values()), constant)
    return Columns((total.name,), sums=(total,))


@dataclass
class Memory:
    """State that the pieces of a file share, to check that they agree.

    Attributes:
        missing: True for columns read so far that are empty throughout, by name.
        separators: One column with each decimal separator found so far, by separator.
        marks: Decimal separators in the cells of text columns that have been parsed, by name.
    """

    missing: dict[str, bool] = field(default_factory=dict)
    separators: dict[str, str] = field(default_factory=dict)
    marks: dict[str, set[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Table:
    """Columns of a file by name, as text or numbers.

    Text is parsed column by column, when a column is used; a column of comments does no harm.

    Attributes:
        cells: Columns by name (N,).
        rows: Number of each sample in the file.
        word: Name of these numbers in messages, such as row or sample.
        metadata: Metadata of the file, by the names of `METADATA`.
        memory: State from the pieces before.
        decimal_comma: True if numbers may have decimal commas.
        sums: Columns that are computed from those of the file, by name.
        units: Units that the file states, by column: `SI`, or `deg` for SI with angles in degrees.
        notes: Further sentences on the file.
        origin: Kind of what has the columns, for messages.
    """

    cells: Mapping[str, Sequence[str] | np.ndarray]
    rows: Sequence[int] | np.ndarray
    word: str
    metadata: Mapping[str, Any] = field(default_factory=dict)
    memory: Memory = field(default_factory=Memory)
    decimal_comma: bool = False
    sums: Mapping[str, Sum] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    origin: str = "file"

    def row(self, i: int) -> str:
        """Location of sample i in the file, for messages."""
        return f"{self.word} {self.rows[i]}"

    def part(self, rows: slice) -> "Table":
        """The table of consecutive samples."""
        return replace(self, cells={name: x[rows] for name, x in self.cells.items()}, rows=self.rows[rows])

    def where(self, kept: np.ndarray) -> "Table":
        """The table of the samples where a mask is true (N,)."""
        rows = np.flatnonzero(kept).tolist()
        cells = {name: x[rows] if isinstance(x, np.ndarray) else [x[i] for i in rows] for name, x in self.cells.items()}
        return replace(self, cells=cells, rows=[self.rows[i] for i in rows])

    def counted(self, clock: Columns | None) -> "Table":
        """The table, with a column of sample counts if the clock is a rate."""
        if clock is None or clock.names != (COUNT,):
            return self
        return replace(self, cells={**self.cells, COUNT: np.arange(len(self.rows), dtype=float)})

    def available(self) -> str:
        """Names of the file's columns, for messages."""
        return f"the {self.origin} has {listed(self.cells)}"

    def column(self, name: str, limit: float = np.inf, *, gaps: bool = False, tame: bool = False) -> np.ndarray:
        """Numbers of a column (N,), all NaN or none unless some may be missing.

        Args:
            name: Name of the column, of the file or of a sum.
            limit: Largest number that is accepted.
            gaps: True if some may be missing.
            tame: True to take infinite and too large ones for missing ones.

        Raises:
            LogError: A cell is no number, empty, infinite or too large; the message names it.
        """
        x = self._numbers(name)
        if tame:
            x = np.where(np.abs(x) <= limit, x, np.nan)
        if (np.abs(x) <= min(limit, np.finfo(float).max)).all() and not self.memory.missing.setdefault(name, False):
            return x
        infinite, missing, large = np.isinf(x), np.isnan(x), np.abs(x) > limit
        throughout = self.memory.missing.setdefault(name, bool(missing.all()))
        if infinite.any():
            raise self._fault(name, infinite, f"needs a finite number, got {x[infinite][0]}.")
        if missing.any() and not throughout and not gaps:
            several = f"as are {int(missing.sum())} of {len(x)} samples of it{self._longest(missing)}"
            raise self._fault(
                name,
                missing,
                f"is empty or NaN, {several}; a filter needs all of them: cut the log, fill the gap, or let the "
                "trajectory estimate do without them (--gaps; in Python gaps=True).",
            )
        if throughout and not missing.all():
            raise self._fault(name, ~missing, "has the first number after empty cells.")
        if large.any():
            raise self._fault(name, large, f"needs numbers below {limit:g}, got {x[large][0]:g}.")
        return x

    def _numbers(self, name: str) -> np.ndarray:
        """Numbers of a column, from the file or computed (N,)."""
        if name in self.sums:
            parts = [self.column(part, FAR, gaps=True) for part in self.sums[name].columns]
            return self.sums[name].of(parts, len(self.rows))
        cells = self.cells[name]
        if self.decimal_comma:
            self._check_separators(name)
        if isinstance(cells, np.ndarray):
            return cells
        return np.array([self._number(name, i, cell) for i, cell in enumerate(cells)])

    def _fault(self, name: str, wrong: np.ndarray, what: str) -> LogError:
        """Error on the first sample of a column where a mask is true."""
        return LogError(f"{self.row(int(wrong.argmax()))}, column '{name}' {what}")

    def _longest(self, missing: np.ndarray) -> str:
        """Location of the longest run of missing samples, for messages; "" if all are isolated."""
        edges = np.flatnonzero(np.diff([False, *missing, False]))
        first, after = edges[::2], edges[1::2]
        k = int((after - first).argmax())
        if after[k] - first[k] < 2:
            return ""
        return f", {int(after[k] - first[k])} in a row from {self.row(first[k])} to {self.row(after[k] - 1)}"

    def channels(self) -> dict[str, np.ndarray]:
        """All channels (N,) or (N, d), vectors joined from their columns, which may be in any order."""
        groups: dict[str, dict[str, np.ndarray]] = {}
        for column in self.cells:
            name, _, suffix = column.partition(".")
            groups.setdefault(name, {})[suffix] = self.column(column)
        return {name: _channel(name, group) for name, group in groups.items()}

    def _check_separators(self, name: str) -> None:
        """Refuses files with decimal commas and points."""
        known = self.memory.separators
        for mark in sorted(self.memory.marks.get(name, ())):
            known.setdefault(mark, name)
        if len(known) == 2:
            raise LogError(
                f"decimal commas (column '{short(known[','])}') and decimal points (column '{short(known['.'])}') in "
                "one file are ambiguous; use one of them."
            )

    def _number(self, name: str, i: int, cell: str) -> float:
        try:
            return number_of(cell, self.decimal_comma)
        except ValueError:
            raise LogError(f"{self.row(i)}, column '{name}' needs a number, got '{short(cell)}'.") from None


def _channel(name: str, columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """A channel from its column, or from those of its components by their suffixes."""
    if columns.keys() == {""}:
        return columns[""]
    expected = SUFFIXES.get(len(columns), [str(k) for k in range(len(columns))])
    if columns.keys() != set(expected):
        has = ", ".join(map(short, columns))
        raise LogError(f"channel '{name}' needs the components {', '.join(expected)}, it has {has}.")
    return np.stack([columns[suffix] for suffix in expected], axis=1)


def vector_columns(name: str, x: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of an array by name (N,), vectors and quaternions split into components.

    Args:
        name: Name of the array.
        x: One number for each sample or several (N,) or (N, d).
    """
    if x.ndim == 1:
        return {name: x}
    suffixes = SUFFIXES.get(x.shape[1], range(x.shape[1]))
    return {f"{name}.{suffix}": column for suffix, column in zip(suffixes, x.T, strict=True)}


def number_of(cell: str, decimal_comma: bool) -> float:
    """The number in a cell, NaN for an empty one.

    Raises:
        ValueError: The cell holds no number.
    """
    if "_" in cell:
        raise ValueError(cell)
    return float((cell.replace(",", ".") if decimal_comma else cell) or "nan")


def is_number(cell: str) -> bool:
    """True if a cell holds a number, perhaps with a decimal comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def listed(names: Collection[str]) -> str:
    """Names for a message, shortened if there are many."""
    some = [short(name) for name in names][:LISTED]
    return ", ".join(some + ["..."] * (len(names) > len(some))) or "none"
