"""Removal of gross outliers of a recording before a filter spreads them."""

import numpy as np
from scipy.ndimage import label, median_filter

from ident.recordings.resolution import UNIFORM, quantum
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
        deviation = np.abs(out[:, c] - median_filter(out[:, c], WINDOW, mode="nearest"))
        usual = max(np.median(deviation), UNIFORM * quantum(out[:, c]))
        typical = np.maximum(median_filter(deviation, 5 * WINDOW, mode="nearest"), usual)
        spread = np.median(np.abs(out[:, c] - np.median(out[:, c])))
        runs, _ = label(deviation > NORMAL_MAD * np.maximum(GROSS * typical, spread))
        bad = (runs > 0) & (np.bincount(runs)[runs] <= ISOLATED)
        counts[c] = bad.sum()
        if bad.any() and not bad.all():
            out[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), out[~bad, c])
    return out, counts
