"""Spline functions at the times of samples, grouped by interval, as rows and linear responses use them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ident.trajectory.algebra.spline import LOCAL, Local, Spline


class Intervals:
    """Grouping of samples by interval, m rows for each; unused rows are zero.

    Attributes:
        number: Number of intervals S.
        room: Rows per interval m, the largest number of samples in one.
    """

    def __init__(self, interval: np.ndarray, number: int) -> None:
        """Assigns a row to every sample.

        Args:
            interval: Interval of each sample, never decreasing (N,).
            number: Number of intervals.
        """
        counts = np.bincount(interval, minlength=number)
        self.number, self.room = number, max(int(counts.max(initial=0)), 1)
        self._place = self.room * interval + np.arange(len(interval)) - (np.cumsum(counts) - counts)[interval]
        self._places = np.divmod(self._place, self.room)
        self._last = np.maximum(counts - 1, 0)

    def dealt(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all samples (N, …) grouped by interval (S, m, …)."""
        out = np.zeros((self.number * self.room, *rows.shape[1:]))
        out[self._place] = rows
        return out.reshape(self.number, self.room, *rows.shape[1:])

    def gathered(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all samples (N, …) from those grouped by interval (S, m, …)."""
        return rows.reshape(self.number * self.room, *rows.shape[2:])[self._place]

    def dealt_by_stream(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all samples and streams (N, s, …) grouped by interval and stream (S, s, m, …)."""
        out = np.zeros((self.number, rows.shape[1], self.room, *rows.shape[2:]))
        out.swapaxes(1, 2)[self._places] = rows
        return out

    def before(self, rows: np.ndarray, first: int = 0, *, moved: int = 0) -> np.ndarray:
        """Rows of the preceding samples, zeros for the first.

        Args:
            rows: Rows of some intervals (k, m, …).
            first: Index of the first of these intervals.
            moved: Number of columns by which windows move from one interval to the next.
        """
        out = np.zeros_like(rows)
        out[:, 1:] = rows[:, :-1]
        last = rows[np.arange(len(rows) - 1), self._last[first : first + len(rows) - 1]]
        out[1:, 0, ..., : rows.shape[-1] - moved] = last[..., moved:]
        return out

    def last(self, rows: np.ndarray, first: int = 0) -> np.ndarray:
        """Rows of the last sample of each of some intervals but the last one.

        Args:
            rows: Rows of k intervals (k, c, m, …).
            first: Index of the first of these intervals.

        Returns:
            The rows (k - 1, c, …).
        """
        number = len(rows) - 1
        return rows[np.arange(number), :, self._last[first : first + number]]


@dataclass(frozen=True, eq=False)
class Sampling:
    """Spline functions at some times.

    Attributes:
        spline: Spline space.
        time: Times, s, never decreasing (N,).
    """

    spline: Spline
    time: np.ndarray

    @cached_property
    def local(self) -> Local:
        """Functions that overlap at each time."""
        return self.spline.local(self.time)

    @cached_property
    def intervals(self) -> Intervals:
        """Grouping of the times by interval."""
        return Intervals(self.local.interval, self.spline.intervals)

    @cached_property
    def dealt(self) -> np.ndarray:
        """Values of the functions of each interval, and of their first two derivatives (S, m, 6, 3)."""
        return self.intervals.dealt(self.local.basis[:3].transpose(1, 2, 0))

    @property
    def matrix(self) -> sparse.csr_matrix:
        """Values of all functions at the times (N, size)."""
        places = self.local.interval[:, None] + np.arange(LOCAL)
        start, shape = LOCAL * np.arange(len(self.time) + 1), (len(self.time), self.spline.size)
        return sparse.csr_matrix((self.local.basis[0].ravel(), places.ravel(), start), shape)
