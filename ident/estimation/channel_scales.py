"""Scale of each channel in weights and ratios: the spread of its signal, or that of its kind where it is flat.

A flat channel has no scale of its own: its weight would be infinite. Where a whole kind is flat, the largest spread of
all channels replaces it, and 1 where all are flat.
"""

from collections.abc import Sequence

import numpy as np

from ident.estimation.equations import COMPONENTS

FLAT, FLAT_TORQUE = 1e-3, 1e-6
"""Spread relative to the largest of its kind up to which a channel is flat: a force or a moment, which share a sensor,
and a joint torque, of which a finger's is a thousandth of a hip's."""


def channel_scales(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Scale of each channel of a signal, positive (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels.
    """
    every = np.concatenate(parts)
    spread = np.zeros(len(channels))
    there = np.isfinite(every).any(axis=0)
    spread[there] = np.nanstd(every[:, there], axis=0)
    return beside_others(spread, channels)


def beside_others(spread: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Spreads (C,), those of flat channels replaced by the largest of their kind: forces, moments, joint torques."""
    kinds = np.array([name[0] if name in COMPONENTS else "" for name in channels])
    of_all = float(spread.max(initial=0.0)) or 1.0
    largest = np.array([spread[kinds == kind].max() or of_all for kind in kinds])
    return np.where(spread <= np.where(kinds == "", FLAT_TORQUE, FLAT) * largest, largest, spread)
