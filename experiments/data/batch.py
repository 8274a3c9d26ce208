"""Outcomes of identifications of many logs, one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Outcome:
    """Outcome of one log.

    Attributes:
        log: Its name.
        folder: Name of the folder with its results; empty if it failed.
        verdict: Outcome of the verdict, as of `ident.judgement.verdict.Outcome`; empty if it failed.
        doubts: Codes of the findings against the estimate.
        predicted: Channels that it predicts.
        missed: Channels that count and that it does not predict.
        ratios: Held-out residual over signal by channel.
        values: Base parameters and drives by name.
        std: Their standard deviations with the uncertainty of the set-up, by name.
        units: Their units, by name.
        seconds: CPU time, s.
        error: The sentence with which it failed; empty if it did not.
        files: SHA-256 sums of the files in its folder, by name.
    """

    log: str
    folder: str = ""
    verdict: str = ""
    doubts: Sequence[str] = ()
    predicted: Sequence[str] = ()
    missed: Sequence[str] = ()
    ratios: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    error: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """All of it in JSON's types."""
        return asdict(self)


@dataclass(frozen=True)
class Spread:
    """A parameter over several logs.

    Attributes:
        name: Its name.
        unit: Its unit.
        logs: Number of logs that have it.
        mean: Mean, weighted by the inverse variances.
        std: Standard deviation of that mean, if the logs' own deviations are right.
        between: Standard deviation between the logs.
        rms_z: Root mean square deviation from the mean over the logs' own deviations, about 1 if these are right; NaN
            for a single log.
    """

    name: str
    unit: str
    logs: int
    mean: float
    std: float
    between: float
    rms_z: float


def spreads(outcomes: Sequence[Outcome]) -> list[Spread]:
    """Parameters over all logs that did not fail, in the order of their first occurrence."""
    names = dict.fromkeys(name for each in outcomes for name in each.values)
    return [_spread(name, [each for each in outcomes if name in each.values]) for name in names]


def _spread(name: str, outcomes: Sequence[Outcome]) -> Spread:
    """Spread of a parameter over logs that have it."""
    values = np.array([each.values[name] for each in outcomes])
    std = np.array([each.std[name] for each in outcomes])
    weights = 1 / np.maximum(std, 1e-300) ** 2
    mean, number = float(values @ weights / weights.sum()), len(values)
    between = float(values.std(ddof=1)) if number > 1 else np.nan
    # The mean follows the values, which takes a degree of freedom.
    z = float(np.sqrt(((values - mean) ** 2 * weights).sum() / (number - 1))) if number > 1 else np.nan
    return Spread(name, outcomes[0].units[name], number, mean, float(weights.sum() ** -0.5), between, z)
