"""Trajectory, parameters, set-up and noise of recordings at once, beside the candidates that it is compared with."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ident.errors import ExcitationError
from ident.estimate import Estimate
from ident.estimation.accumulator import excited, separable, undetermined
from ident.estimation.equations import Equations
from ident.estimation.preparation import Prepared
from ident.estimation.samples import joined
from ident.estimators.least_squares import FilteredLeastSquares, filtered_least_squares
from ident.estimators.predictions import Candidate, Predictions
from ident.judgement.checks import Checks, wrench_checks
from ident.judgement.model_fit import recorded_gravity
from ident.judgement.residuals import beyond_fast_noise, differences, disagreements, widening, widenings, without
from ident.judgement.torque_checks import torque_checks
from ident.problem import Problem
from ident.regression.held_out import LEAST_SQUARES, MODEL
from ident.setup import PRIORS
from ident.trajectory.corrected import as_fit
from ident.trajectory.fit.fitted import UNDETERMINED
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.trajectory_estimate import trajectory_estimate


def trajectory(problem: Problem) -> Estimate:
    """Estimate of trajectories, parameters, set-up and noise."""
    equations, samples = problem.equations, problem.samples
    singular_values, poor = excited(equations, samples)
    still = samples.motion.base is None and not np.ptp(samples.motion.q, axis=0).any()
    if poor and (still or problem.wanted is False):
        raise poor
    with_offsets = _with_offsets(problem)
    known = problem.known if problem.wanted or poor else None
    result = _fitted(problem, with_offsets if problem.offsets else equations, known)
    halves = differences(result)
    rms = None if halves is None else float(np.sqrt((halves**2).mean()))
    wider = widening(rms)
    predictions = Predictions(problem, result)
    first = predictions.logs[0].equations(result)
    factors = widenings(halves, wider, len(first.names))
    values = [result.fit.theta]
    if problem.leaves_out:
        values = [without(result, k) for k in range(len(problem.fitted))]
    own = predictions.of(Candidate(first, np.stack(values)[:, : len(first.names)]), result)
    usual = float(np.median(own.constants))
    logs = [
        part.of(log.corrected(result, usual, part.samples))
        for log, part in zip(predictions.logs, problem.fitted, strict=True)
    ]
    fit = as_fit(result, joined([part.used for part in logs]), first, factors)
    filtered = _least_squares(problem, with_offsets, result)
    others = {
        LEAST_SQUARES: Candidate(with_offsets, filtered.values),
        MODEL: Candidate.model(with_offsets, samples),
    }
    # All are compared in units of the channels as the estimate has them.
    scales = result.measurement.torque_gains(result.parameters_of(0))
    rivals = {name: predictions.of(each, result.as_stated()).residual / scales for name, each in others.items()}
    asked = result.search.deviations or beyond_fast_noise(result, first.channels)
    return Estimate(
        logs=logs,
        fit=fit,
        offsets=fit.offsets,
        held_out=predictions.held_out(own, replace(fit, values=values[0][: len(fit.values)]), rivals),
        singular_values=singular_values,
        trajectory=result,
        filtered_at=filtered.cutoffs[0],
        filtered_values=_with_zeros(filtered.values[0], with_offsets, fit.equations),
        disagreement=rms,
        disagreements=disagreements(result),
        widening=wider,
        widened={name: by for name, by in zip(first.names, factors.tolist(), strict=True) if by > wider},
        bounded=result.bounds,
        unmodelled=predictions.unmodelled(usual) if asked else (),
        undetermined=undetermined(equations, samples) if any(part.log.resting for part in problem.fitted) else (),
    )


def _with_offsets(problem: Problem) -> Equations:
    """Equations with the offsets of channels that the samples separate from the other columns."""
    equations = problem.equations
    out = separable(equations.with_offsets(equations.sensed), problem.samples)
    if problem.held:
        return out
    # Where the sum of all wrenches is zero, a constant one is weight, not an offset.
    components = len(equations.channels) - len(equations.torques)
    return equations.with_offsets([k for k in out.offsets if k >= components])


def _fitted(problem: Problem, columns: Equations, known: Mapping[str, float] | None) -> TrajectoryEstimate:
    """Trajectory estimate of some columns, with the standard deviations of φ to use first, None for no prior."""
    # No search if the set-up is exact, or if something is grossly wrong.
    search = any({**PRIORS, **problem.setup}.values()) and not any(_grossly_wrong(part.log) for part in problem.fitted)
    estimate = partial(
        trajectory_estimate,
        problem.fitted,
        columns,
        search=search,
        stribeck=problem.fitted[0].log.searches_stribeck,
        own=problem.own,
        setup=problem.setup,
        physical=problem.physical,
        executor=problem.executor,
        report=problem.report,
    )
    return _known_enough(estimate, known, problem.known if problem.wanted is None else known)


def _least_squares(problem: Problem, equations: Equations, result: TrajectoryEstimate) -> FilteredLeastSquares:
    """Least squares with the set-up as stated, and with the prior of the trajectory estimate.

    They have no Stribeck friction that the trajectory estimate added: filtered reversals look like it.
    """
    count, prior = equations.parameters.rank + len(equations.drives), result.fit.prior
    known = prior.mean[:count], prior.known[:count, :count]
    return filtered_least_squares(problem.fitted, problem.judged, equations, known, others=problem.leaves_out)


def _grossly_wrong(log: Prepared) -> bool:
    """True if a wrench or torque is so wrong that a search for small set-up errors is pointless."""
    if log.guessed:
        return False
    frames, base = wrench_checks(log)
    return Checks(recorded_gravity(log), frames=frames, base=base, torques=torque_checks(log)).grossly_wrong


def _known_enough(
    estimate: Callable[..., TrajectoryEstimate], known: Mapping[str, float] | None, prior: Mapping[str, float] | None
) -> TrajectoryEstimate:
    """Trajectory estimate, with a prior if that predicts better, or if the data alone do not determine it.

    Args:
        estimate: Function that estimates with given standard deviations of φ.
        known: Standard deviations to use first, None for no prior.
        prior: Standard deviations to fall back on, None for none.
    """
    if known or prior is None:
        return _solvable(estimate, known=known)
    try:
        return _solvable(estimate, fallback=prior)
    except ExcitationError:
        return _solvable(estimate, known=prior)


def _solvable(estimate: Callable[..., TrajectoryEstimate], **known: Mapping[str, float] | None) -> TrajectoryEstimate:
    """Trajectory estimate; raises an ExcitationError if its equations are singular up to rounding."""
    try:
        return estimate(**known)
    except np.linalg.LinAlgError:
        raise ExcitationError(
            "Some joint angles follow a curve exactly, as computed or smoothed ones do, or hardly move: but for "
            f"rounding, the {UNDETERMINED}"
        ) from None


def _with_zeros(values: np.ndarray, few: Equations, many: Equations) -> np.ndarray:
    """Values of columns, with zeros for those of Stribeck friction that only other equations have."""
    at = few.parameters.rank + len(few.drives)
    return np.insert(values, at, np.zeros(len(many.drives) - len(few.drives)))
