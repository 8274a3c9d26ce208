"""Results of the validation on public recordings of real systems."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from experiments.data.errors import HALF_WIDTH
from experiments.data.registry import Entry, Published

MODEL, LEAST_SQUARES, ESTIMATE = "model", "least squares", "estimate"
CANDIDATES = {MODEL: "model as it came", LEAST_SQUARES: "least squares", ESTIMATE: "trajectory estimate"}
"""Candidates that predict the held-out part, by the names of their ratios."""

WORSE = 1.05
"""Ratio of two held-out residuals above which a prediction is worse than another one."""


@dataclass(frozen=True, eq=False)
class Values:
    """Estimated base parameters and drives.

    Attributes:
        names: Their names.
        values: Estimates, SI units (p,).
        std: Standard deviations from the noise (p,).
        std_setup: Standard deviations with the uncertainty of the set-up (p,).
        prior: Standard deviations of the prior, infinite without one (p,).
        units: Units.
    """

    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    std_setup: np.ndarray
    prior: np.ndarray
    units: tuple[str, ...] = ()

    @classmethod
    def of(cls, entries: Mapping[str, Any]) -> "Values":
        """The values from their JSON form."""
        numbers = {key: np.array(entries[key], float) for key in ("values", "std", "std_setup", "prior")}
        numbers["prior"] = np.where(np.isnan(numbers["prior"]), np.inf, numbers["prior"])
        return cls(names=tuple(entries["names"]), units=tuple(entries.get("units", ())), **numbers)

    def __getitem__(self, name: str) -> tuple[float, float, float]:
        """Estimate of a parameter, its standard deviation, and that with the set-up."""
        k = self.names.index(name)
        return float(self.values[k]), float(self.std[k]), float(self.std_setup[k])

    @property
    def from_data(self) -> np.ndarray:
        """Mask of the parameters on which the recording says more than the prior (p,)."""
        return self.std_setup < self.prior / np.sqrt(2)


@dataclass(frozen=True, eq=False)
class Validation:
    """Results of one recording.

    Attributes:
        entry: The recording.
        values: Base parameters and drives of the trajectory estimate.
        rivals: Base parameters and drives of other candidates, by name (p,).
        channels: Names of the channels.
        units: Units of the channels.
        ratios: Held-out residual over signal by candidate (C,).
        halves: Differences of the two halves' base parameters in their standard deviations from the noise (r,).
        widening: Factor on those deviations because of the halves.
        trials: Estimates of each trial alone, by its name.
        outcome: Decision of the verdict.
        verdict: The verdict in words.
        doubts: Codes of its doubts.
        samples: Numbers of fitted and of held-out samples.
        cutoff: Chosen cut-off of least squares, Hz; None without one.
        seconds: CPU time of the identification, s.
        unchecked: Names of files that no hash of the registry was compared with.
    """

    entry: Entry
    values: Values
    rivals: Mapping[str, np.ndarray]
    channels: tuple[str, ...]
    units: tuple[str, ...]
    ratios: Mapping[str, np.ndarray]
    halves: np.ndarray
    widening: float
    trials: Mapping[str, Values]
    outcome: str
    verdict: str
    doubts: tuple[str, ...]
    samples: tuple[int, int]
    cutoff: float | None
    seconds: float
    unchecked: tuple[str, ...] = ()

    @property
    def best_other(self) -> np.ndarray:
        """Ratio of the better one of the other candidates (C,)."""
        return np.min([self.ratios[name] for name in (MODEL, LEAST_SQUARES) if name in self.ratios], axis=0)

    @property
    def explained(self) -> np.ndarray:
        """Mask of the channels that some candidate explains (C,)."""
        return np.min(list(self.ratios.values()), axis=0) <= 1

    @property
    def against_best(self) -> np.ndarray:
        """Ratio of the estimate's residual to that of the best other candidate, in the explained channels."""
        return (self.ratios[ESTIMATE] / self.best_other)[self.explained]

    @property
    def trial_z(self) -> np.ndarray:
        """Differences between trials identified alone, in their standard deviations with the set-up.

        Of each pair of trials and each parameter on which both say more than the prior.
        """
        out = list[float]()
        for a, b in combinations(self.trials.values(), 2):
            shared = [name for name in a.names if name in b.names]
            i, j = ([each.names.index(name) for name in shared] for each in (a, b))
            z = (a.values[i] - b.values[j]) / np.hypot(a.std_setup[i], b.std_setup[j])
            out += z[a.from_data[i] & b.from_data[j]].tolist()
        return np.array(out)

    @property
    def alike_z(self) -> np.ndarray:
        """Differences of parameters that are equal by construction, in their standard deviations with the set-up."""
        pairs = [pair for group in self.entry.alike for pair in combinations(group, 2)]
        return np.array([_z(*self.values[a][::2], *self.values[b][::2]) for a, b in pairs])

    def published_z(self, published: Published) -> float:
        """Estimate less published value in their standard deviations."""
        value, _, std = self.values[published.name]
        return _z(value, std, published.value, published.std)


def _z(a: float, std_a: float, b: float, std_b: float) -> float:
    """Difference in standard deviations; one that is NaN counts as zero."""
    return (a - b) / float(np.hypot(std_a, np.nan_to_num(std_b)))


def inside(z: np.ndarray) -> float:
    """Share of the differences inside their 95 % intervals; NaN without any."""
    return float((np.abs(z) <= HALF_WIDTH).mean()) if len(z) else float("nan")


def rms(z: np.ndarray) -> float:
    """Root mean square; NaN without any."""
    return float(np.sqrt((z**2).mean())) if len(z) else float("nan")


@dataclass(frozen=True, eq=False)
class Study:
    """Results of all recordings.

    Attributes:
        validations: Results by name.
        refused: Sentences on recordings without results, by name.
        untried: Entries that have never been run.
    """

    validations: Mapping[str, Validation]
    refused: Mapping[str, str]
    untried: tuple[Entry, ...] = ()

    def __iter__(self) -> Iterator[Validation]:
        """Results in their order."""
        return iter(self.validations.values())

    @property
    def against_best(self) -> np.ndarray:
        """Ratios of the estimate's residual to that of the best other candidate, in all explained channels."""
        return np.concatenate([each.against_best for each in self] or [np.zeros(0)])

    @property
    def trial_z(self) -> np.ndarray:
        """Differences between two recordings of one system, of all parameters, in their standard deviations."""
        return np.concatenate([each.trial_z for each in self] or [np.zeros(0)])
