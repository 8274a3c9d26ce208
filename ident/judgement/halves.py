"""Whether parts of what was fitted agree: each part's own estimate from its share of the equations, to first order.

    δ_k = P_k⁻¹ g_k,        cov(δ_1 - δ_2) = P_1⁻¹ + P_2⁻¹

P_k and g_k are the precision and the right side of a part at the estimate, its trajectory eliminated.
"""

import numpy as np

from ident.errors import ExcitationError
from ident.estimation.joint import embedded, inverse_of_precision
from ident.estimation.joint_estimate import Joint

DISAGREE = 2.0
"""Root mean square z of the differences between halves from which standard deviations are too small."""

LEAST_ADDED = 0.01
"""Least part of its variance that a recording is taken to add to a parameter: it is computed as a difference."""


def disagreement(joint: Joint) -> float | None:
    """Root mean square z of the base parameters' differences between two halves, of the recordings if there are more.

    Each half is taken with half of what is known beforehand. None if a half does not determine what it is fitted to.
    """
    fit, counts = joint.fit, joint.counts
    pieces = len(fit.shares)
    first = sum(counts[: len(counts) // 2]) if len(counts) > 1 else pieces // 2
    rank = joint.measurement.equations.parameters.rank
    steps, covariances = [], []
    for part in (fit.shares[:first], fit.shares[first:]):
        precision = sum((schur for schur, _ in part), start=fit.prior.precision / 2)
        right = sum((g for _, g in part), start=-fit.prior.precision @ (fit.theta - fit.prior.mean) / 2)
        # What only the other half has, as an offset of its own, is not fitted.
        free = fit.free & (np.diag(precision) > 0)
        try:
            covariance = inverse_of_precision(precision[np.ix_(free, free)])
        except ExcitationError:
            return None
        steps.append((covariance @ right[free])[:rank])
        covariances.append(covariance[:rank, :rank])
    z = (steps[0] - steps[1]) / np.sqrt(np.diag(covariances[0] + covariances[1]))
    return float(np.sqrt((z**2).mean()))


def disagreements(joint: Joint) -> tuple[float, ...]:
    """Root mean square z of the base parameters of each recording against those of the others; none for one or two.

    The estimate θ of all and θ_k of all but one differ by what the latter adds (Hausman, Econometrica 46, 1978,
    doi:10.2307/1913827):

        cov(θ_k - θ) = cov(θ_k) - cov(θ)

    Nor are there any if others than one do not determine the parameters.
    """
    if len(joint.counts) < 3:
        return ()
    rank, out = joint.measurement.equations.parameters.rank, []
    variances = np.diag(joint.fit.covariance)[:rank]
    for which in range(len(joint.counts)):
        try:
            theta, covariance = _without(joint, which)
        except ExcitationError:
            return ()
        added = np.maximum(np.diag(covariance)[:rank] - variances, LEAST_ADDED * variances)
        out.append(float(np.sqrt(((theta - joint.fit.theta)[:rank] ** 2 / added).mean())))
    return tuple(out)


def without(joint: Joint, which: int) -> np.ndarray:
    """Parameters without one of the recordings (p,).

    Raises:
        ExcitationError: The others do not determine them.
    """
    return _without(joint, which)[0]


def _without(joint: Joint, which: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters without one of the recordings (p,), and their covariance, zero for what is not fitted (p, p).

    Raises:
        ExcitationError: The others do not determine them.
    """
    fit, counts = joint.fit, joint.counts
    first = sum(counts[:which])
    own = fit.shares[first : first + counts[which]]
    precision = sum((-schur for schur, _ in own), start=fit.precision)
    right = sum((-g for _, g in own), start=fit.gradient)
    free = fit.free & (np.diag(precision) > 1e-9 * np.diag(fit.precision))
    theta, covariance = fit.theta.copy(), inverse_of_precision(precision[np.ix_(free, free)])
    theta[free] += covariance @ right[free]
    return theta, embedded(covariance, free)
