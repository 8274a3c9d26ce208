"""Trajectory fit with physically consistent bodies.

Near a fit the cost is quadratic in ψ with everything else eliminated: its minimum is ψ* with covariance C. The ψ of the
physical bodies closest to it (`ident.parameters.consistency`) is then fixed, while the trajectory, the set-up and the
noise are fitted again; that changes ψ*, and the two steps alternate until ψ converges.
"""

from dataclasses import replace

import numpy as np

from ident.estimation.equations import Equations
from ident.parameters.consistency import consistent_parameters
from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.fit.precision import inverse_of_precision
from ident.trajectory.setup_search import Refit

TURNS = 8
"""Largest number of alternations."""

RESTS = 0.05
"""Step of ψ, in standard deviations, below which it has converged."""


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
    mechanism, rank = equations.mechanism, equations.parameters.rank
    absorbed = equations.from_drives[:rank]
    is_psi = np.arange(len(fit.theta)) < rank
    held = fit
    if fit.status == "interrupted":
        return fit
    for _ in range(TURNS):
        inverse = inverse_of_precision(held.precision[np.ix_(fit.free, fit.free)])
        wanted = held.theta[fit.free] + inverse @ held.gradient[fit.free]
        bodies = consistent_parameters(
            wanted[:rank] - absorbed,
            inverse[:rank, :rank],
            equations.parameters,
            mechanism.known,
            bodies=mechanism.bodies,
        )
        psi = bodies.psi + absorbed
        step = np.abs(psi - held.theta[:rank]) / np.sqrt(np.diag(inverse)[:rank])
        theta = np.r_[psi, held.theta[rank:]]
        held = refit(replace(held.end, theta=theta), fit.free & ~is_psi, rounds)
        if step.max() < RESTS or held.status == "interrupted":
            break
    return replace(held, free=fit.free & (held.free | is_psi), trace=(*fit.trace, *held.trace))
