"""Tables of what is in memory already: mappings of arrays, pandas data frames, xarray datasets."""

from collections.abc import Mapping
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


def table_of(source: Any) -> Table | None:
    """Table of columns in memory; None for what is none of `TYPES`.

    The index of a data frame is a column if it has a name, as the coordinates of a dataset are that have one number for
    each sample. Dates and durations become seconds from the first.

    Raises:
        LogError: A column has no numbers, or columns have different lengths.
    """
    arrays = _arrays(source)
    if arrays is None:
        return None
    columns = {name: _numbers(name, values) for name, values in arrays.items()}
    lengths = {name: len(x) for name, x in columns.items()}
    if len(set(lengths.values())) > 1:
        (name, samples), *others = lengths.items()
        other, its = next(each for each in others if each[1] != samples)
        raise LogError(
            f"columns need one length, but '{short(name)}' has {samples} samples and '{short(other)}' has {its}."
        )
    cells: dict[str, np.ndarray] = {}
    for name, x in columns.items():
        cells |= vector_columns(name, x)
    samples = next(iter(lengths.values()), 0)
    return Table(cells, range(1, samples + 1), "sample")


def _arrays(source: Any) -> dict[str, np.ndarray] | None:
    """Arrays by name, as they are."""
    if isinstance(source, Mapping):
        arrays = {str(name): np.asarray(x) for name, x in source.items()}
        lengths = {x.shape[:1] for x in arrays.values()}
        coordinates = {str(name): np.asarray(x) for name, x in getattr(source, "coords", {}).items()}
        return {name: x for name, x in coordinates.items() if x.ndim == 1 and x.shape in lengths} | arrays
    if hasattr(source, "columns") and hasattr(source, "index"):
        index = {} if source.index.name is None else {str(source.index.name): np.asarray(source.index)}
        return index | {str(name): np.asarray(source[name]) for name in source.columns}
    return None


def _numbers(name: str, values: np.ndarray) -> np.ndarray:
    """Numbers of a column (N,) or (N, d)."""
    if values.ndim not in (1, 2) or not values.size:
        raise LogError(f"column '{short(name)}' needs a number for each sample, got shape {values.shape}.")
    if values.dtype.kind in "mM":
        return (values - values[:1]) / np.timedelta64(1, "s")
    try:
        return values.astype(float)
    except (TypeError, ValueError):
        raise LogError(f"column '{short(name)}' needs numbers, got {values.dtype}.") from None
