"""Times of logs with a rate instead of a column of times, and selection of rows or times."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs
from ident.errors import LogError
from ident.files.column import Columns
from ident.files.schema import value_of
from ident.files.table import Table

EPOCH = 1e6
"""First time above which a clock counts from an epoch, s; such times are counted from the first sample instead."""

Span = Annotated[tuple[float, float], Needs("two numbers, the first before the last", lambda x: x[0] < x[1])]
"""First and last, both included."""

COUNT = "(number of the sample)"
"""Name of the column of sample counts from zero; no file has it."""

Rate = Annotated[float, Needs("a number of samples per second, in Hz", lambda x: x >= 1e-3)]
"""Rate of a log without times; a slower one is a unit that is wrong."""


@dataclass(frozen=True)
class Selection:
    """Spans of rows and of times; without any, everything is selected.

    Attributes:
        rows: Spans of rows, numbered as in messages.
        time: Spans of times, s.
    """

    rows: tuple[Span, ...] = ()
    time: tuple[Span, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.rows or self.time)

    def of_rows(self, table: Table) -> Table:
        """The rows of a table that are in one of the spans of rows.

        Raises:
            LogError: There is none.
        """
        if not self.rows:
            return table
        numbers = np.asarray(table.rows)
        kept = _inside(numbers, self.rows)
        if not kept.any():
            there = f"{table.word}s {numbers[0]} to {numbers[-1]}" if len(numbers) else "none"
            has = f"the {table.origin} has"
            raise LogError(f"[select] needs rows that {has}, got {_listed(self.rows)}; {has} {there}.")
        return taken(table, kept)

    def of_times(self, table: Table, seconds: np.ndarray) -> Table:
        """The rows of a table at times in one of the spans of times.

        Args:
            table: The table.
            seconds: Its times, s (N,).

        Raises:
            LogError: There is none.
        """
        if not self.time or not len(seconds):
            return table
        kept = _inside(seconds, self.time)
        if not kept.any():
            there = f"its times go from {seconds.min():g} s to {seconds.max():g} s"
            raise LogError(f"[select] needs times that the {table.origin} has, got {_listed(self.time)}; {there}.")
        return taken(table, kept)


def from_first(seconds: np.ndarray) -> np.ndarray:
    """Times of a recording (N,): counted from the first one if that is beyond `EPOCH`."""
    return seconds - seconds[0] if len(seconds) and abs(seconds[0]) > EPOCH else seconds


def selected(table: Table, selection: Selection, clock: Columns) -> Table:
    """The selected rows of a table, whose times are in the column `clock`."""
    if not selection:
        return table
    table = selection.of_rows(table)
    (name,) = clock.names
    return selection.of_times(table, from_first(table.column(name) * clock.factor)) if selection.time else table


def taken(table: Table, kept: np.ndarray) -> Table:
    """The samples of a table where a mask is true (N,)."""
    samples = np.flatnonzero(kept).tolist()
    cells = {
        name: cells[samples] if isinstance(cells, np.ndarray) else [cells[i] for i in samples]
        for name, cells in table.cells.items()
    }
    return replace(table, cells=cells, rows=[table.rows[i] for i in samples])


def _inside(x: np.ndarray, spans: Sequence[Span]) -> np.ndarray:
    return np.any([(first <= x) & (x <= last) for first, last in spans], axis=0)


def _listed(spans: Sequence[Span]) -> str:
    return ", ".join(f"{first:g} to {last:g}" for first, last in spans)


def clock_of_rate(where: str, rate: Any) -> Columns:
    """The column of times of a file that has a rate instead.

    Args:
        where: Entry of the mapping, for the message.
        rate: Samples per second, Hz.

    Raises:
        LogError: The rate is no number or out of range.
    """
    return Columns((COUNT,), 1 / value_of(where, rate, Rate), "s")


def counted(tables: Iterable[Table], clock: Columns | None, overlap: int = 0) -> Iterator[Table]:
    """Pieces of a file, with a column of sample counts if the clock is a rate.

    Args:
        tables: The pieces, in order.
        clock: The mapping's column of times, None if it has none.
        overlap: Samples that each piece repeats from the end of the one before.
    """
    if clock is None or clock.names != (COUNT,):
        yield from tables
        return
    done = 0
    for table in tables:
        first = max(0, done - overlap)
        done = first + len(table.rows)
        yield replace(table, cells={**table.cells, COUNT: np.arange(first, done, dtype=float)})
