"""Spline functions at the times of samples, in the forms in which rows and linear responses use them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ident.trajectory.algebra.intervals import Intervals
from ident.trajectory.algebra.spline import LOCAL, Local, Spline


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

    @cached_property
    def matrices(self) -> list[sparse.csr_matrix]:
        """Values of all functions at the times, and of their first two derivatives (N, size) each."""
        N = len(self.time)
        places = (self.local.interval[:, None] + np.arange(LOCAL)).ravel()
        start = np.arange(0, LOCAL * N + 1, LOCAL)
        every = (basis.ravel() for basis in self.local.basis[:3])
        return [sparse.csr_matrix((values, places, start), shape=(N, self.spline.size)) for values in every]
