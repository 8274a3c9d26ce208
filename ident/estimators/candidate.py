"""A candidate: parameters that predict held-out channels, of whatever origin."""

from dataclasses import dataclass

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.loads import stated_drive_channels
from ident.estimation.samples import Samples


@dataclass(frozen=True, eq=False)
class Candidate:
    """Parameters that predict channels.

    Attributes:
        equations: Equations of m columns and C channels.
        values: Coefficients for all recordings to judge by, or for each (1 or J, m).
        stated_drives: True to add the drives as the model states them.
    """

    equations: Equations
    values: np.ndarray
    stated_drives: bool = False

    @classmethod
    def model(cls, equations: Equations, samples: Samples) -> "Candidate":
        """The model as it came: its prior and the drives that it states, with mean residuals of samples as offsets."""
        prior = equations.parameters.regroup(equations.mechanism.known)
        values = np.r_[prior, np.zeros(len(equations.names) - len(prior))]
        model = cls(equations, values[None], stated_drives=True)
        if equations.offsets:
            values[-len(equations.offsets) :] = model.residuals(samples)[0].mean(axis=0)[list(equations.offsets)]
        return model

    def residuals(self, samples: Samples) -> np.ndarray:
        """Measured less predicted channels for each row of values (1 or J, N, C)."""
        left = self.equations.residual(samples, self.values)
        return left - stated_drive_channels(self.equations, samples.motion) if self.stated_drives else left
