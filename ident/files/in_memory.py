"""Tables of what is in memory already: mappings of arrays, pandas data frames, xarray datasets."""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, TypeAlias

import numpy as np

from ident.errors import LogError
from ident.files.table import Table, short, vector_columns


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
    columns = {name: _numbers(name, np.asarray(values)) for name, values in arrays.items()}
    lengths = {name: len(x) for name, x in columns.items()}
    if len(set(lengths.values())) > 1:
        (name, samples), *others = lengths.items()
        other, its = next(each for each in others if each[1] != samples)
        raise LogError(
            f"columns need one length, but '{short(name)}' has {samples} samples and '{short(other)}' has {its}."
        )
    cells = _named(pair for name, x in columns.items() for pair in vector_columns(name, x).items())
    samples = next(iter(lengths.values()), 0)
    return Table(cells, range(1, samples + 1), "sample", origin=kind_of(source))


def _arrays(source: Any) -> dict[str, Any] | None:
    """Columns by name, as they are."""
    if isinstance(source, Mapping):
        lengths = {np.shape(x)[:1] for x in source.values()}
        coordinates = getattr(source, "coords", {}).items()
        return _named([*((k, x) for k, x in coordinates if np.ndim(x) == 1 and x.shape in lengths), *source.items()])
    if hasattr(source, "columns") and hasattr(source, "index"):
        index = [] if source.index.name is None else [(source.index.name, source.index)]
        names = _named((name, name) for name in source.columns)
        return _named([*index, *((name, source[own]) for name, own in names.items())])
    return None


def _named(columns: Iterable[tuple[Any, Any]]) -> dict[str, Any]:
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


def _numbers(name: str, values: np.ndarray) -> np.ndarray:
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
