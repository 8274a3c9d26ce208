"""Search for set-up errors and further friction, one by one, and for those of a group that explain nothing alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy import special

from ident.errors import ExcitationError
from ident.tolerances import SIGNIFICANT
from ident.trajectory.fit.fitted import Start, TrajectoryFit
from ident.trajectory.late_start import BETTER
from ident.trajectory.left_out import clearly_better, costs, gains

MOST_DEVIATIONS = 10
"""Largest number of parameters that are found by the search."""

ALIKE, ALIKE_SHARE = 15.0, 0.1
"""Deficit in χ² from the best candidate, absolute or as a share, up to which another one is an alternative."""

INCREDIBLE = 6.0
"""Size of a set-up parameter, in standard deviations of its prior, above which another error must be the cause."""

NEGLIGIBLE = 0.04
"""Size of a set-up parameter, in standard deviations of its prior, below which it is negligible even if significant."""

PROMISING = 2.5
"""Score, in standard deviations, above which a parameter is tried: low, because the effect of a parameter that
is not fitted increases the noise."""

IDLE = 4.0
"""Standard deviations below which a long delay is removed again, about the significance level of a search among many
candidates."""

SEARCH_ROUNDS = 40
"""Largest number of rounds of each fit of the search."""


@dataclass(frozen=True)
class Deviation:
    """A set-up parameter that is not zero.

    Attributes:
        index: Index in θ.
        alternatives: Other parameters that would explain about as much.
        together: Groups of parameters that would, all changed by the same amount.
        gross: True if it lies beyond what is stated and has a wider prior.
    """

    index: int
    alternatives: tuple[int, ...]
    together: tuple[str, ...] = ()
    gross: bool = False

    def renumbered(self, new: Mapping[int, int]) -> "Deviation":
        """The same with other indices."""
        return replace(self, index=new[self.index], alternatives=tuple(new[k] for k in self.alternatives))


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a search for set-up errors.

    Attributes:
        fit: The fit with the set-up errors.
        deviations: Set-up errors, the most significant first.
        incredible: True if errors beyond `INCREDIBLE` were needed; then nothing is changed.
    """

    fit: TrajectoryFit
    deviations: tuple[Deviation, ...] = ()
    incredible: bool = False


Refit = Callable[[Start, np.ndarray, int], TrajectoryFit]
"""Function that fits from a start with given parameters free (p,) in a largest number of rounds."""

Delays = Mapping[int, Callable[[TrajectoryFit], float]]
"""Functions that return a long delay that a fit may lack, zero for none, by its index in θ."""


def searched(
    first: Search,
    refit: Refit,
    candidates: np.ndarray,
    groups: Mapping[str, np.ndarray],
    least: np.ndarray | float = 0.0,
    drives: np.ndarray | None = None,
    delays: Delays = MappingProxyType({}),
    gross: np.ndarray | float = 0.0,
) -> Search:
    """Frees parameters as long as one is significant and improves the prediction of left-out pieces.

    Args:
        first: The fit with the set-up as stated, or as estimated so far.
        refit: Function that fits again, with the covariance under the estimated noise.
        candidates: Mask of the set-up parameters (p,).
        groups: Directions in which several parameters change alike, by description (p,) each.
        least: Sizes below which parameters are rejected (p,), in addition to `NEGLIGIBLE`.
        drives: Mask of drives to try beside them, which are not negative and have no prior (p,).
        delays: Long delays to try before, of which those that later ones make needless are removed again.
        gross: Standard deviations of errors beyond what is stated, zero for none (p,).
    """
    first = _with_long_delays(first, refit, delays)

    def incredible() -> Search:
        none = np.zeros_like(candidates)
        return replace(searched(first, refit, none, {}, drives=drives), incredible=True)

    fitted, deviations = first.fit, list(first.deviations)
    drives = np.zeros_like(candidates) if drives is None else drives
    # Bonferroni: the chance of a false alarm is that of one test for all candidates together.
    threshold = -float(special.ndtri(SIGNIFICANT / 2 / max((candidates | drives).sum(), 1)))
    known = 1 / np.sqrt(np.maximum(np.diag(fitted.prior.known), 1e-300))
    least = np.where(drives, 0.0, np.maximum(NEGLIGIBLE * known, least))
    gross = np.broadcast_to(gross, known.shape)
    while fitted.free.sum() - first.fit.free.sum() < MOST_DEVIATIONS and fitted.status != "interrupted":
        left = np.flatnonzero((candidates | drives) & ~fitted.free)
        if not len(left):
            break
        beyond = left[gross[left] > 0]
        moves = _loosened(fitted, beyond, gross).scores(np.eye(len(known))[beyond])[0]
        beyond = beyond[np.abs(moves) > INCREDIBLE * known[beyond]]
        loose = _loosened(fitted, beyond, gross)
        values, spread = loose.scores(np.eye(len(candidates))[left])
        likely = (np.where(drives[left], values, np.abs(values)) > least[left]) & (np.abs(values / spread) > PROMISING)
        likely[likely] = [clearly_better(each) for each in gains(loose, left[likely].tolist())]
        if not likely.any():
            members, tried = _tried_together(fitted, refit, groups, np.where(candidates, least, np.inf), threshold)
            if not members:
                break
            if (np.abs(tried.theta) > INCREDIBLE * known)[candidates].any():
                return incredible()
            fitted = tried
            deviations += [Deviation(member, ()) for member in members]
            continue
        # Ranked by χ² under the working model: while errors are not fitted, the noise estimate includes their effects
        # and makes all candidates about equally significant.
        working = replace(loose, scatters=None)
        z = np.where(likely, np.abs(values / working.scores(np.eye(len(candidates))[left])[1]), 0.0)
        best = int(np.argmax(z))
        close = np.sqrt(max(z[best] ** 2 - max(ALIKE, ALIKE_SHARE * z[best] ** 2), PROMISING**2))
        # What explains as much within what is stated is more likely.
        within = np.where(np.isin(left, beyond), 0.0, z)
        best = int(np.argmax(within if within.max() > close else z))
        alike = sorted((k for k in np.flatnonzero((z > close) & candidates[left]) if k != best), key=lambda k: -z[k])
        index = int(left[best])
        own = beyond[beyond == index]
        deviation = Deviation(
            index, tuple(left[alike].tolist()), tuple(_together(working, groups, close)), len(own) > 0
        )
        try:
            tried = _fit_from(_loosened(fitted, own, gross), refit, index, fitted.theta[index] + values[best])
        except ExcitationError:
            return incredible()
        if not abs(tried.theta[index]) > threshold * np.sqrt(tried.covariance[index, index]):
            break
        known = np.where(np.arange(len(known)) == index, np.where(len(own), gross, known), known)
        if (np.abs(tried.theta) > INCREDIBLE * known)[candidates].any():
            return incredible()
        fitted = tried
        deviations += [deviation] * bool(candidates[index])
    return _without_idle(replace(first, fit=fitted, deviations=tuple(deviations)), refit, delays)


