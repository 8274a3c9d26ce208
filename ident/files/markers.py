"""Positions of labelled markers over time, as motion capture measures them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import LogError
from ident.files.table import Table, short, vector_columns
from ident.tolerances import HUGE


@dataclass(frozen=True, eq=False)
class Markers:
    """Positions of labelled markers.

    Attributes:
        time: Times of the frames, s (N,).
        labels: Names of the markers, each once.
        positions: Positions in the laboratory's frame, NaN where a marker is missing, m (N, M, 3).
    """

    time: np.ndarray
    labels: tuple[str, ...]
    positions: np.ndarray

    def __post_init__(self) -> None:
        N, M = len(self.time), len(self.labels)
        if not N or not M or self.positions.shape != (N, M, 3):
            raise LogError(
                f"{M} markers in {N} frames need positions ({N}, {M}, 3), one or more of each, got shape "
                f"{self.positions.shape}."
            )
        check_labels(self.labels)
        wrong = ~np.isfinite(self.time)
        wrong[1:] |= ~(self.time[1:] > self.time[:-1])
        if wrong.any():
            raise LogError(f"times of frames must be finite and increase; frame {int(wrong.argmax()) + 1} does not.")
        missing = np.isnan(self.positions)
        self._refuse(missing.any(axis=2) & ~missing.all(axis=2), "has some of x, y and z only")
        self._refuse((np.abs(self.positions) >= HUGE).any(axis=2), f"needs positions below {HUGE:g} m")

    def _refuse(self, wrong: np.ndarray, what: str) -> None:
        """Raises an error on the first true entry of a mask of frames and markers (N, M)."""
        if wrong.any():
            k, m = np.argwhere(wrong)[0]
            raise LogError(f"frame {k + 1}: marker '{short(self.labels[m])}' {what}.")

    @property
    def visible(self) -> np.ndarray:
        """Mask of the markers present in each frame (N, M)."""
        return np.isfinite(self.positions).all(axis=2)

    @property
    def table(self) -> Table:
        """Table with the columns `time`, `LABEL.x`, `LABEL.y` and `LABEL.z`."""
        cells = {"time": self.time}
        for label, x in zip(self.labels, self.positions.swapaxes(0, 1), strict=True):
            cells |= vector_columns(label, x)
        return Table(cells, range(len(self.time)), "frame", units=dict.fromkeys(cells, "SI"))


def check_labels(labels: Sequence[str]) -> None:
    """Refuses duplicate labels.

    Raises:
        LogError: A label occurs twice.
    """
    twice = [label for label in labels if labels.count(label) > 1]
    if twice:
        raise LogError(f"markers need different labels, '{short(twice[0])}' is given to more than one.")
