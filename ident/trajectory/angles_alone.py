"""Motion smoothed from joint angles alone, from which all candidates predict held-out samples.

    minimise  Σ_k (x_k - s(t_k))² + r T⁶ ∫ s⃛² dt,      gain at frequency f:  1 / (1 + (2 π f T)⁶)

over splines s, with r samples per second. T is the same for all coordinates, like the cut-off of a usual filter.
The likeliest smoothness of each coordinate, with white-noise jerk, is no substitute: it leaves accelerations too rough
for any parameters to predict well.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import linalg, sparse, special

from ident.recordings.smoothing import GROSS, longest_step, running_median
from ident.recordings.times import Sampled
from ident.tolerances import NORMAL_MAD
from ident.trajectory.algebra.spline import LOCAL, ORDER, Sampling, Spline

PASSES = 4
"""Largest number of smoothing passes: small outliers show once large ones are removed."""

MOST = 0.9
"""Quantile of the samples by which noise is scaled, high because most may be of a resting joint."""

AROUND = 15
"""Samples around an outlier, of which most deviate little. Without noise all near a heel strike deviate by many times
the usual: of two people who walk, 232 and 163 of 7000 samples were left out for the quantile alone, now none, and 667
of 692 outliers put in still are."""

UNSETTLED, LARGEST_END = 0.3, 1 / 6
"""Time at either end of a stretch that is not judged, s, as accelerations there depend on angles on one side only; and
its largest share of a short stretch."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Coordinates as functions of time, on stretches between gaps.

    Attributes:
        splines: Spline space of each stretch.
        coefficients: Spline coefficients of each stretch (size, n).
    """

    splines: Sequence[Spline]
    coefficients: Sequence[np.ndarray]

    @property
    def spans(self) -> np.ndarray:
        """First and last times of the stretches, s (k, 2)."""
        return np.array([(spline.start, spline.start + spline.intervals * spline.step) for spline in self.splines])

    def evaluate(self, time: np.ndarray) -> np.ndarray:
        """Coordinates and first three derivatives (4, M, n); in gaps and beyond the ends, values of the nearest end."""
        starts, ends = self.spans.T
        which = np.searchsorted((ends[:-1] + starts[1:]) / 2, time)
        out = np.empty((4, len(time), self.coefficients[0].shape[1]))
        for k, (spline, c) in enumerate(zip(self.splines, self.coefficients, strict=True)):
            own = which == k
            out[:, own] = spline.evaluate(c, np.clip(time[own], starts[k], ends[k]))
        return out

    def settled(self, time: np.ndarray) -> np.ndarray:
        """Mask of the times within a stretch, except its ends (M,)."""
        first, last = self.spans.T[..., None]
        edges = np.minimum(UNSETTLED, LARGEST_END * (last - first))
        return np.asarray(((time > first + edges) & (time < last - edges)).any(axis=0))


def smoothed(coordinates: Sampled, T: float) -> Trajectory:
    """Each coordinate smoothed, separately on either side of a gap.

    Args:
        coordinates: Samples of all coordinates, NaN where one is missing (N, n).
        T: Time constant of the filter, s.
    """
    splines, coefficients = [], []
    for part in _stretches(coordinates):
        time = coordinates.time[part]
        spline = Spline.over(time[0], time[-1], T)
        penalty = T**6 / (time[-1] - time[0]) * (spline.roots.T @ spline.roots)
        splines.append(spline)
        coefficients.append(_without_outliers(coordinates.values[part], Sampling(spline, time).matrix, penalty))
    return Trajectory(splines, coefficients)


def _stretches(coordinates: Sampled) -> list[slice]:
    """Stretches of samples between gaps, those in which each coordinate has more samples than the penalty needs."""
    time, there = coordinates.time, np.isfinite(coordinates.values)
    inside = np.ones(len(time), bool)
    for own in there.T:
        at = np.flatnonzero(own)
        reach = longest_step(Sampled(time[at], time[at]))
        for gap in np.flatnonzero(np.diff(time[at]) > reach):
            inside[at[gap] + 1 : at[gap + 1] + 1] = False
    parts = [slice(a, b) for a, b in pairwise([0, *np.flatnonzero(~inside).tolist(), len(time)])]
    return [part for part in parts if there[part].sum(axis=0).min() > ORDER] or [slice(0, len(time))]


def _without_outliers(x: np.ndarray, basis: sparse.csr_matrix, penalty: sparse.csr_matrix) -> np.ndarray:
    """Coefficients of coordinates (size, n), fitted without gross outliers among their samples (N, n).

    Args:
        x: The samples, NaN where one is missing (N, n).
        basis: Spline functions at the samples (N, size).
        penalty: Penalty of one sample (size, size).
    """
    there, c = np.isfinite(x), np.empty((basis.shape[1], x.shape[1]))
    number, left = there.sum(axis=0), list(range(x.shape[1]))
    for _ in range(PASSES):
        # Coordinates of the same samples share their equations.
        alike, again = defaultdict[tuple[int, bytes], list[int]](list), list[int]()
        for j in left:
            alike[number[j], there[:, j].tobytes()].append(j)
        for (count, _), own in alike.items():
            at = np.flatnonzero(there[:, own[0]])
            rows, y = basis if len(at) == len(x) else basis[at], x[at[:, None], own]
            normal = rows.T @ rows + max(count - 1, 1) * penalty
            band = np.stack([np.pad(normal.diagonal(-k), (0, k)) for k in range(LOCAL)])
            c[:, own] = linalg.solveh_banded(band, rows.T @ y, lower=True)
            outliers = _outliers(y - rows @ c[:, own])
            there[at[:, None], own] = ~outliers
            again += np.array(own)[outliers.any(axis=0)].tolist()
        left = again
    return c


def _outliers(residual: np.ndarray) -> np.ndarray:
    """Mask of samples that deviate grossly from the mean of their neighbours, and more than samples around (N, n).

    Residuals next to an outlier and near a corner are smooth, so neither is masked.
    """
    out, size = np.zeros(residual.shape, bool), np.abs(residual[1:-1] - (residual[:-2] + residual[2:]) / 2)
    if len(size):
        beside = np.pad(size, ((1, 1), (0, 0)))
        out[1:-1] = size > GROSS / special.ndtri((1 + MOST) / 2) * np.quantile(size, MOST, axis=0)
        out[1:-1] &= size >= np.maximum(beside[:-2], beside[2:])
    for j in np.flatnonzero(out.any(axis=0)):
        at = np.flatnonzero(out[1:-1, j])
        out[1 + at, j] = size[at, j] > GROSS * NORMAL_MAD * running_median(size[:, j], AROUND, at)
    return out
