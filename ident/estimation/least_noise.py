"""Lower bound of each channel's noise, however well it is fitted: with less it would outweigh all others.

    floor_c = max(LEAST · spread_c, step_c / √12)

A flat channel is given the largest spread of its kind.
"""

from collections.abc import Sequence

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.recordings.resolution import UNIFORM, quanta

LEAST = 1e-3
"""Smallest noise of a channel over its spread; few sensors are as good as that."""

FLAT = 1e-6
"""Spread of a joint torque, relative to the largest, up to which it is flat: a finger's is a thousandth of a hip's."""


def least_noise(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Lower bound of the standard deviation of each channel's noise (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels.
    """
    every = np.concatenate(parts)
    spread = np.zeros(len(channels))
    there = np.isfinite(every).any(axis=0)
    spread[there] = np.nanstd(every[:, there], axis=0)
    return np.maximum(LEAST * _beside_others(spread, channels), rounding(parts))


def rounding(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of each stream's rounding error, from its smallest step (s,).

    Args:
        parts: The streams, in one piece or several, NaN where a sample is missing (N, s).
    """
    steps = np.array([quanta(part.T) for part in parts])
    smallest = np.where(steps > 0, steps, np.inf).min(axis=0)
    return np.where(np.isfinite(smallest), UNIFORM * smallest, 0.0)


def _beside_others(spread: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Spreads (C,), those of flat channels replaced by the largest of their kind: forces, moments, joint torques."""
    kinds = np.array([name[0] if name in COMPONENTS else "" for name in channels])
    largest = np.array([spread[kinds == kind].max() for kind in kinds])
    return np.where(spread <= np.where(kinds == "", FLAT, LEAST) * largest, largest, spread)
