"""Bodies that fix the scale of torques, because the user knows them better than the others: a payload that was weighed.

A body counts if the standard deviation of a scale grows notably once the body is only known as the others are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import known_covariance
from ident.trajectory.fit.precision import inverse_of_precision
from ident.trajectory.result import TrajectoryEstimate

HALF = np.sqrt(2)
"""Factor on the standard deviation of a scale from which a body fixes it: it brings half of the information."""


def fixing_bodies(estimate: TrajectoryEstimate, mechanism: Mechanism, known: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the bodies whose own deviations fix the scales of torques.

    Args:
        estimate: The trajectory estimate, with a prior.
        mechanism: The mechanism, with the deviations of these bodies.
        known: Standard deviations of the other bodies.
    """
    better = [name for name, own in mechanism.prior_known.items() if own.get("mass", known["mass"]) < known["mass"]]
    if not better:
        return ()
    with_all = _scale_deviations(estimate, mechanism, known)
    out = []
    for name in better:
        own = {other: each for other, each in mechanism.prior_known.items() if other != name}
        without = _scale_deviations(estimate, replace(mechanism, prior_known=own), known)
        if (without > HALF * with_all).any():
            out.append(name)
    return tuple(out)


def _scale_deviations(estimate: TrajectoryEstimate, mechanism: Mechanism, known: Mapping[str, float]) -> np.ndarray:
    """Standard deviations of the scales of torques with a prior of the bodies (k,)."""
    fit, parameters = estimate.fit, estimate.measurement.equations.parameters
    rank, precision = parameters.rank, fit.precision.copy()
    prior = inverse_of_precision(known_covariance(mechanism, parameters, known))
    precision[:rank, :rank] += fit.prior.weight * prior - fit.prior.precision[:rank, :rank]
    free = np.flatnonzero(fit.free)
    variances = np.diag(inverse_of_precision(precision[np.ix_(free, free)]))
    return np.sqrt(variances[np.isin(free, _scales(estimate, free))])


def _scales(estimate: TrajectoryEstimate, free: np.ndarray) -> Sequence[int]:
    """Those of some parameters that are scales of torques, by index."""
    return [k for k in free.tolist() if k in estimate.setup and estimate.setup[k].row.stated]
