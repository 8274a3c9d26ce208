"""Trajectory, parameters, set-up and noise of recordings at once, beside the candidates that it is compared with."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ident.errors import ExcitationError
from ident.estimate import Estimate
from ident.estimation.equations import Equations
from ident.estimation.excitation import excited
from ident.estimation.preparation import Prepared
from ident.estimation.separable import separable
from ident.estimators.least_squares import model_as_it_came
from ident.judgement.checks import wrench_checks
from ident.judgement.halves import disagreement, disagreements, widening, without
from ident.judgement.torque_checks import torque_checks
from ident.problem import Problem
from ident.regression.filtered import FilteredLeastSquares, filtered_least_squares
from ident.regression.held_out import HeldOut
from ident.regression.ordinary import Fit
from ident.setup import PRIORS
from ident.trajectory.corrected import as_fit, corrected
from ident.trajectory.estimate import trajectory_estimate
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.smoothing_choice import chosen_smoothing


def trajectory(problem: Problem) -> Estimate:
    """Estimate of trajectories, parameters, set-up and noise."""
    equations, samples = problem.equations, problem.samples
    singular_values, poor = excited(equations, samples)
    still = samples.motion.base is None and not np.ptp(samples.motion.q, axis=0).any()
    if poor and (still or problem.wanted is False):
        raise poor
    known = problem.known if problem.wanted or poor else None
    with_offsets = separable(equations.with_offsets(equations.sensed), samples)
    if not problem.held:
        # Where the sum of all wrenches is zero, a constant one is weight, not an offset.
        components = len(equations.channels) - len(equations.torques)
        with_offsets = equations.with_offsets([k for k in with_offsets.offsets if k >= components])
    # No search if the set-up is exact, or if something is grossly wrong.
    search = any({**PRIORS, **problem.setup}.values()) and not any(_grossly_wrong(part.log) for part in problem.fitted)
    columns = with_offsets if problem.offsets else equations
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
    result = _known_enough(estimate, known, problem.known if problem.wanted is None else known)
    rms = disagreement(result)
    wider = widening(rms)
    problem = replace(problem, smoothing=chosen_smoothing(problem.fitted, result))
    mended = _corrected(problem, result)
    fit = as_fit(result, mended.samples, mended.equations, wider)
    fits = [fit]
    if not problem.apart and len(problem.fitted) > 2:
        values = (without(result, k) for k in range(len(problem.fitted)))
        fits = [replace(fit, values=x[: len(fit.values)]) for x in values]
    held_out = mended.held_out(fits)
    rivals, filtered = _rivals(problem, with_offsets, result, fit, held_out)
    return Estimate(
        logs=mended.fitted,
        fit=fit,
        offsets=fit.offsets,
        held_out=held_out,
        singular_values=singular_values,
        trajectory=result,
        rivals=rivals,
        filtered_at=filtered.cutoffs[0],
        filtered_values=_with_zeros(filtered.values[0], with_offsets, fit.equations),
        disagreement=rms,
        disagreements=disagreements(result),
        widening=wider,
        bounded=result.bounds,
    )


def _grossly_wrong(log: Prepared) -> bool:
    """True if a wrench or torque is so wrong that a search for small set-up errors is pointless."""
    frames, base = wrench_checks(log)
    torques = torque_checks(log)
    wrench = any(check.suspicious for check in frames.values()) or (base is not None and base.suspicious)
    return wrench or (torques is not None and torques.grossly_wrong)


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
            "The trajectory estimate's equations are singular but for rounding: some joint angles follow a curve "
            "exactly, as computed or smoothed ones do, or hardly move in what is fitted. Take the angles as they were "
            "measured, hold joints that rest (--fix), or fit what the model knows as well (--prior on)."
        ) from None


def _with_zeros(values: np.ndarray, few: Equations, many: Equations) -> np.ndarray:
    """Values of columns, with zeros for those of Stribeck friction that only other equations have."""
    at = few.parameters.rank + len(few.drives)
    return np.insert(values, at, np.zeros(len(many.drives) - len(few.drives)))


def _corrected(problem: Problem, trajectory: TrajectoryEstimate) -> Problem:
    """Recordings with the set-up of a trajectory estimate and smoothed motion, that to judge by from angles alone."""
    smoothing = problem.smoothing
    logs = [corrected(part.log, trajectory, k, smoothing, part.samples) for k, part in enumerate(problem.fitted)]
    if problem.apart:
        judges = [corrected(part.log, trajectory, None, smoothing) for part in problem.judged]
    elif len(problem.fitted) > 2:
        judges = [corrected(part.log, trajectory, k, smoothing) for k, part in enumerate(problem.judged)]
    else:
        judges = logs
    return problem.with_logs(logs, judges)


def _rivals(
    problem: Problem, equations: Equations, trajectory: TrajectoryEstimate, fit: Fit, held_out: HeldOut
) -> tuple[dict[str, np.ndarray], FilteredLeastSquares]:
    """Residual ratios of other candidates with the set-up as stated: the model's prior, and least squares.

    Least squares have no Stribeck friction that the trajectory estimate added: filtered reversals look like it.

    Args:
        problem: Samples to fit and to judge by.
        equations: Their columns, with offsets.
        trajectory: The trajectory estimate.
        fit: The trajectory estimate as a fit.
        held_out: Its residuals.

    Returns:
        Ratios of residual to signal by candidate (C,), and least squares.
    """
    stated = _corrected(problem, trajectory.as_stated())
    held = model_as_it_came(stated, replace(fit, equations=equations))
    count, prior = equations.parameters.rank + len(equations.drives), trajectory.fit.prior
    known = prior.mean[:count], prior.known[:count, :count]
    others = not problem.apart and len(problem.fitted) > 2
    filtered = filtered_least_squares(problem.fitted, problem.judged, equations, known, others=others)
    commanded = equations.servos is not None
    measured = np.concatenate(filtered.measured) if commanded else held.samples.measured
    residuals = {"model": held.residual, "least squares": measured - np.concatenate(filtered.predicted)}
    # Lag and scales of commands change the torques that they make; all candidates are held against the same ones.
    signal, scales = held, np.ones(len(equations.channels))
    if commanded:
        signal, scales = held_out, np.array(trajectory.measurement.gains(trajectory.parameters_of(0)), float)
    return {name: replace(signal, residual=x / scales).ratio for name, x in residuals.items()}, filtered
