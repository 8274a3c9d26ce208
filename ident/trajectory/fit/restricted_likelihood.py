"""Noise and smoothness by restricted maximum likelihood: one update for each step of the parameters.

    σ_m² <- ‖r_m‖² / (N_m - tr(H⁻¹ H_m)),      λ_j <- (rank P - λ_j tr(H⁻¹ P_j)) / (c_jᵀ P c_j + 2 / λ_j)

H_m and λ_j P_j are the parts of the curvature H from a stream of measurements and from the jerk's penalty (Wood and
Fasiolo, Biometrics 73, 2017, doi:10.1111/biom.12666). With 2 / λ_j, the likelihood times the variance 1 / λ_j has its
maximum (Li and Lahiri, J. Multivariate Analysis 101:882-892, 2010): by itself it is often largest without any motion
where that is below slow noise, and the motion that is lost is in no interval.

Each stream's noise has constant size, and may be correlated as `x_k = ρ x_k-1 + u_k`. Then sums r_k + r_k-1 and
differences r_k - r_k-1 are uncorrelated with variances v± = 2 σ² (1 ± ρ), which follow by the same update; the
trajectory absorbs more of the sums:

    v± <- v± · Σ s±² / ((1 ∓ ρ) N / 2 - tr(H⁻¹ H±)),      ρ <- (v+ - v-) / (v+ + v-)

with s± the corresponding halves of innovations (`ident.trajectory.algebra.whitening`) and H± = Σ (∂s±)ᵀ ∂s±. If the fit
absorbed nothing, this would be Burg's estimate, which is the first ρ where it exceeds chance.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.trajectory.fit.piece import Noise
from ident.trajectory.fit.piece_equations import Linearised, Misfit

LEAST_LEFT = 0.05
"""Least share of a stream's samples that counts as degrees of freedom of its noise."""

MOST_CORRELATED = 0.99
"""Upper limit of ρ; above it the mean of a channel is practically free."""

CHANCE, WHITE_AGAIN = 2.0, 1.0
"""Correlations, in standard deviations of that of white noise: the one above which white noise becomes correlated, and
the one below which correlated noise becomes white again."""

COLOURED_FLOOR = 15.0
"""Relative increase of the floor of a channel's noise at ρ = 1: there are model errors then, and the trajectory's fit
to the channel is no measure of its noise."""

LEAST_MOTION = 2.0
"""Least degrees of freedom of a coordinate's motion in a recording. Where a joint of a person swings by 1° in noise of
.5° that lasts, its motion was lost and parameters were off by up to 3.7 s.d. for it, with this by .8."""

ALIKE = 0.1
"""Least noise of a component relative to the median of its sensor's components in the same unit."""

TINY, TINIEST = 1e-3, 1e-300
"""Lower limits of numbers of samples and of sums of squares."""


def renewed(noise: Noise, parts: Sequence[Linearised], misfits: Sequence[Misfit], *, coloured: bool) -> Noise:
    """Noise after restricted-likelihood updates of standard deviations, smoothness and, if requested, correlation.

    Args:
        noise: Noise before.
        parts: Linearised pieces at the last iterate.
        misfits: Misfits of the pieces after the step; those before it still reflect the old noise.
        coloured: True to update the correlation.
    """
    taken, held = (np.sum([getattr(part, k) for part in parts], axis=0) for k in ("taken", "held"))
    squares, number, bends, rank = (
        np.sum([getattr(each, k) for each in misfits], axis=0) for k in ("squares", "number", "bends", "rank")
    )
    left = np.maximum(number - taken, np.maximum(LEAST_LEFT * number, TINY))
    growth = np.where(number > 0, squares / left, 1.0)
    states = len(noise.states)
    of_states, of_channels = growth[:, :states], growth[:, states:]
    floors = _floors(noise)
    new = {
        "states": np.maximum(noise.states * np.sqrt(of_states[0]), floors["states"]),
        "channels": np.maximum(noise.channels * np.sqrt(of_channels[0]), floors["channels"]),
        "jerk": np.maximum(rank - held, TINY) / (bends + LEAST_MOTION / noise.jerk),
    }
    if coloured:
        linked = number[1:].sum(axis=0)
        new["states_rho"] = _correlation(noise.states_rho, of_states[1:], linked[:states])
        new["channels_rho"] = _correlation(noise.channels_rho, of_channels[1:], linked[states:])
    return replace(noise, **new)


def _floors(noise: Noise) -> dict[str, np.ndarray]:
    """Smallest standard deviations of states and channels after an update."""
    channels = noise.floor_channels * (1 + COLOURED_FLOOR * noise.channels_rho**2)
    for group in set(noise.alike):
        own = np.array(noise.alike) == group
        channels[own] = np.maximum(channels[own], ALIKE * np.median(noise.channels[own]))
    return {"states": noise.floor_states, "channels": channels}


def _correlation(rho: np.ndarray, growth: np.ndarray, linked: np.ndarray) -> np.ndarray:
    """Updated ρ from the factors by which the variances of sums and differences change.

    Args:
        rho: ρ before (…).
        growth: Factors (2, …) on the variances, which were as 1 + ρ to 1 - ρ.
        linked: Number of samples that follow another one (…).
    """
    sums, differences = growth[0] * (1 + rho), growth[1] * (1 - rho)
    # Both are zero for a residual of zero.
    new = (sums - differences) / np.maximum(sums + differences, TINIEST)
    white = new < np.where(rho == 0, CHANCE, WHITE_AGAIN) / np.sqrt(np.maximum(linked, 1))
    return np.where(white, 0.0, np.clip(new, 0, MOST_CORRELATED))
