"""What of the set-up is not as stated: set-up parameters are fitted one by one, the most significant first."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from ident.errors import ExcitationError
from ident.estimation.joint_fit import JointFit, Start
from ident.estimation.left_out import clearly_better, costs, gains
from ident.tolerances import SIGNIFICANT

MOST_FOUND = 10
"""Set-up parameters that are fitted at most."""

ALIKE, ALIKE_SHARE = 15.0, 0.1
"""How much less of χ², or which share of it, another candidate may explain than the best and be meant as well."""

INCREDIBLE = 6.0
"""Standard deviations of its prior from which a set-up parameter stands for something else that is wrong."""

NEGLIGIBLE = 0.04
"""Standard deviations of its prior below which a set-up parameter is not worth a word, however well it is known."""

PROMISING = 2.5
"""Standard deviations from which a set-up parameter is tried: while it is not fitted, its effect passes for noise."""

SEARCH_ROUNDS = 40
"""Rounds of each fit of the search."""


@dataclass(frozen=True)
class Deviation:
    """A set-up parameter that is not zero.

    Attributes:
        index: Where it stands in θ.
        alternatives: Others that would have explained about as much.
        together: Groups of others that would have, all changed by as much.
    """

    index: int
    alternatives: tuple[int, ...]
    together: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Search:
    """What of the set-up was found.

    Attributes:
        fit: The fit with it.
        deviations: What is not as stated, the most significant first.
        incredible: Whether more would have been needed than any laboratory gets wrong; then nothing is changed.
    """

    fit: JointFit
    deviations: tuple[Deviation, ...] = ()
    incredible: bool = False


Refit = Callable[[Start, np.ndarray, int], JointFit]
"""Fits from a start, with given parameters free (p,), in at most so many rounds."""


def searched(
    first: Search,
    refit: Refit,
    candidates: np.ndarray,
    groups: Mapping[str, np.ndarray],
    scattered: Callable[[JointFit], JointFit],
    least: np.ndarray | float = 0.0,
) -> Search:
    """Frees set-up parameters as long as one is significant and predicts pieces better that are left out.

    Args:
        first: The fit with the set-up as stated, or as far as it was found.
        refit: What fits again.
        candidates: Which parameters are of the set-up (p,).
        groups: Directions in which several change alike, by what they are (p,) each.
        scattered: Gives a fit the covariance under the noise that is really there.
        least: Sizes below which parameters are not believed (p,), besides those not worth a word.
    """
    fitted, deviations = first.fit, list(first.deviations)
    # All candidates together raise a false alarm as rarely as one test does.
    threshold = -float(special.ndtri(SIGNIFICANT / 2 / max(candidates.sum(), 1)))
    known = 1 / np.sqrt(np.maximum(np.diag(fitted.prior.known), 1e-300))
    least = np.maximum(NEGLIGIBLE * known, least)
    while len(deviations) < MOST_FOUND and fitted.status != "interrupted":
        left = np.flatnonzero(candidates & ~fitted.free)
        if not len(left):
            break
        values, spread = fitted.scores(np.eye(len(candidates))[left])
        likely = (np.abs(values) > least[left]) & (np.abs(values / spread) > PROMISING)
        likely[likely] = _predict(fitted, left[likely].tolist())
        if not likely.any():
            break
        # By what each explains: while none is fitted, their effects pass for noise and make all as significant.
        working = replace(fitted, scatters=None)
        z = np.where(likely, np.abs(values / working.scores(np.eye(len(candidates))[left])[1]), 0.0)
        best = int(np.argmax(z))
        close = np.sqrt(max(z[best] ** 2 - max(ALIKE, ALIKE_SHARE * z[best] ** 2), PROMISING**2))
        alike = sorted((k for k in np.flatnonzero(z > close) if k != best), key=lambda k: -z[k])
        found = Deviation(int(left[best]), tuple(left[alike].tolist()), _together(working, groups, close))
        theta = fitted.theta.copy()
        theta[found.index] += values[best]
        free = fitted.free | (np.arange(len(theta)) == found.index)
        try:
            tried = scattered(refit(replace(fitted.end, theta=theta), free, SEARCH_ROUNDS))
        except ExcitationError:
            return replace(first, incredible=True)
        if not abs(tried.theta[found.index]) > threshold * np.sqrt(tried.covariance[found.index, found.index]):
            break
        if (np.abs(tried.theta) > INCREDIBLE * known)[candidates].any():
            return replace(first, incredible=True)
        fitted = tried
        deviations.append(found)
    return replace(first, fit=fitted, deviations=tuple(deviations))


def _predict(fitted: JointFit, candidates: Sequence[int]) -> list[bool]:
    """True for parameters with which pieces that are left out are predicted better than with them held."""
    try:
        held = costs(fitted, fitted.free)
    except ExcitationError:
        return [False] * len(candidates)

    def better(candidate: int) -> bool:
        try:
            return clearly_better(gains(fitted, candidate, held))
        except ExcitationError:
            return False

    return [better(candidate) for candidate in candidates]


def _together(fitted: JointFit, groups: Mapping[str, np.ndarray], least: float) -> tuple[str, ...]:
    """Groups of parameters, none of which was fitted, that are as significant."""
    open_ = {name: direction for name, direction in groups.items() if not direction[fitted.free].any()}
    if not open_:
        return ()
    values, spread = fitted.scores(np.array(list(open_.values())))
    return tuple(name for name, z in zip(open_, np.abs(values / spread), strict=True) if z > least)
