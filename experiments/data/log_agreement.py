"""Agreement of logs that were identified one by one: the logs that differ from the others, and in which parameters.

The estimate ψ_k of each log, of covariance P_k⁻¹ from its noise, is compared with the others' weighted mean:

    d_k = ψ_k - μ_k,    μ_k = (Σ_j P_j)⁻¹ Σ_j P_j ψ_j,    χ²_k = d_kᵀ (P_k⁻¹ + (Σ_j P_j)⁻¹)⁻¹ d_k / s²

over the logs j ≠ k that agree, which are found by repetition from the half nearest the median. s² ≥ 1 is the median of
the logs' χ² over that of the distribution, so that what all logs differ by does not set one of them apart. The set-up's
uncertainty is left out: logs of one rig share its errors, and it would hide a load. (Of 20 logs of an arm, five with
0.15 kg on a link of 1.2 kg, χ² names these five; with the set-up's uncertainty in each covariance it names three.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

UNLIKELY = 0.01
"""Chance that one of the logs is called different where nothing but noise differs."""

ROUNDS = 20
"""Largest number of repetitions; trials with up to half of the logs set apart took three."""

TINY = 1e-12
"""Least eigenvalue of a correlation matrix, below which it is rounding."""


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
    for _ in range(ROUNDS):
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
    return np.asarray((vectors / np.maximum(eigenvalues, TINY)) @ vectors.T) / np.outer(size, size)
