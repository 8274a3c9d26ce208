"""Times of logs that have no column of times but a rate: samples are counted."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.recordings.column import Columns
from ident.recordings.table import Table, short

COUNT = "(number of the sample)"
"""Column that counts samples from zero, which no file has."""

LEAST_RATE, MOST_RATE = 1e-3, 1e9
"""Samples per second that any recording has, Hz."""


def clock_of_rate(where: str, rate: Any) -> Columns:
    """The column of times of a file without one.

    Args:
        where: Entry of the mapping, for the message.
        rate: Samples per second, Hz.

    Raises:
        LogError: It is no number, or none that a recording has.
    """
    if type(rate) not in (int, float) or not LEAST_RATE <= rate <= MOST_RATE:
        raise LogError(f"{where} needs a number of samples per second, in Hz, got {short(rate)}.")
    return Columns((COUNT,), 1 / rate, "s")


def counted(tables: Iterable[Table], clock: Columns | None, overlap: int = 0) -> Iterator[Table]:
    """Pieces of a file with the count of their samples, if the times are to follow from that.

    Args:
        tables: The pieces, in order.
        clock: The mapping's column of times, None where it has none.
        overlap: Samples of the piece before that each begins with again.
    """
    if clock is None or clock.names != (COUNT,):
        yield from tables
        return
    done = 0
    for table in tables:
        first = max(0, done - overlap)
        done = first + len(table.rows)
        yield replace(table, cells={**table.cells, COUNT: np.arange(first, done, dtype=float)})
