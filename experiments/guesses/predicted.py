"""Predictions of the model for columns taken as positions, and the share of other columns that they explain."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.guesses.log_contents import LogContents
from ident.estimation.loads import SLIP, predicted_channels
from ident.estimation.recorded_motion import joint_states
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.recordings.plausibility import rate_factor
from ident.recordings.smoothing import SETTLING, chosen_cutoff, low_pass, smoothed

ENOUGH = 300
"""Samples at which the model is evaluated, evenly spaced."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Columns low-passed by one filter, at the few samples at which the model is evaluated.

    Attributes:
        states: Values and both derivatives of columns that may be positions (3, M).
        levels: Values of all columns (M,).
    """

    states: Mapping[str, np.ndarray]
    levels: Mapping[str, np.ndarray]

    @property
    def size(self) -> int:
        """Number of samples M."""
        return len(next(iter(self.levels.values())))


def curves(contents: LogContents, positions: Iterable[str]) -> Curves:
    """Columns of a log at few samples, low-passed with the cut-off that suits possible positions.

    Raises:
        InputError: There are too few samples for a filter.
    """
    rate, names = contents.rate, list(positions)
    x = np.stack([contents.columns[name] for name in names], axis=1)
    cutoff = chosen_cutoff(x, rate)
    edge = min(int(SETTLING * rate / cutoff), len(x) // 10)
    taken = np.unique(np.linspace(edge, len(x) - 1 - edge, ENOUGH).astype(int))
    states = np.stack(smoothed(x, rate, cutoff))[:, taken]
    levels = {name: low_pass(y, rate, cutoff)[taken] for name, y in contents.columns.items()}
    return Curves({name: states[:, :, k] for k, name in enumerate(names)}, levels)


def is_rate(contents: LogContents, position: str, rate: str) -> bool:
    """True where a column may be the derivative of another, in any unit and of either sign."""
    size = abs(rate_factor(contents.time, contents.columns[position], contents.columns[rate]))
    return any(0.8 < size / unit < 1.25 for unit in (1.0, 180 / np.pi, np.pi / 180))


def prediction(mechanism: Mechanism, states: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Total wrench in the base frame and joint torques by channel (M,) each.

    Args:
        mechanism: The mechanism, with a prior.
        states: Position and both derivatives of each joint (3, M).
    """
    motion = Motion(*joint_states(mechanism.tree, np.stack(states, axis=-1)))
    return predicted_channels(mechanism, motion, np.eye(4), torques=True)


def unexplained(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Unexplained share of the variance of columns (M, k) in a regression on others (M,), gains and offsets free."""
    x = np.stack([np.ones(len(measured)), *predicted], axis=1)
    x = x / np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    left = measured - x @ np.linalg.lstsq(x, measured, rcond=1e-8)[0]
    whole = ((measured - measured.mean(axis=0)) ** 2).sum()
    return float((left**2).sum() / whole) if whole > 0 else 1.0


def explained(left: float) -> str:
    """Explained share of a variance as text, from the unexplained one."""
    return f"{100 * (1 - left):.0f} %"


def shares_of_torques(
    states: Mapping[str, np.ndarray], predicted: Mapping[str, np.ndarray], columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Share of each column's variance that a joint's predicted torque, friction and an offset do not explain.

    Args:
        states: Position and both derivatives of each joint (3, M).
        predicted: Predicted torques by joint (M,).
        columns: Columns (M,).

    Returns:
        Shares of all columns by joint (C,).
    """
    if not columns:
        return {joint: np.empty(0) for joint in states}
    measured, out = np.stack(list(columns.values()), axis=1), {}
    for joint, (_, dq, _) in states.items():
        rows = np.stack([np.ones_like(dq), dq, np.tanh(dq / SLIP)], axis=1)
        rows = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        both = np.column_stack([predicted[joint], measured])
        both = both - rows @ np.linalg.lstsq(rows, both, rcond=1e-8)[0]
        x, y = both[:, 0], both[:, 1:]
        power = np.maximum((x @ x) * (y * y).sum(axis=0), 1e-300)
        out[joint] = 1 - (x @ y) ** 2 / power
    return out


def beside_friction(states: np.ndarray, predicted: np.ndarray, measured: np.ndarray) -> float:
    """Share of a measured torque's variance (M,) that the predicted torque, friction and an offset do not explain."""
    return float(shares_of_torques({"": states}, {"": predicted}, {"": measured})[""][0])
