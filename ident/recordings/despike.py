"""Removal of gross outliers of a recording before a filter spreads them."""

import numpy as np

from ident.recordings.resolution import UNIFORM, quantum
from ident.recordings.runs import running_median, runs
from ident.tolerances import NORMAL_MAD

WINDOW = 11
"""Samples of the running median."""

GROSS = 8.0
"""Multiple of the typical deviation from the running median beyond which a sample is an outlier, if it also exceeds
the channel's own spread."""

ISOLATED = 2
"""Longest run of samples that counts as an outlier; an impact lasts longer."""


def despiked(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Channels with their isolated gross outliers interpolated (Hampel's filter).

    A step of the resolution is no outlier, not even in a channel that is constant for a while.

    Args:
        x: Channels (N, C); those with NaN stay as they are.

    Returns:
        The channels (N, C), and the number of samples replaced in each (C,).
    """
    out, counts = np.array(x, float), np.zeros(x.shape[1], int)
    for c in np.flatnonzero(np.isfinite(out).all(axis=0)):
        bad = _isolated(_gross(out[:, c]))
        counts[c] = bad.sum()
        if bad.any() and not bad.all():
            out[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), out[~bad, c])
    return out, counts


def _gross(x: np.ndarray) -> np.ndarray:
    """Mask of the samples of a channel that are far from the running median (N,)."""
    deviation = np.abs(x - running_median(x, WINDOW))
    usual = max(np.median(deviation), UNIFORM * quantum(x))
    least = NORMAL_MAD * max(GROSS * usual, np.median(np.abs(x - np.median(x))))
    # The typical deviation around a sample matters for few of them, and takes most of the time.
    out = deviation > least
    far = np.flatnonzero(out)
    out[far] = deviation[far] > NORMAL_MAD * GROSS * running_median(deviation, 5 * WINDOW, far)
    return out


def _isolated(samples: np.ndarray) -> np.ndarray:
    """Mask without its longer runs (N,)."""
    out = samples.copy()
    for first, end in runs(samples):
        out[first:end] = end - first <= ISOLATED
    return out
