"""Results as pandas data frames."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError
from ident.files.table import vector_columns

if TYPE_CHECKING:
    import pandas as pd

NEEDED = "A data frame needs pandas: pip install 'multicontact[pandas]'."


def frame_of(columns: Sequence[str], rows: Sequence[Sequence[Any]], index: int) -> "pd.DataFrame":
    """Data frame of rows, indexed by the first columns.

    Raises:
        InputError: pandas is not installed.
    """
    return imported_pandas().DataFrame.from_records(rows, columns=list(columns)).set_index(list(columns[:index]))


def channels_frame(time: np.ndarray, channels: Mapping[str, np.ndarray]) -> "pd.DataFrame":
    """Data frame of channels (N,) or (N, d) by name, a column for each component, with the times as its index.

    Raises:
        InputError: pandas is not installed.
    """
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
    try:
        return import_module("pandas")
    except ImportError:
        raise InputError(NEEDED) from None
