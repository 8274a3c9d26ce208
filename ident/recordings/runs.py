"""Runs of samples, and running medians: a few lines of numpy each, where scipy.ndimage takes long to import."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

AT_ONCE = 1_000_000
"""Numbers of all windows that are in memory at the same time."""


def runs(samples: np.ndarray) -> np.ndarray:
    """First samples and ends of the runs of true samples in a mask (N,), in order (k, 2)."""
    edges = np.diff(np.concatenate([[False], samples, [False]]).astype(np.int8))
    return np.stack([np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)], axis=1)


def running_median(x: np.ndarray, width: int, at: np.ndarray | None = None) -> np.ndarray:
    """Medians of the windows around samples (N,), or around those `at` indices (n,), beyond the ends of the end values.

    Args:
        x: Samples (N,).
        width: Samples of a window; one of even width begins a sample earlier, and gives the larger middle value.
        at: Indices of the windows' samples; by default all.
    """
    middle = width // 2
    windows = sliding_window_view(np.pad(x, (middle, width - middle - 1), mode="edge"), width)
    wanted = np.arange(len(x)) if at is None else at
    out = np.empty(len(wanted))
    step = max(1, AT_ONCE // width)
    for first in range(0, len(wanted), step):
        part = slice(first, first + step)
        out[part] = np.partition(windows[wanted[part]], middle, axis=1)[:, middle]
    return out
