"""Results as pandas data frames."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError
from ident.files.table import vector_columns

if TYPE_CHECKING:
    import pandas as pd

    from ident.display.parameters import Parameter

NEEDED = "A data frame needs pandas: pip install 'multicontact[pandas]'."


def parameters_frame(parameters: Sequence["Parameter"]) -> "pd.DataFrame":
    """Data frame of parameters, indexed by their names, with 95 % intervals that include the set-up.

    Raises:
        InputError: pandas is not installed.
    """
    pd = _pandas()
    intervals = np.array([each.interval() for each in parameters]).reshape(-1, 2)
    columns = ("kind", "body", "estimate", "std", "std_setup", "unit", "model", "expression")
    out: dict[str, Any] = {key: [getattr(each, key) for each in parameters] for key in columns}
    out["model"] = np.array([np.nan if x is None else x for x in out["model"]])
    out |= {"lower": intervals[:, 0], "upper": intervals[:, 1]}
    index = pd.Index([each.name for each in parameters], name="parameter")
    order = [*columns[:5], "lower", "upper", *columns[5:]]
    return pd.DataFrame(out, index=index)[order]


def frame_of(columns: Sequence[str], rows: Sequence[Sequence[Any]], index: int) -> "pd.DataFrame":
    """Data frame of rows, indexed by the first columns.

    Raises:
        InputError: pandas is not installed.
    """
    return _pandas().DataFrame.from_records(rows, columns=list(columns)).set_index(list(columns[:index]))


def channels_frame(time: np.ndarray, channels: Mapping[str, np.ndarray]) -> "pd.DataFrame":
    """Data frame of channels (N,) or (N, d) by name, a column for each component, with the times as its index.

    Raises:
        InputError: pandas is not installed.
    """
    pd = _pandas()
    columns: dict[str, np.ndarray] = {}
    for name, x in channels.items():
        columns |= vector_columns(name, x)
    return pd.DataFrame(columns, index=pd.Index(time, name="time"))


def _pandas() -> Any:
    """The module pandas.

    Raises:
        InputError: It is not installed.
    """
    try:
        return import_module("pandas")
    except ImportError:
        raise InputError(NEEDED) from None
