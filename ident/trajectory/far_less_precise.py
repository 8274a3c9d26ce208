"""Prior of the model's parameters, used where the data alone are far less precise: noise can pass for excitation."""

from collections.abc import Mapping

import numpy as np

from ident.estimation.equations import Equations
from ident.parameters.prior import drive_precision, known_covariance
from ident.trajectory.fit.fitted import TrajectoryFit

FAR_LESS = 30.0
"""Standard deviations from the data, over those of the prior, above which the prior is used."""


def far_less_precise(
    fit: TrajectoryFit, equations: Equations, known: Mapping[str, float], *, used: float = 1.0
) -> bool:
    """True if a fit without a prior is far less precise than the prior would be, in any of the columns.

    Args:
        fit: The fit.
        equations: Its columns.
        known: Standard deviations of the model's φ, as for `known_deviations`.
        used: Share of the recordings that was fitted: all of them give variances smaller by as much.
    """
    beforehand = np.diag(known_covariance(equations.mechanism, equations.parameters, known))
    of_drives = drive_precision(equations.mechanism, equations.drives, equations.scaled)
    precision = np.r_[1 / beforehand, of_drives]
    return bool((used * np.diag(fit.covariance)[: len(precision)] * precision > FAR_LESS**2).any())
