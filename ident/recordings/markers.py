"""Positions of labelled markers, as motion capture measures them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.errors import LogError
from ident.recordings.table import Table, short


@dataclass(frozen=True, eq=False)
class Markers:
    """Positions of markers in the laboratory's frame.

    Attributes:
        time: Sample times, s (N,).
        rate: Samples per second, Hz.
        positions: Positions by label, m, NaN where a marker was not seen (N, 3).
    """

    time: np.ndarray
    rate: float
    positions: Mapping[str, np.ndarray]

    @property
    def table(self) -> Table:
        """The same as columns `LABEL.x`, `LABEL.y` and `LABEL.z` beside `time`."""
        cells = {"time": self.time}
        for label, x in self.positions.items():
            cells |= {f"{label}.{axis}": column for axis, column in zip("xyz", x.T, strict=True)}
        return Table(cells, range(len(self.time)), "frame", units=dict.fromkeys(cells, "SI"))


def check_labels(labels: list[str]) -> None:
    """Refuses labels that are given twice.

    Raises:
        LogError: One is.
    """
    twice = [label for label in labels if labels.count(label) > 1]
    if twice:
        raise LogError(f"markers need different labels, '{short(twice[0])}' is given to more than one.")
