"""Fits within bounds: friction and rotor inertias that are not negative, and physically consistent bodies.

At a minimum under bounds (conditions of Karush, Kuhn and Tucker) each parameter at zero would be negative if it were
free.

Near a fit the cost is quadratic in ψ with everything else eliminated: its minimum is ψ* with covariance C. The ψ of the
physical bodies closest to it (`ident.parameters.consistency`) is then fixed, while the trajectory, the set-up and the
noise are fitted again; that changes ψ*, and the two steps alternate until ψ converges.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ident.estimation.equations import Equations
from ident.parameters.consistency import consistent_parameters
from ident.trajectory.fit.fitted import Start, TrajectoryFit, inverse_of_precision
from ident.trajectory.setup_search import Refit

Solve = Callable[..., TrajectoryFit]
"""Function that fits the parameters of a mask `free` (p,) from a start, in at most `rounds` rounds."""

TURNS = 8
"""Largest number of alternations."""

RESTS = 0.05
"""Step of ψ, in standard deviations, below which it has converged."""


def with_positive(solve: Solve, drives: np.ndarray, begin: Start, free: np.ndarray, rounds: int) -> TrajectoryFit:
    """Fit with no drive below zero.

    After the largest number of rounds no drive is freed again: the fit that goes on from there does that.

    Args:
        solve: Function that fits without bounds.
        drives: Mask of the drives (p,).
        begin: Starting point.
        free: Mask of the parameters to fit (p,); other drives may be freed.
        rounds: Largest number of rounds of each fit.
    """
    fit = _bounded(solve, drives, begin, free, rounds)
    # A drive that is negative while others are negative too may be positive once these are zero.
    untried = drives.copy()
    while rounds and fit.status != "stopped" and (gains := _gains(fit, untried & ~fit.free)).any():
        best = np.arange(len(drives)) == np.argmax(gains)
        untried &= ~best
        fit = _bounded(solve, drives, fit.end, fit.free | best, rounds)
    return replace(fit, bounded=drives & ~fit.free)


def _bounded(solve: Solve, drives: np.ndarray, begin: Start, free: np.ndarray, rounds: int) -> TrajectoryFit:
    """Fit with drives that come out negative fixed at zero."""
    fit = solve(begin, free=free, rounds=rounds)
    while fit.status != "interrupted" and (negative := drives & fit.free & (fit.theta < 0)).any():
        theta = np.where(negative, 0.0, fit.theta)
        fit = solve(replace(fit.end, theta=theta), free=fit.free & ~negative, rounds=rounds)
    return fit


def _gains(fit: TrajectoryFit, held: np.ndarray) -> np.ndarray:
    """Decrease of the cost if one parameter at zero were free, zero if it would be negative (p,)."""
    gains = np.zeros(len(held))
    if fit.shares and fit.status != "interrupted":
        values, std = replace(fit, scatters=None).scores(np.eye(len(held))[held])
        gains[held] = np.where(values > 0, (values / std) ** 2, 0.0)
    return gains


def physical_fit(fit: TrajectoryFit, refit: Refit, equations: Equations, rounds: int) -> TrajectoryFit:
    """Trajectory fit with ψ of physical bodies, as close to the model's as the recordings allow.

    Args:
        fit: The fit without that condition.
        refit: Function that fits from a start with given parameters free (p,) in a number of rounds.
        equations: Base parameters, and the mechanism with its prior.
        rounds: Largest number of rounds of each fit.

    Returns:
        The fit; its covariances are those without the condition, which adds little information where noise alone
        violates it.
    """
    mechanism, parameters, rank = equations.mechanism, equations.parameters, equations.parameters.rank
    absorbed = equations.from_drives[:rank]
    is_psi = np.arange(len(fit.theta)) < rank
    held = fit
    if fit.status == "interrupted":
        return fit
    for _ in range(TURNS):
        inverse = inverse_of_precision(held.precision[np.ix_(fit.free, fit.free)])
        wanted = held.theta[fit.free] + inverse @ held.gradient[fit.free]
        bodies = consistent_parameters(
            wanted[:rank] - absorbed, inverse[:rank, :rank], parameters, mechanism.known, bodies=mechanism.bodies
        )
        psi = bodies.psi + absorbed
        step = np.abs(psi - held.theta[:rank]) / np.sqrt(np.diag(inverse)[:rank])
        theta = np.r_[psi, held.theta[rank:]]
        held = refit(replace(held.end, theta=theta), fit.free & ~is_psi, rounds)
        if step.max() < RESTS or held.status == "interrupted":
            break
    return replace(held, free=fit.free & (held.free | is_psi), trace=(*fit.trace, *held.trace))
