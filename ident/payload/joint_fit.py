"""One fit of recordings with and without a load, from estimates of both, about their own solutions.

With a load φ on a body, whose base parameters are R φ, both share the links' base parameters ψ, drives and set-up:

    θ_without = [ψ, drives, set-up, offsets],    θ_with = [ψ + R φ, drives, set-up, other offsets]

Each estimate is Gaussian about its solution, so that the parameters z = [φ, θ_without, other offsets] of both follow
from the shares of all pieces in one step. Where torques have uncertain scales s, of which the recordings show only the
ratios, both are Gaussian in log(1 + s) and in what the torques state, w ψ with w the geometric mean of 1 + s.
"""

from dataclasses import replace

import numpy as np
from scipy import special

from ident.setup import FRICTION, OFFSET, SETUP
from ident.tolerances import SIGNIFICANT
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.precision import inverse_of_precision
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.trajectory_estimate import own_columns

LOADED = " with the load"
"""Ending of the names of parameters that recordings with the load have separately."""

RANK = 1e-9
"""Least singular value, over the largest, of what recordings show of a load."""

STEPS = 4
"""Number of steps to a load's stated mass where scales of torques are uncertain; the last changes the mass by 1e-9."""

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


def differing(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, joint: TrajectoryEstimate
) -> tuple[float, int]:
    """χ² of what recordings with and without a load share, less what the load explains, and its degrees of freedom.

    Args:
        without: As for `joint_fit`; so are `loaded` and `columns`.
        loaded: Estimate from recordings with it.
        columns: Base parameters of a unit of each of the load's parameters (r, 10).
        joint: The estimate of both.
    """
    first, last = (_as_stated(each, _stated(each)) for each in (without, loaded))
    shared = [name for name in last.names if name in first.names and name + LOADED not in joint.fit.names]
    at = np.array([(first.names.index(name), last.names.index(name)) for name in shared])
    i, k = at[first.free[at[:, 0]] & last.free[at[:, 1]]].T
    design = np.zeros((len(first.theta), 10))
    design[: len(columns)] = columns
    scale = np.sqrt(np.diag(first.covariance)[i] + np.diag(last.covariance)[k])
    factor = np.linalg.cholesky(
        (first.covariance[np.ix_(i, i)] + last.covariance[np.ix_(k, k)]) / np.outer(scale, scale)
    )
    sides = np.column_stack([last.theta[k] - first.theta[i], design[i]]) / scale[:, None]
    left, *X = np.linalg.solve(factor, sides).T
    explained, _, rank, _ = np.linalg.lstsq(np.column_stack(X), left, rcond=RANK)
    return float(np.sum((left - np.column_stack(X) @ explained) ** 2)), len(i) - int(rank)


def _joined(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, load: Prior, own: tuple[str, ...]
) -> tuple[TrajectoryEstimate, float]:
    """The joint estimate, with offsets and some other kinds of columns separate, and its cost but for a constant."""
    A, B, names = _maps(without, loaded, columns, own)
    first, last = (_as_stated(each, _stated(each)) for each in (without, loaded))
    at, count = slice(10, 10 + len(first.theta)), len(names)
    scales = np.flatnonzero(_scales(without) @ A)
    precision, mean = np.zeros((count, count)), np.zeros(count)
    precision[at, at], mean[at] = first.prior.precision, first.prior.mean
    # What both share has its prior once.
    alone = np.flatnonzero(B[:, at.stop :].any(axis=1))
    precision[at.stop :, at.stop :] = last.prior.precision[np.ix_(alone, alone)]
    mean[at.stop :] = last.prior.mean[alone]
    free, bound = (
        np.any([np.abs(mask @ T) > 0 for mask, T in zip(masks, (A, B), strict=True)], axis=0)
        for masks in ((first.free, last.free), (first.bound, last.bound))
    )
    # Its prior alone determines what no torque shows of a load, such as its mass beside an axis through its body.
    free[:10] = True
    fit = replace(
        first,
        names=names,
        prior=Prior(mean, precision, first.prior.weight),
        theta=np.zeros(count),
        free=free,
        bounded=bound & ~free,
        # About z = 0.
        shares=[(T.T @ P @ T, T.T @ (g + P @ fit.theta)) for fit, T in ((first, A), (last, B)) for P, g in fit.shares],
        scatters=[T.T @ M @ T for fit, T in ((first, A), (last, B)) for M in fit.scatter_shares],
    )
    solved, cost = fit, 0.0
    for _ in range(STEPS if load.mean.any() and len(scales) else 1):
        solved, cost = _solved(replace(fit, prior=_with_load(fit.prior, load, scales, solved.theta)))
    places = {name: k for k, name in enumerate(names)}
    setup = {places[each.name]: each for each in without.setup.values()}
    setup |= {places[name]: each for each in loaded.setup.values() if (name := each.name + LOADED) in places}
    joint = replace(without, search=replace(without.search, fit=solved), setup=setup)
    scaled = np.r_[np.ones(10, bool), _stated(without), np.zeros(count - at.stop, bool)]
    return replace(joint, search=replace(joint.search, fit=_as_stated(joint, scaled, back=True))), cost


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


