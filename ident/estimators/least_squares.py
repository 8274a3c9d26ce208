"""Least squares with states taken as exact: the log's own velocities and accelerations, or those of filtered angles."""

from dataclasses import replace

from ident.estimate import Estimate
from ident.estimation.separation import excited, separable
from ident.estimators.predictions import Candidate
from ident.problem import Problem
from ident.regression.conventional import robust_fit
from ident.regression.held_out import MODEL


def ordinary(problem: Problem) -> Estimate:
    """Ordinary least squares, as in the paper."""
    return _least_squares(problem, weighted=False)


def weighted(problem: Problem) -> Estimate:
    """Least squares of channels weighted by their residuals, outliers weighted down."""
    return _least_squares(problem, weighted=True)


def _least_squares(problem: Problem, *, weighted: bool) -> Estimate:
    equations, samples = problem.equations, problem.samples
    singular_values, poor = excited(equations, samples)
    if poor:
        raise poor
    with_offsets = separable(equations.with_offsets(equations.sensed), samples)
    full = robust_fit(with_offsets, samples, weighted=weighted)
    fit = full if problem.offsets else robust_fit(equations, samples, weighted=weighted)
    held_out, model = problem.held_out(fit), Candidate.model(with_offsets, samples)
    held_out = replace(held_out, rivals={MODEL: model.residuals(held_out.samples)[0]})
    return Estimate(problem.fitted, fit, full.offsets, held_out, singular_values)
