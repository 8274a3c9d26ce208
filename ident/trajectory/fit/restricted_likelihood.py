"""Noise and smoothness by restricted maximum likelihood: one update for each step of the parameters.

    σ_m² <- ‖r_m‖² / (N_m - tr(H⁻¹ H_m)),      λ_j <- (rank P - λ_j tr(H⁻¹ P_j)) / c_jᵀ P c_j

H_m and λ_j P_j are the parts of the curvature H from a stream of measurements and from the jerk's penalty (Wood and
Fasiolo, Biometrics 73, 2017, doi:10.1111/biom.12666). Each stream's noise has constant size, and may be correlated as
`x_k = ρ x_k-1 + u_k`. Then sums r_k + r_k-1 and differences r_k - r_k-1 are uncorrelated with variances
v± = 2 σ² (1 ± ρ), which follow by the same update; the trajectory absorbs more of the sums:

    v± <- v± · Σ s±² / ((1 ∓ ρ) N / 2 - tr(H⁻¹ H±)),      ρ <- (v+ - v-) / (v+ + v-)

with s± the corresponding halves of innovations (`ident.trajectory.algebra.whitening`) and H± = Σ (∂s±)ᵀ ∂s±. If the fit
absorbed nothing, this would be Burg's estimate, which is the first ρ where it exceeds chance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

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

FURTHEST = 4.0
"""Largest factor by which steps are lengthened."""

LONGEST = {"states": 0.5, "channels": 0.5, "jerk": 3.0}
"""Largest lengthened steps of the logarithms of standard deviations and of λ."""

PACED = {"states": 0.0025, "channels": 0.0025, "jerk": 0.005}
"""Steps up to which none are lengthened: their difference is no longer a measure of the slope."""

HASTENED = {"states": 1.0, "channels": 1.0, "jerk": 0.1}
"""Largest steps of θ, in its standard deviations, with which steps of the noise are lengthened."""

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
    shape, states = noise.states.shape, noise.states.size
    of_states, of_channels = growth[:, :states].reshape(3, *shape), growth[:, states:]
    floors = _floors(noise)
    new = {
        "states": np.maximum(noise.states * np.sqrt(of_states[0]), floors["states"]),
        "channels": np.maximum(noise.channels * np.sqrt(of_channels[0]), floors["channels"]),
        "jerk": np.maximum(rank - held, TINY) / np.maximum(bends, TINIEST),
    }
    if coloured:
        linked = number[1:].sum(axis=0)
        new["states_rho"] = _correlation(noise.states_rho, of_states[1:], linked[:states].reshape(shape))
        new["channels_rho"] = _correlation(noise.channels_rho, of_channels[1:], linked[states:])
    return replace(noise, **new)


def _floors(noise: Noise) -> dict[str, np.ndarray]:
    """Smallest standard deviations of states and channels after an update."""
    channels = noise.floor_channels * (1 + COLOURED_FLOOR * noise.channels_rho**2)
    for group in set(noise.alike):
        own = np.array(noise.alike) == group
        channels[own] = np.maximum(channels[own], ALIKE * np.median(noise.channels[own]))
    return {"states": noise.floor_states, "channels": channels}


class Stride(NamedTuple):
    """Logarithms of one part of the noise before an update, and their changes by the update (…)."""

    place: np.ndarray
    step: np.ndarray


def strides(before: Noise, after: Noise) -> dict[str, Stride]:
    """Steps of an update of standard deviations and smoothness, by part of the noise."""
    parts = {name: (getattr(before, name), getattr(after, name)) for name in LONGEST}
    return {name: Stride(np.log(old), np.log(new / old)) for name, (old, new) in parts.items()}


def hastened_noise(noise: Noise, before: Mapping[str, Stride] | None, now: Mapping[str, Stride], step: float) -> Noise:
    """Noise after an update whose steps are lengthened, but not below its floors.

    Args:
        noise: Noise after the update.
        before: Steps of the previous update, if there was one.
        now: Steps of this update.
        step: Largest step of θ, in its standard deviations.
    """
    if before is None:
        return noise
    new = {name: hastened(name, before[name], now[name]) for name, most in HASTENED.items() if step < most}
    floors = _floors(noise)
    return replace(noise, **{name: np.maximum(each, floors.get(name, 0.0)) for name, each in new.items()})


def hastened(name: str, before: Stride, now: Stride) -> np.ndarray:
    """Values of a part of the noise after steps lengthened by the secant of two updates, never shortened (…).

    Updates converge slowly where the trajectory absorbs most of a stream, and for coordinates that are poorly
    determined or hardly move, each at its own rate.

    Args:
        name: Part of the noise: `states`, `channels` or `jerk`.
        before: Steps of the previous update.
        now: Steps of this update.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        secant = (before.place - now.place) / (now.step - before.step)
    steady = (now.step * before.step > 0) & (np.abs(now.step) > PACED[name])
    longer = np.where(steady, np.clip(np.where(secant > 0, secant, FURTHEST), 1, FURTHEST), 1.0)
    most = np.maximum(np.abs(now.step), LONGEST[name])
    return np.exp(now.place + np.clip(longer * now.step, -most, most))


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
