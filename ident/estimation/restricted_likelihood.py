"""Noise and smoothness by restricted maximum likelihood: one update for each step of the parameters.

    σ_m² <- ‖r_m‖² / (N_m - tr(H⁻¹ H_m)),      λ_j <- (rank P - λ_j tr(H⁻¹ P_j)) / c_jᵀ P c_j

H_m and λ_j P_j are the parts of the curvature H that a stream of measurements and the jerk's penalty make (Wood and
Fasiolo, Biometrics 73, 2017, doi:10.1111/biom.12666). Each stream's noise is of one size, and may be correlated as
`x_k = ρ x_k-1 + u_k`. Then sums r_k + r_k-1 and differences r_k - r_k-1 are uncorrelated, and have variances of their
own, v± = 2 σ² (1 ± ρ), which follow by the same update; the trajectory takes more of sums:

    v± <- v± · Σ s±² / ((1 ∓ ρ) N / 2 - tr(H⁻¹ H±)),      ρ <- (v+ - v-) / (v+ + v-)

with s± the halves of innovations that they make (`ident.estimation.whitening`) and H± = Σ (∂s±)ᵀ ∂s±. Were nothing
taken, this would be Burg's estimate, with which ρ begins where it is more than chance.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.estimation.piece import Linearised, Misfit, Noise

LEAST_LEFT = 0.05
"""Share of a stream's samples that is left over for its noise, however many unknowns they determine."""

MOST_CORRELATED = 0.99
"""Cap of ρ; beyond it the mean of a channel is free."""

CHANCE, WHITE_AGAIN = 2.0, 1.0
"""Correlation, in standard deviations of that of white noise, up to which what seemed to be white noise stays that, and
below which what seemed to be correlated does not any more."""

COLOURED_FLOOR = 15.0
"""How many times higher the floor of a channel's noise is where that is wholly correlated: then the model is not quite
right, and what the trajectory takes of the channel is no measure of its noise."""

FURTHEST, LONGEST = 4.0, 3.0
"""How many times the steps of log λ that updates ask for are lengthened at most, and how long that may make them."""

PACED = 0.005
"""Steps of log λ up to which they are taken as they are: what they differ by is not their slope any more."""

ALIKE = 0.1
"""Least noise of a component over the median of those that the same sensor measures in the same unit."""

TINY, TINIEST = 1e-3, 1e-300
"""What counts of samples and sums of squares do not fall below."""


def renewed(noise: Noise, parts: Sequence[Linearised], misfits: Sequence[Misfit], *, coloured: bool) -> Noise:
    """Restricted-likelihood updates of standard deviations and smoothness, and of the correlation if it is asked for.

    Args:
        noise: What it was.
        parts: The pieces at the last iterate.
        misfits: How far they are from what was measured after the step: before it, they are as noise before says.
        coloured: Whether to update the correlation.
    """
    taken, held = (np.sum([getattr(part, k) for part in parts], axis=0) for k in ("taken", "held"))
    squares, number, bends, rank = (
        np.sum([getattr(each, k) for each in misfits], axis=0) for k in ("squares", "number", "bends", "rank")
    )
    left = np.maximum(number - taken, np.maximum(LEAST_LEFT * number, TINY))
    growth = np.where(number > 0, squares / left, 1.0)
    shape, states = noise.states.shape, noise.states.size
    of_states, of_channels = growth[:, :states].reshape(3, *shape), growth[:, states:]
    floor = noise.floor_channels * (1 + COLOURED_FLOOR * noise.channels_rho**2)
    for group in set(noise.alike):
        own = np.array(noise.alike) == group
        floor[own] = np.maximum(floor[own], ALIKE * np.median(noise.channels[own]))
    new = {
        "states": np.maximum(noise.states * np.sqrt(of_states[0]), noise.floor_states),
        "channels": np.maximum(noise.channels * np.sqrt(of_channels[0]), floor),
        "jerk": np.maximum(rank - held, TINY) / np.maximum(bends, TINIEST),
    }
    if coloured:
        linked = number[1:].sum(axis=0)
        new["states_rho"] = _correlation(noise.states_rho, of_states[1:], linked[:states].reshape(shape))
        new["channels_rho"] = _correlation(noise.channels_rho, of_channels[1:], linked[states:])
    return replace(noise, **new)


class Stride(NamedTuple):
    """Where λ of each coordinate was, and by how much its update would change it: logarithms (n,)."""

    place: np.ndarray
    step: np.ndarray


def hastened(before: Stride | None, now: Stride) -> np.ndarray:
    """λ of each coordinate by a step as much longer than its update's as the last two have told, none shorter (n,).

    What is known little, or moves little, is told of by updates that shrink slowly, each coordinate's at its own pace.
    """
    longer = np.ones_like(now.step)
    if before is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = (before.place - now.place) / (now.step - before.step)
        told = (now.step * before.step > 0) & (np.abs(now.step) > PACED)
        longer = np.where(told, np.clip(np.where(secant > 0, secant, FURTHEST), 1, FURTHEST), 1.0)
    most = np.maximum(np.abs(now.step), LONGEST)
    return np.exp(now.place + np.clip(longer * now.step, -most, most))


def _correlation(rho: np.ndarray, growth: np.ndarray, linked: np.ndarray) -> np.ndarray:
    """ρ from what it was, and by which factors the variances of sums and of differences change.

    Args:
        rho: What it was (…).
        growth: These factors (2, …); the variances were as 1 + ρ to 1 - ρ.
        linked: How many samples follow another one (…).
    """
    sums, differences = growth[0] * (1 + rho), growth[1] * (1 - rho)
    # Of what leaves nothing, both are zero.
    new = (sums - differences) / np.maximum(sums + differences, TINIEST)
    white = new < np.where(rho == 0, CHANCE, WHITE_AGAIN) / np.sqrt(np.maximum(linked, 1))
    return np.where(white, 0.0, np.clip(new, 0, MOST_CORRELATED))