def _fit_from(
    fit: TrajectoryFit, refit: Refit, at: int | Sequence[int], value: float | np.ndarray, *, free: bool = True
) -> TrajectoryFit:
    """Fit that starts from another value of some parameters, by their indices, which are free or fixed."""
    own = np.isin(np.arange(len(fit.theta)), at)
    start = replace(fit.end, theta=np.where(own, value, fit.theta))
    return refit(start, np.where(own, free, fit.free), SEARCH_ROUNDS)


def _tried_together(
    fit: TrajectoryFit, refit: Refit, groups: Mapping[str, np.ndarray], least: np.ndarray, threshold: float
) -> tuple[list[int], TrajectoryFit]:
    """Parameters of a group, none of which explains anything alone, as tilts of parallel axes, and the fit with them.

    They move by more than `least` (p,), and one of them by more than a number of standard deviations. Without such a
    group there are none, and the fit is as it was.
    """
    for step in _together(fit, groups, PROMISING).values():
        own = step != 0
        if (np.abs(step) <= least)[own].any() or not clearly_better(costs(fit, fit.free) - costs(fit, fit.free | own)):
            continue
        members = np.flatnonzero(own).tolist()
        try:
            tried = _fit_from(fit, refit, members, fit.theta + step)
        except ExcitationError:
            continue
        if (np.abs(tried.theta) > threshold * np.sqrt(np.diag(tried.covariance)))[own].any():
            return members, tried
    return [], fit


def _loosened(fit: TrajectoryFit, at: np.ndarray, std: np.ndarray) -> TrajectoryFit:
    """Fit with other standard deviations (p,) of the prior of some set-up parameters, by their indices."""
    return replace(fit, prior=fit.prior.loosened(at, std)) if len(at) else fit


def _with_long_delays(search: Search, refit: Refit, delays: Delays) -> Search:
    """Search with the long delays with which the channels' noise is smaller."""
    for at, likely in delays.items():
        fit = search.fit
        if fit.free[at] or fit.status == "interrupted" or not (delay := likely(fit)):
            continue
        try:
            late = _fit_from(fit, refit, at, delay)
        except ExcitationError:
            continue
        better = np.log(late.channel_noise / fit.channel_noise).mean() < np.log(BETTER)
        if better or late.status == "interrupted":
            search = replace(search, fit=late, deviations=(*search.deviations, Deviation(at, ())))
    return search


def _without_idle(search: Search, refit: Refit, delays: Delays) -> Search:
    """Search without long delays that are no longer significant because a clock error, fitted later, explains them."""
    fit, ours = search.fit, [each.index for each in search.deviations if each.index in delays]
    idle = [at for at in ours if abs(fit.theta[at]) < IDLE * np.sqrt(fit.covariance[at, at])]
    if not idle or fit.status == "interrupted":
        return search
    kept = tuple(each for each in search.deviations if each.index not in idle)
    return replace(search, fit=_fit_from(fit, refit, idle, 0.0, free=False), deviations=kept)


def _together(fitted: TrajectoryFit, groups: Mapping[str, np.ndarray], least: float) -> dict[str, np.ndarray]:
    """Steps (p,) of the groups without fitted parameters whose score exceeds `least`, by description."""
    open_ = {name: direction for name, direction in groups.items() if not direction[fitted.free].any()}
    if not open_:
        return {}
    values, spread = fitted.scores(np.array(list(open_.values())))
    steps = zip(open_, values, np.abs(values / spread), strict=True)
    return {name: value * open_[name] for name, value, z in steps if z > least}
