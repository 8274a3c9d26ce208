"""Errors of models that are simulated with recorded commands, against the recorded joint coordinates."""

from dataclasses import dataclass

import numpy as np


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
