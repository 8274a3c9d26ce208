"""Stribeck friction where recordings ask for it: additional friction at low velocity, Fs(joint).

Its columns are no part of the first fit. A linearisation about that fit gives the value that each would have, and the
cost of pieces predicted from the others with it and without. Columns that are clearly positive and predict better are
fitted, and stay if they are significant.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from ident.errors import ExcitationError
from ident.estimation.equations import Equations
from ident.tolerances import DRIVE, SIGNIFICANT, STRIBECK
from ident.trajectory.left_out import clearly_better, costs, gains
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import rubbing
from ident.trajectory.setup_search import PROMISING
from ident.trajectory.stages import Stages


def with_low_velocity_friction(
    stages: Stages, estimate: TrajectoryEstimate, stages_of: Callable[[Equations], Stages]
) -> tuple[Stages, TrajectoryEstimate]:
    """Stages and estimate with the Stribeck columns that recordings ask for, those given if they ask for none.

    Args:
        stages: Stages of the estimate.
        estimate: Estimate near convergence, with the set-up as stated.
        stages_of: Function that returns the stages of other columns.
    """
    equations, candidates = estimate.measurement.equations, _candidates(estimate)
    if not candidates or estimate.fit.status == "interrupted" or len(estimate.fit.pieces) < 2:
        return stages, estimate
    try:
        values = _promising(stages_of(equations.with_stribeck(candidates)), estimate, candidates)
        threshold = -float(special.ndtri(SIGNIFICANT / 2 / len(candidates)))
        while values:
            wider = stages_of(equations.with_stribeck(tuple(values)))
            tried = wider.settled(_carried(wider, estimate, values))
            kept = _significant(wider.scattered(tried), tuple(values), threshold)
            if len(kept) == len(values):
                return wider, tried
            values = {name: values[name] for name in kept}
    except (ExcitationError, np.linalg.LinAlgError):
        pass  # The recordings do not determine more columns.
    return stages, estimate


def _candidates(estimate: TrajectoryEstimate) -> tuple[str, ...]:
    """Stribeck columns of the axes with Coulomb friction that changes its sign over less than `STRIBECK`.

    Where it changes over more, friction that is higher at low velocity would only correct the shape of that change.
    """
    equations, reversals = estimate.measurement.equations, estimate.reversals
    if reversals is None:
        return ()
    steep = reversals.slip < STRIBECK * equations.axes.gears
    return tuple(f"{DRIVE['stribeck']}({equations.axes.names[a]})" for a in rubbing(equations) if steep[a])


def _promising(stages: Stages, estimate: TrajectoryEstimate, candidates: Sequence[str]) -> dict[str, float]:
    """Columns that would be clearly positive and predict left-out pieces better, with their values, N m or N.

    Args:
        stages: Stages with the columns of all candidates.
        estimate: The estimate without them.
        candidates: Their names.
    """
    begun = _carried(stages, estimate, {})
    fit = stages.scattered(begun.with_fit(stages.refit_of(begun)(begun.fit.end, begun.fit.free, 0))).fit
    at = [fit.names.index(name) for name in candidates]
    values, std = fit.scores(np.eye(len(fit.theta))[at])
    held = costs(fit, fit.free)
    better = [
        value > PROMISING * own and clearly_better(gains(fit, k, held))
        for k, value, own in zip(at, values, std, strict=True)
    ]
    return {name: float(value) for name, value, one in zip(candidates, values, better, strict=True) if one}


def _significant(estimate: TrajectoryEstimate, names: Sequence[str], threshold: float) -> list[str]:
    """Columns whose values exceed a threshold in standard deviations."""
    fit = estimate.fit
    at = [fit.names.index(name) for name in names]
    z = fit.theta[at] / np.sqrt(np.maximum(np.diag(fit.covariance)[at], 1e-300))
    return [name for name, own in zip(names, z, strict=True) if own > threshold]


def _carried(stages: Stages, estimate: TrajectoryEstimate, values: Mapping[str, float]) -> TrajectoryEstimate:
    """Estimate with more columns, as a starting point of their stages.

    Args:
        stages: Stages with more columns.
        estimate: Estimate without them.
        values: Values of the columns that are free, by name; the others are fixed at zero.
    """
    fit, p = estimate.fit, len(stages.names)
    at = [stages.names.index(name) for name in (*fit.names, *values)]
    theta, free = np.zeros(p), np.zeros(p, bool)
    theta[at], free[at] = np.r_[fit.theta, list(values.values())], np.r_[fit.free, np.ones(len(values), bool)]
    selections = [own for own, count in zip(stages.selections, estimate.counts, strict=True) for _ in range(count)]
    fit = replace(
        fit,
        names=stages.names,
        selections=selections,
        prior=stages.prior,
        theta=theta,
        free=free,
        shares=(),
        scatters=None,
        bounded=None,
    )
    estimate = replace(estimate.with_fit(fit), measurement=stages.measured(estimate.reversals), setup=stages.setup)
    return replace(estimate, search=replace(estimate.search, deviations=stages.stated))
