"""Objects in a few lines: their `repr`, and the same as a table of HTML for notebooks."""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from html import escape

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
