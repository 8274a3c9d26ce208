"""Errors of estimates over many recordings, beside the standard deviations that the estimates state."""

from dataclasses import dataclass

import numpy as np

from ident.tolerances import INTERVAL


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of base parameters over many recordings.

    Attributes:
        names: Names of the parameters.
        errors: Error in each recording (recordings, parameters).
        predicted: Standard deviations that each estimate predicted from its recording (recordings, parameters).
    """

    names: tuple[str, ...]
    errors: np.ndarray
    predicted: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Mean error: the bias of the estimates."""
        return self.errors.mean(axis=0)

    @property
    def std(self) -> np.ndarray:
        """Spread of the errors."""
        return self.errors.std(axis=0, ddof=1)

    @property
    def interval(self) -> np.ndarray:
        """Limits of the central 95 % of the errors (2, parameters)."""
        return np.percentile(self.errors, [2.5, 97.5], axis=0)

    @property
    def predicted_std(self) -> np.ndarray:
        """Root mean square of the predicted standard deviations."""
        return np.sqrt(np.mean(self.predicted**2, axis=0))

    @property
    def covered(self) -> np.ndarray:
        """True where a recording's own 95 % interval holds the truth (recordings, parameters)."""
        return np.abs(self.errors) <= INTERVAL * self.predicted

    @property
    def coverage(self) -> np.ndarray:
        """Fraction of recordings whose own 95 % interval holds the truth."""
        return np.mean(self.covered, axis=0)


TRAJECTORY = "_trajectory"
"""Suffix of a model's name for its trajectory estimate."""


@dataclass(frozen=True, eq=False)
class Distribution(Errors):
    """Errors of one model's base parameters over the trials, and the paper's errors.

    Attributes:
        published: The paper's errors (parameters,).
    """

    published: np.ndarray

    @property
    def percentile(self) -> np.ndarray:
        """Percentiles of the paper's errors among the trials, at both limits of their rounding in print (2, p)."""
        low, high = self.published - 0.005, self.published + 0.005
        return 100 * np.array([np.mean(self.errors < limit, axis=0) for limit in (low, high)])


@dataclass(frozen=True, eq=False)
class Following:
    """Errors of simulated coordinates, by joint.

    Attributes:
        joints: Names of the joints.
        units: Their units, `rad` or `m`.
        before: RMS error of the model as it came (n,); NaN if its simulation diverged.
        after: RMS error of the updated model (n,).
        seconds: Simulated time, s.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    seconds: float

    @property
    def ratio(self) -> np.ndarray:
        """Error of the updated model over that of the model as it came (n,)."""
        return self.after / np.maximum(self.before, 1e-300)

    @property
    def better(self) -> int:
        """Number of joints that the updated model follows better."""
        return int((self.after < np.where(np.isnan(self.before), np.inf, self.before)).sum())
