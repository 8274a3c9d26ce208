"""One fit of recordings with and without a load, from estimates of both, about their own solutions.

With a load φ on a body, whose base parameters are R φ, both share the links' base parameters ψ, drives and set-up:

    θ_without = [ψ, drives, set-up, offsets],    θ_with = [ψ + R φ, drives, set-up, other offsets]

Each estimate is Gaussian about its solution, so that the parameters z = [φ, θ_without, other offsets] of both follow
from the shares of all pieces in one step.
"""

from dataclasses import replace

import numpy as np
from scipy import special

from ident.setup import FRICTION, OFFSET
from ident.tolerances import SIGNIFICANT
from ident.trajectory.estimate import own_columns
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.precision import inverse_of_precision
from ident.trajectory.result import TrajectoryEstimate

LOADED = " with the load"
"""Ending of the names of parameters that recordings with the load have separately."""

LOAD = tuple(f"load({name})" for name in ("m", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))
"""Names of the load's parameters."""


def joint_fit(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, size: np.ndarray, mean: np.ndarray
) -> TrajectoryEstimate:
    """Estimate whose first ten parameters are a load's φ, and the next those of recordings without it.

    Friction is shared unless the recordings contradict that, as gears rub more under load.

    Args:
        without: Estimate from recordings without the load, of r base parameters.
        loaded: Estimate from recordings with it, of the same.
        columns: Base parameters of a unit of each of the load's parameters (r, 10).
        size: Standard deviations of the load's prior, so wide that they matter only where data do not (10,).
        mean: Mean of the load's prior (10,).
    """
    (together, cost), (apart, less) = (
        _joined(without, loaded, columns, Prior(mean, np.diag(size**-2.0)), own=own) for own in ((), (FRICTION,))
    )
    more = len(apart.fit.names) - len(together.fit.names)
    return apart if more and cost - less > special.chdtri(more, SIGNIFICANT) else together


def _joined(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, load: Prior, own: tuple[str, ...]
) -> tuple[TrajectoryEstimate, float]:
    """The joint estimate, with offsets and some other kinds of columns separate, and its cost but for a constant."""
    A, B, names = _maps(without, loaded, columns, own)
    count, first, last = len(names), without.fit, loaded.fit
    precision, mean = np.zeros((count, count)), np.zeros(count)
    precision[:10, :10], mean[:10] = load.precision, load.mean
    at = slice(10, 10 + len(first.theta))
    precision[at, at], mean[at] = first.prior.precision, first.prior.mean
    # What both share has its prior once.
    alone = np.flatnonzero(B[:, at.stop :].any(axis=1))
    precision[at.stop :, at.stop :] = last.prior.precision[np.ix_(alone, alone)]
    every = [(each, T) for each, T in ((first, A), (last, B))]
    free, bound = (
        np.any([np.abs(mask @ T) > 0 for mask, T in zip(masks, (A, B), strict=True)], axis=0)
        for masks in ((first.free, last.free), (first.bound, last.bound))
    )
    fit = replace(
        first,
        names=names,
        prior=Prior(mean, precision, first.prior.weight),
        theta=np.zeros(count),
        free=free,
        bounded=bound & ~free,
        # About z = 0.
        shares=[(T.T @ P @ T, T.T @ (g + P @ fit.theta)) for fit, T in every for P, g in fit.shares],
        scatters=[T.T @ M @ T for fit, T in every for M in fit.scatter_shares],
    )
    places = {name: k for k, name in enumerate(names)}
    setup = {places[each.name]: each for each in without.setup.values()}
    setup |= {places[name]: each for each in loaded.setup.values() if (name := each.name + LOADED) in places}
    solved = _solved(fit)
    return replace(without, search=replace(without.search, fit=solved), setup=setup), -float(
        fit.gradient @ solved.theta
    )


def _maps(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, own: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Matrices from all parameters to those of either estimate, (p, q) and (p', q), and the names of all (q,)."""
    first, last, measurement = without.fit.names, loaded.fit.names, loaded.measurement
    apart = own_columns(measurement, (*own, OFFSET))
    shared = [k < len(measurement.names) and k not in apart and name in first for k, name in enumerate(last)]
    more = [k for k, both in enumerate(shared) if not both]
    names = (*LOAD, *first, *(last[k] + LOADED for k in more))
    A, B = np.zeros((len(first), len(names))), np.zeros((len(last), len(names)))
    A[:, 10 : 10 + len(first)] = np.eye(len(first))
    for k, name in enumerate(last):
        B[k, 10 + (first.index(name) if shared[k] else len(first) + more.index(k))] = 1
    B[: len(columns), :10] = columns
    return A, B, names


def _solved(fit: TrajectoryFit) -> TrajectoryFit:
    """The fit with its free parameters where the right side, stated about zero, vanishes."""
    free, theta = fit.free, np.zeros(len(fit.names))
    theta[free] = inverse_of_precision(fit.precision[np.ix_(free, free)], fit.names) @ fit.gradient[free]
    return replace(fit, theta=theta, shares=[(P, g - P @ theta) for P, g in fit.shares])
