"""Objects in a few lines: their `repr`, the same as HTML for notebooks, and tables of both and of pandas."""

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

WIDTH = 100
"""Longest line of a `repr`."""


def short(kind: str, lines: Mapping[str, object]) -> str:
    """`repr` of an object: its kind and a few properties, a line each, cut to `WIDTH`."""
    rows = [f"  {name}: {' '.join(str(value).split())}" for name, value in lines.items() if value not in ("", None)]
    return "\n".join([f"<{kind}", *(row if len(row) <= WIDTH else f"{row[: WIDTH - 1]}…" for row in rows)]) + ">"


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
