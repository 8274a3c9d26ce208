"""Named columns of a file of any format, piece by piece, or of what is in memory: arrays, data frames, datasets."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias

import numpy as np

from ident.arguments import short as short
from ident.errors import LogError
from ident.files.column import Sum

SUFFIXES = {3: "xyz", 4: "wxyz"}
"""Suffixes of the columns of a vector and of a quaternion: `ground_force.x`."""

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

FAR = 1e30
"""Upper limit of the numbers from which others are computed, as products of four."""


@dataclass
class Memory:
    """State that the pieces of a file share, to check that they agree.

    Attributes:
        missing: True for columns read so far that are empty throughout, by name.
        separators: One column with each decimal separator found so far, by separator.
        marks: Decimal separators in the cells of text columns that have been parsed, by name.
        turned: Whole turns taken off columns up to the end of the last piece, in their unit, by name.
    """

    missing: dict[str, bool] = field(default_factory=dict)
    separators: dict[str, str] = field(default_factory=dict)
    marks: dict[str, set[str]] = field(default_factory=dict)
    turned: dict[str, float] = field(default_factory=dict)


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
                name, missing, f"is empty or NaN, {several}; a filter needs all of them: cut the log, or fill the gap."
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


def in_pieces(table: Table, samples: int, overlap: int) -> Iterator[Table]:
    """Yields a table in pieces of at most `samples` samples, each preceded by the last `overlap` of the one before."""
    for first in range(0, len(table.rows), samples):
        piece = slice(max(0, first - overlap), first + samples)
        cells = {name: x[piece] for name, x in table.cells.items()}
        yield replace(table, cells=cells, rows=table.rows[piece])


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


class DataFrame(Protocol):
    """A data frame as of pandas."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""

    @property
    def index(self) -> Any:
        """Index of the rows."""

    def __getitem__(self, name: Any) -> Any:
        """A column."""


InMemory: TypeAlias = Mapping[str, Any] | DataFrame
"""Columns by name: arrays (N,) or (N, d), a data frame, or an xarray dataset."""

TYPES = "a mapping of arrays, a pandas DataFrame or an xarray Dataset"
"""Types of the sources of a table, for messages."""


def kind_of(source: Any) -> str:
    """Kind of a source, for messages, such as `pandas DataFrame` or `dict of columns`."""
    package, name = type(source).__module__.partition(".")[0], type(source).__name__
    return f"{name} of columns" if package in ("builtins", "collections") else f"{package} {name}"


def table_of(source: Any) -> Table | None:
    """Table of columns in memory; None for what is none of `TYPES`.

    The index of a data frame is a column if it has a name, as the coordinates of a dataset are that have one number for
    each sample. Dates and durations become seconds from the first.

    Raises:
        LogError: A column has no numbers, columns have different lengths, or names are not texts of their own.
    """
    arrays = _arrays(source)
    if arrays is None:
        return None
    columns = {name: _as_numbers(name, np.asarray(values)) for name, values in arrays.items()}
    lengths = {name: len(x) for name, x in columns.items()}
    if len(set(lengths.values())) > 1:
        (name, samples), *others = lengths.items()
        other, its = next(each for each in others if each[1] != samples)
        raise LogError(
            f"columns need one length, but '{short(name)}' has {samples} samples and '{short(other)}' has {its}."
        )
    cells = _by_text(pair for name, x in columns.items() for pair in vector_columns(name, x).items())
    samples = next(iter(lengths.values()), 0)
    return Table(cells, range(1, samples + 1), "sample", origin=kind_of(source))


def _arrays(source: Any) -> dict[str, Any] | None:
    """Columns by name, as they are."""
    if isinstance(source, Mapping):
        lengths = {np.shape(x)[:1] for x in source.values()}
        coordinates = getattr(source, "coords", {}).items()
        return _by_text([*((k, x) for k, x in coordinates if np.ndim(x) == 1 and x.shape in lengths), *source.items()])
    if hasattr(source, "columns") and hasattr(source, "index"):
        index = [] if source.index.name is None else [(source.index.name, source.index)]
        names = _by_text((name, name) for name in source.columns)
        return _by_text([*index, *((name, source[own]) for name, own in names.items())])
    return None


def _by_text(columns: Iterable[tuple[Any, Any]]) -> dict[str, Any]:
    """Columns by their names as texts.

    Raises:
        LogError: A name has several levels, or two columns have one name.
    """
    out: dict[str, Any] = {}
    for name, column in columns:
        if isinstance(name, tuple):
            raise LogError(
                f"column {short(name)} has a name of {len(name)} levels and needs a text; for a data frame, "
                'frame.columns = frame.columns.map("_".join) makes one.'
            )
        if str(name) in out:
            raise LogError(f"two columns are named '{short(name)}'; each needs a name of its own.")
        out[str(name)] = column
    return out


def _as_numbers(name: str, values: np.ndarray) -> np.ndarray:
    """Numbers of a column (N,) or (N, d)."""
    if values.ndim not in (1, 2) or not values.size:
        raise LogError(f"column '{short(name)}' needs a number for each sample, got shape {values.shape}.")
    if values.dtype.kind in "mM":
        return (values - values[:1]) / np.timedelta64(1, "s")
    try:
        # Imaginary parts would be dropped.
        return values.astype(float, casting="same_kind" if values.dtype.kind == "c" else "unsafe")
    except (TypeError, ValueError):
        raise LogError(f"column '{short(name)}' needs numbers, got {values.dtype}.") from None
