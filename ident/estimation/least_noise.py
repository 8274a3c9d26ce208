"""Lower bound of each channel's noise, however well it is fitted: with less it would outweigh all others.

floor_c = max(LEAST · scale_c, step_c / √12)
"""

from collections.abc import Sequence

import numpy as np

from ident.estimation.channel_scales import channel_scales
from ident.recordings.resolution import UNIFORM, quanta

LEAST = 1e-3
"""Smallest noise of a channel over its scale; few sensors are as good as that."""


def least_noise(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Lower bound of the standard deviation of each channel's noise (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels.
    """
    return np.maximum(LEAST * channel_scales(parts, channels), rounding(parts))


def rounding(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of each stream's rounding error, from its smallest step (s,).

    Args:
        parts: The streams, in one piece or several, NaN where a sample is missing (N, s).
    """
    steps = np.array([quanta(part.T) for part in parts])
    smallest = np.where(steps > 0, steps, np.inf).min(axis=0)
    return np.where(np.isfinite(smallest), UNIFORM * smallest, 0.0)
