"""The resolution of a signal: the distance of the lattice that a converter or the digits of a file put its samples on.

A lattice shows in the differences of neighbouring values: they are whole multiples of its distance. A signal that is
not on one has differences of any size, down to rounding.
"""

from collections.abc import Iterable

import numpy as np

from ident.tolerances import NORMAL_MAD

UNIFORM = 1 / np.sqrt(12)
"""Standard deviation of an error that is anything within a step of one: that of rounding to a lattice."""

REPEATED = 0.8
"""Share of the samples whose value has to occur again from which values that do not (repaired, interpolated) do not
count: on a lattice that is coarse beside the range nearly all values do."""

OFF = 0.15
"""Distance from a whole number up to which a difference is taken for a multiple: values are rounded once more where
they are written in decimals or converted to other units."""

ON_LATTICE = 0.9
"""Share of the differences that have to be multiples; of a signal on no lattice twice `OFF` are."""

FAR = 10
"""Differences of more steps say nothing: the error of the step is multiplied by their number."""

ENOUGH = 8
"""Differences from which a lattice cannot be chance; fewer suffice where every value occurs again."""

MOST = 5000
"""Samples that are looked at: every second, third, … one of a longer signal, which sorting would be slow for."""

CANDIDATES = 32
"""Differences that are tried for the step: so many of the smallest, and so many quantiles of the smaller half."""

ROUNDING = 1e-9
"""Difference of two values, of the largest one, up to which they are the same but for rounding."""

RESTS, NOISE_ALONE = 1e-4, 1.2
"""Range of a coordinate, over the largest of all, up to which it rests; and its standard deviation up to which it does,
over that of its noise, beside which a motion does not show."""

FOURTH_DIFFERENCE = np.sqrt(70)
"""Standard deviation of the fourth difference of unit white noise, `√(1 + 16 + 36 + 16 + 1)`; motion hardly has one."""


def quantum(x: np.ndarray) -> float:
    """Distance of the lattice that the samples of a signal lie on, zero where there is none to be seen.

    A lattice that is far finer than samples are dense on it is not seen, nor does it matter: it is far finer than the
    noise.

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
        near = differences[differences < FAR * step]
        steps = np.round(near / step)
        on = (steps > 0) & (np.abs(near / step - steps) < OFF)
        if on.sum() >= max(fewest, ON_LATTICE * len(near)):
            return float(near[on].sum() / steps[on].sum())
    return 0.0


def quanta(columns: Iterable[np.ndarray]) -> np.ndarray:
    """The `quantum` of each of several signals."""
    return np.array([quantum(x) for x in columns])


def white_noise(*parts: np.ndarray, robust: bool = False) -> float:
    """Standard deviation of the white part of a signal's noise, by its fourth differences.

    Args:
        parts: Samples of each stretch of the signal, NaN where one is missing (N,).
        robust: True to set few jumps aside.
    """
    fourth = np.concatenate([np.diff(x[np.isfinite(x)], 4) for x in parts])
    if not len(fourth):
        return 0.0
    spread = NORMAL_MAD * np.median(np.abs(fourth)) if robust else fourth.std()
    return float(spread / FOURTH_DIFFERENCE)


def at_rest(x: np.ndarray, largest: float) -> bool:
    """True where a coordinate rests, to within its resolution or its noise.

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
    """Values that differ by more than rounding, ascending, and how many samples have each."""
    values, counts = np.unique(x, return_counts=True)
    if not len(values):
        return values, counts
    apart = np.append(True, np.diff(values) > ROUNDING * max(np.abs(values[[0, -1]]).max(), 1e-300))
    return values[apart], np.add.reduceat(counts, np.flatnonzero(apart))
