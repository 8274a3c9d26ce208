"""Least squares with states taken as exact: the log's own velocities and accelerations, or those of filtered angles."""

from dataclasses import replace

import numpy as np

from ident.estimate import Estimate
from ident.estimation.excitation import excited
from ident.estimation.samples import Samples
from ident.estimation.separable import separable
from ident.problem import Problem
from ident.regression.ordinary import Fit
from ident.regression.robust import robust_fit


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
    with_offsets = separable(equations.with_offsets(range(len(equations.channels))), samples)
    full = robust_fit(with_offsets, samples, weighted=weighted)
    fit = full if problem.offsets else robust_fit(equations, samples, weighted=weighted)
    model = problem.held_out([model_as_it_came(full, samples)])
    rivals = {"model": model.ratio}
    return Estimate(problem.fitted, fit, full.offsets, problem.held_out([fit]), singular_values, rivals=rivals)


def model_as_it_came(fit: Fit, samples: Samples) -> Fit:
    """Fit replaced by the model's prior parameters, without drives, with the mean residuals of samples as offsets."""
    equations = fit.equations
    prior = equations.parameters.regroup(equations.mechanism.known)
    model = replace(fit, values=np.r_[prior, np.zeros(len(equations.names) - len(prior))])
    if equations.offsets:
        model.values[-len(equations.offsets) :] = model.residual(samples).mean(axis=0)[list(equations.offsets)]
    return model
