"""The resolution of a signal: the step to which a converter or the digits of a file quantize its samples.

The differences of neighbouring values of a quantized signal are multiples of the step. Those of any other signal are of
any size, down to rounding.
"""

from collections.abc import Iterable

import numpy as np

from ident.tolerances import NORMAL_MAD

UNIFORM = 1 / np.sqrt(12)
"""Standard deviation of the error of rounding to a step of one, which is uniformly distributed."""

REPEATED = 0.8
"""Share of the samples with repeated values above which single values (repaired, interpolated) are ignored: at a
resolution that is coarse relative to the range nearly all values are repeated."""

OFF = 0.15
"""Distance from an integer up to which a difference counts as a multiple of the step: values are rounded once more when
they are written in decimals or converted to other units."""

ON_LATTICE = 0.9
"""Least share of the differences that are multiples; of a signal without steps it is twice `OFF`."""

FAR = 10
"""Differences of at least this many steps are ignored: the error of the step is multiplied by their number."""

ENOUGH = 8
"""Least number of differences, so that they are not multiples by chance; one suffices if every value is repeated."""

MOST = 5000
"""Samples that are used at most: longer signals are thinned, because sorting them would be slow."""

CANDIDATES = 32
"""Number of candidates for the step: this many of the smallest differences, and as many quantiles of the lower half."""

ROUNDING = 1e-9
"""Difference of two values, relative to the largest one, up to which they differ by rounding only."""

RESTS, NOISE_ALONE = 1e-4, 1.2
"""A coordinate rests if its range is at most this share of the largest range of all, or its standard deviation is below
this multiple of that of its noise."""

FOURTH_DIFFERENCE = np.sqrt(70)
"""Standard deviation of the fourth difference of unit white noise, `√(1 + 16 + 36 + 16 + 1)`; that of motion is
negligible."""


def quantum(x: np.ndarray) -> float:
    """Resolution of a signal: the step of which its values are multiples, zero if none is detected.

    A step much finer than the spacing of the sampled values is not detected; it is far below the noise.

    Args:
        x: Samples, NaN where one is missing (N,).
    """
    x = x[:: max(1, len(x) // MOST)]
    values, counts = _distinct(x[np.isfinite(x)])
    again = counts > 1
    if counts[again].sum() > REPEATED * counts.sum():
        values, counts = values[again], counts[again]
    differences = np.sort(np.diff(values))
    if not len(differences):
        return 0.0
    fewest = 1 if (counts > 1).all() else ENOUGH
    tried = np.append(differences[:CANDIDATES], np.quantile(differences, np.linspace(0, 0.5, CANDIDATES)))
    for step in np.unique(tried)[::-1]:
        near = differences[: np.searchsorted(differences, FAR * step)]
        ratios = near / step
        steps = np.rint(ratios)
        on = (steps > 0) & (np.abs(ratios - steps) < OFF)
        if np.count_nonzero(on) >= max(fewest, ON_LATTICE * len(near)):
            return float(near[on].sum() / steps[on].sum())
    return 0.0


def quanta(columns: Iterable[np.ndarray]) -> np.ndarray:
    """The `quantum` of each of several signals."""
    return np.array([quantum(x) for x in columns])


def white_noise(*parts: np.ndarray, robust: bool = False) -> float:
    """Standard deviation of the white part of a signal's noise, by its fourth differences.

    Args:
        parts: Samples of each contiguous part of the signal, NaN where one is missing (N,).
        robust: True to use the median, which ignores a few jumps.
    """
    fourth = np.concatenate([np.diff(x[np.isfinite(x)], 4) for x in parts])
    if not len(fourth):
        return 0.0
    spread = NORMAL_MAD * np.median(np.abs(fourth)) if robust else fourth.std()
    return float(spread / FOURTH_DIFFERENCE)


def at_rest(x: np.ndarray, largest: float) -> bool:
    """True if a coordinate rests, to within its resolution or its noise.

    Args:
        x: Its samples, NaN where one is missing (N,).
        largest: Largest range of all coordinates.
    """
    x = x[np.isfinite(x)]
    if not len(x) or np.ptp(x) <= RESTS * largest:
        return True
    one_step = ((x == x.min()) | (x == x.max())).all()
    return bool(one_step or x.std() < NOISE_ALONE * white_noise(x))


def _distinct(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values that differ by more than rounding, ascending, and the number of samples with each."""
    values, counts = np.unique(x, return_counts=True)
    if not len(values):
        return values, counts
    apart = np.append(True, np.diff(values) > ROUNDING * max(np.abs(values[[0, -1]]).max(), 1e-300))
    return values[apart], np.add.reduceat(counts, np.flatnonzero(apart))
