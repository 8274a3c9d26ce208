"""What the model predicts for columns taken as positions, and how much of other columns that explains."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.guesses.seen import Seen
from ident.estimation.measurement import joint_states
from ident.estimation.preparation import predicted_channels
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.recordings.smoothing import SETTLING, chosen_cutoff, low_pass, smoothed

ENOUGH = 300
"""Samples at which the model is asked, evenly spread."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Columns low-passed alike, at the few samples at which the model is asked.

    Attributes:
        states: Values and both derivatives of columns that may be positions (3, M).
        levels: Values of all columns (M,).
    """

    states: Mapping[str, np.ndarray]
    levels: Mapping[str, np.ndarray]


def curves(seen: Seen, positions: Iterable[str]) -> Curves:
    """Columns of a log at few samples, low-passed as those that may be positions ask for.

    Raises:
        InputError: There are too few samples for a filter.
    """
    rate, names = seen.rate, list(positions)
    x = np.stack([seen.columns[name] for name in names], axis=1)
    cutoff = chosen_cutoff(x, rate)
    edge = min(int(SETTLING * rate / cutoff), len(x) // 10)
    taken = np.unique(np.linspace(edge, len(x) - 1 - edge, ENOUGH).astype(int))
    states = np.stack(smoothed(x, rate, cutoff))[:, taken]
    levels = {name: low_pass(y, rate, cutoff)[taken] for name, y in seen.columns.items()}
    return Curves({name: states[:, :, k] for k, name in enumerate(names)}, levels)


def prediction(mechanism: Mechanism, states: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Total wrench in the base frame and joint torques by channel (M,) each.

    Args:
        mechanism: The mechanism, with a prior.
        states: Position and both derivatives of each joint (3, M).
    """
    motion = Motion(*joint_states(mechanism.tree, np.stack(states, axis=-1)))
    return predicted_channels(mechanism, motion, np.eye(4), torques=True)


def unexplained(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Share of the variance of some columns (M, k) that remains beside others (M,), whatever gains and offsets are."""
    x = np.stack([np.ones(len(measured)), *predicted], axis=1)
    x = x / np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    left = measured - x @ np.linalg.lstsq(x, measured, rcond=1e-8)[0]
    whole = ((measured - measured.mean(axis=0)) ** 2).sum()
    return float((left**2).sum() / whole) if whole > 0 else 1.0
