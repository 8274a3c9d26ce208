"""Least squares with states taken as exact: the log's own velocities and accelerations, or those of filtered angles."""

from dataclasses import replace

import numpy as np

from ident.estimate import Estimate
from ident.estimation.excitation import excited
from ident.estimation.separable import separable
from ident.estimation.stated_drives import stated_drive_channels
from ident.problem import Problem
from ident.regression.held_out import HeldOut
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
    with_offsets = separable(equations.with_offsets(equations.sensed), samples)
    full = robust_fit(with_offsets, samples, weighted=weighted)
    fit = full if problem.offsets else robust_fit(equations, samples, weighted=weighted)
    rivals = {"model": model_as_it_came(problem, full).ratio}
    return Estimate(problem.fitted, fit, full.offsets, problem.held_out([fit]), singular_values, rivals=rivals)


def model_as_it_came(problem: Problem, fit: Fit) -> HeldOut:
    """Residuals of the model as it came, on the samples to judge by.

    It predicts with its prior parameters, and with the drives that it states instead of fitted ones; offsets are the
    mean residuals of the samples to fit.

    Args:
        problem: Samples to fit and to judge by.
        fit: A fit of the same columns, whose values do not matter.
    """
    equations, samples = fit.equations, problem.samples
    prior = equations.parameters.regroup(equations.mechanism.known)
    model = replace(fit, values=np.r_[prior, np.zeros(len(equations.names) - len(prior))])
    if equations.offsets:
        left = model.residual(samples) - stated_drive_channels(equations, samples.motion)
        model.values[-len(equations.offsets) :] = left.mean(axis=0)[list(equations.offsets)]
    held = problem.held_out([model])
    return replace(held, residual=held.residual - stated_drive_channels(equations, held.samples.motion))
