"""Times of logs with a rate instead of a column of times, from the count of the samples."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.table import Table, short

COUNT = "(number of the sample)"
"""Name of the column of sample counts from zero; no file has it."""

LEAST_RATE, MOST_RATE = 1e-3, 1e9
"""Range of accepted rates, Hz."""


def clock_of_rate(where: str, rate: Any) -> Columns:
    """The column of times of a file that has a rate instead.

    Args:
        where: Entry of the mapping, for the message.
        rate: Samples per second, Hz.

    Raises:
        LogError: The rate is no number or out of range.
    """
    if type(rate) not in (int, float) or not LEAST_RATE <= rate <= MOST_RATE:
        raise LogError(f"{where} needs a number of samples per second, in Hz, got {short(rate)}.")
    return Columns((COUNT,), 1 / rate, "s")


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