def _with_load(prior: Prior, load: Prior, scales: np.ndarray, theta: np.ndarray) -> Prior:
    """Prior with that of the load φ, of which torques state w φ, about some parameters."""
    logs = theta[scales].mean() if len(scales) else 0.0
    stated = np.exp(logs) * load.mean
    units = np.eye(10, len(theta))
    units[:, scales] = -stated[:, None] / max(len(scales), 1)
    added = units.T @ load.precision
    precision = prior.precision + added @ units
    right = prior.precision @ prior.mean + added @ (stated * (1 - logs))
    seen = np.flatnonzero(precision.any(axis=0))
    mean = np.zeros(len(theta))
    mean[seen] = np.linalg.lstsq(precision[np.ix_(seen, seen)], right[seen], rcond=None)[0]
    return Prior(mean, precision, prior.weight)


def _solved(fit: TrajectoryFit) -> tuple[TrajectoryFit, float]:
    """The fit, stated about zero, with its free parameters where the right side vanishes, and the change of cost."""
    free, theta = fit.free, np.zeros(len(fit.names))
    theta[free] = inverse_of_precision(fit.precision[np.ix_(free, free)], fit.names) @ fit.gradient[free]
    shares = [(P, g - P @ theta) for P, g in fit.shares]
    return replace(fit, theta=theta, shares=shares), -float(fit.gradient @ theta)


def _scales(estimate: TrajectoryEstimate) -> np.ndarray:
    """Mask of the scales of torques that are estimated (p,)."""
    at = [k for k, each in estimate.setup.items() if SETUP[each.kind].stated and estimate.fit.free[k]]
    return np.isin(np.arange(len(estimate.fit.names)), at)


def _stated(estimate: TrajectoryEstimate) -> np.ndarray:
    """Mask of the base parameters and drives, which torques state times their scale (p,)."""
    equations = estimate.measurement.equations
    return np.arange(len(estimate.fit.names)) < equations.parameters.rank + len(equations.drives)


def _as_stated(estimate: TrajectoryEstimate, scaled: np.ndarray, *, back: bool = False) -> TrajectoryFit:
    """The fit in what torques state of some parameters and in logarithms of the scales, or back from it.

    Args:
        estimate: The estimate.
        scaled: Mask of these parameters (p,).
        back: True for an estimate in what torques state.
    """
    fit, scales = estimate.fit, _scales(estimate)
    if not scales.any():
        return fit
    logs = fit.theta[scales] if back else np.log1p(fit.theta[scales])
    whole, own, theta = np.exp(logs.mean()), np.exp(logs), fit.theta.copy()
    theta[scaled] *= 1 / whole if back else whole
    theta[scales] = np.expm1(logs) if back else logs
    # Derivative of the fit's parameters by the others.
    T = np.diag(np.where(scaled, whole if back else 1 / whole, 1.0))
    T[scales, scales] = 1 / own if back else own
    T[np.ix_(scaled, scales)] = np.outer(fit.theta[scaled], 1 / own if back else -np.ones(len(own))) / len(own)
    mean = theta + np.linalg.solve(T, fit.prior.mean - fit.theta)
    return replace(
        fit,
        theta=theta,
        prior=Prior(mean, T.T @ fit.prior.precision @ T, fit.prior.weight),
        shares=[(T.T @ P @ T, T.T @ g) for P, g in fit.shares],
        scatters=[T.T @ M @ T for M in fit.scatter_shares],
    )
