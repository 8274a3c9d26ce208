"""Outcomes of identifications of many logs, one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy import special

from ident.judgement.residuals import UNLIKELY


@dataclass(frozen=True, eq=False)
class LogAgreement:
    """Agreement of n logs in r parameters.

    Attributes:
        names: Names of the parameters that all logs have.
        difference: Each log's parameters less the mean of the other logs that agree (n, r).
        std: Standard deviations of these differences, times `spread` (n, r).
        chi2: Squared Mahalanobis distances, over `spread` squared (n,).
        spread: Differences between logs over those that their noise explains, 1 or more.
        differ: True for logs that differ from the others (n,).
    """

    names: tuple[str, ...]
    difference: np.ndarray
    std: np.ndarray
    chi2: np.ndarray
    spread: float
    differ: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Differences in their standard deviations (n, r)."""
        return self.difference / self.std

    @property
    def most(self) -> np.ndarray:
        """Parameters in descending order of what the logs that differ, or all if none does, differ by (r,)."""
        shown = self.z[self.differ] if self.differ.any() else self.z
        return np.argsort(-np.sqrt((shown**2).mean(axis=0)), kind="stable")


def agreement(values: Sequence[Mapping[str, float]], covariances: Sequence[np.ndarray]) -> LogAgreement | None:
    """Agreement of logs, None for fewer than two, or without a common parameter.

    Args:
        values: Parameters of each log by name.
        covariances: Covariance of these from the log's noise, in the same order.
    """
    names = tuple(name for name in (values[0] if values else ()) if all(name in each for each in values))
    if len(values) < 2 or not names:
        return None
    x = np.array([[each[name] for name in names] for each in values])
    which = [[list(each).index(name) for name in names] for each in values]
    covariance = np.array([C[np.ix_(k, k)] for C, k in zip(covariances, which, strict=True)])
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    precision = np.array([_inverse(each) for each in covariance])
    z2 = ((x - np.median(x, axis=0)) ** 2 / variances).mean(axis=1)
    agree = np.zeros(len(x), bool)
    agree[np.argsort(z2, kind="stable")[: (len(x) + 1) // 2]] = True
    # Trials with up to half of the logs set apart took three rounds.
    for _ in range(20):
        difference, spans, chi2 = _from_others(x, covariance, precision, agree)
        spread2 = max(1.0, float(np.median(chi2) / special.chdtri(len(names), 0.5)))
        before, agree = agree, special.chdtrc(len(names), chi2 / spread2) > UNLIKELY / len(x)
        if (agree == before).all() or not agree.any():
            break
    return LogAgreement(names, difference, np.sqrt(spread2 * spans), chi2 / spread2, float(np.sqrt(spread2)), ~agree)


def _from_others(
    x: np.ndarray, covariance: np.ndarray, precision: np.ndarray, agree: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Differences of logs from the others that agree (n, r), their variances (n, r), and χ² (n,)."""
    difference, variances, chi2 = np.zeros_like(x), np.zeros_like(x), np.zeros(len(x))
    every = np.arange(len(x))
    for k in every:
        # The only log that agrees is compared with all others.
        others = every[agree & (every != k)] if agree[every != k].any() else every[every != k]
        mean = _inverse(precision[others].sum(axis=0))
        difference[k] = x[k] - mean @ np.einsum("jab,jb->a", precision[others], x[others])
        variances[k] = np.diag(covariance[k] + mean)
        chi2[k] = difference[k] @ _inverse(covariance[k] + mean) @ difference[k]
    return difference, variances, chi2


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a covariance or precision (r, r), whose parameters may differ in size by many powers of ten."""
    size = np.sqrt(np.diag(matrix))
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    # Smaller ones of a correlation matrix are rounding.
    return np.asarray((vectors / np.maximum(eigenvalues, 1e-12)) @ vectors.T) / np.outer(size, size)


@dataclass(frozen=True)
class LogOutcome:
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


def spreads(outcomes: Sequence[LogOutcome]) -> list[Spread]:
    """Parameters over all logs that did not fail, in the order of their first occurrence."""
    names = dict.fromkeys(name for each in outcomes for name in each.values)
    return [_spread(name, [each for each in outcomes if name in each.values]) for name in names]


def _spread(name: str, outcomes: Sequence[LogOutcome]) -> Spread:
    """Spread of a parameter over logs that have it."""
    values = np.array([each.values[name] for each in outcomes])
    std = np.array([each.std[name] for each in outcomes])
    weights = 1 / np.maximum(std, 1e-300) ** 2
    mean, number = float(values @ weights / weights.sum()), len(values)
    between = float(values.std(ddof=1)) if number > 1 else np.nan
    # The mean follows the values, which takes a degree of freedom.
    z = float(np.sqrt(((values - mean) ** 2 * weights).sum() / (number - 1))) if number > 1 else np.nan
    return Spread(name, outcomes[0].units[name], number, mean, float(weights.sum() ** -0.5), between, z)
