"""Search for set-up errors and further friction, one by one, and for those of a group that explain nothing alone.

A group is tested by the step in its direction d: |d · θ| over its standard deviation.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy import special

from ident.errors import ExcitationError
from ident.tolerances import SIGNIFICANT
from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.left_out import Move, after, clearly_better, gains, moved
from ident.trajectory.start import BETTER

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


Refit = Callable[[TrajectoryFit], TrajectoryFit]
"""Function that fits the free parameters again from a starting point."""

Delays = Mapping[int, Callable[[TrajectoryFit], float]]
"""Functions that return a long delay that a fit may lack, zero for none, by its index in θ."""


class Step(NamedTuple):
    """Parameters to free together.

    Attributes:
        fit: The fit before, its prior wider for an error beyond what is stated.
        direction: Direction in which they change (p,).
        size: Likely change.
        deviations: What they are, without drives.
    """

    fit: TrajectoryFit
    direction: np.ndarray
    size: float
    deviations: tuple[Deviation, ...]

    def taken(self, search: Search, refit: Refit) -> Search:
        """Search with these parameters."""
        fit = _fit_from(self.fit, refit, self.direction != 0, self.fit.theta + self.size * self.direction)
        return replace(search, fit=fit, deviations=(*search.deviations, *self.deviations))

    def is_significant(self, search: Search, threshold: float) -> bool:
        """True if they change in its fit by more than a number of their standard deviations."""
        std = np.sqrt(self.direction @ search.fit.covariance @ self.direction)
        return bool(abs(self.direction @ search.fit.theta) > threshold * std)


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """Parameters that may be freed.

    Attributes:
        setup: Mask of those of the set-up (p,).
        drives: Mask of drives, which are not negative and have no prior (p,).
        least: Sizes below which they are rejected (p,), in addition to `NEGLIGIBLE`.
        gross: Standard deviations of errors beyond what is stated, zero for none (p,).
        groups: Directions in which several change together, by description (p,) each.
    """

    setup: np.ndarray
    drives: np.ndarray
    least: np.ndarray
    gross: np.ndarray
    groups: Mapping[str, np.ndarray]

    def alone(self, fit: TrajectoryFit) -> Step | None:
        """The one that explains most."""
        unit, known = np.eye(len(fit.theta)), _known(fit)
        left = np.flatnonzero((self.setup | self.drives) & ~fit.free)
        beyond = left[self.gross[left] > 0]
        moves = _loosened(fit, beyond, self.gross).scores(unit[beyond])[0]
        beyond = beyond[np.abs(moves) > INCREDIBLE * known[beyond]]
        loose = _loosened(fit, beyond, self.gross)
        values, z = self._promising(loose, unit[left])
        if not z.any():
            return None
        # Ranked by χ² under the working model: while errors are not fitted, the noise estimate includes their effects
        # and makes all candidates about equally significant.
        working = replace(loose, scatters=None)
        z = np.where(z > 0, np.abs(values / working.scores(unit[left])[1]), 0.0)
        close = np.sqrt(max(z.max() ** 2 - max(ALIKE, ALIKE_SHARE * z.max() ** 2), PROMISING**2))
        # What explains as much within what is stated is more likely.
        within = np.where(np.isin(left, beyond), 0.0, z)
        best = int(np.argmax(within if within.max() > close else z))
        index = int(left[best])
        alike = [k for k in np.argsort(-z, kind="stable") if z[k] > close and self.setup[left[k]] and k != best]
        together, directions = self._open_groups(fit)
        explain = np.abs(np.divide(*working.scores(directions))) > close
        names = tuple(name for name, also in zip(together, explain, strict=True) if also)
        own = beyond[beyond == index]
        deviation = Deviation(index, tuple(left[alike].tolist()), names, len(own) > 0)
        return Step(_loosened(fit, own, self.gross), unit[index], values[best], (deviation,) * bool(self.setup[index]))

    def together(self, fit: TrajectoryFit) -> Step | None:
        """The group that explains most, as tilts of parallel axes, of which none may explain anything alone."""
        _, directions = self._open_groups(fit)
        values, z = self._promising(fit, directions)
        if not z.any():
            return None
        best = directions[z.argmax()]
        return Step(fit, best, values[z.argmax()], tuple(Deviation(k, ()) for k in np.flatnonzero(best).tolist()))

    def _open_groups(self, fit: TrajectoryFit) -> tuple[list[str], np.ndarray]:
        """Descriptions and directions (k, p) of the groups of which nothing was fitted."""
        names = [name for name, direction in self.groups.items() if not direction[fit.free | ~self.setup].any()]
        return names, np.array([self.groups[name] for name in names]).reshape(-1, len(fit.theta))

    def _promising(self, fit: TrajectoryFit, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps in some directions (k, p), and their scores in standard deviations, zero for those not worth a fit."""
        values, spread = fit.scores(directions)
        steps, z = values[:, None] * directions, np.abs(values / spread)
        sizes = np.where(self.drives, steps, np.abs(steps))
        likely = (sizes > self.least).any(axis=1) & (z > PROMISING)
        likely[likely] = [clearly_better(each) for each in gains(fit, directions[likely] != 0)]
        return values, np.where(likely, z, 0.0)


def searched(first: Search, refit: Refit, space: SearchSpace, delays: Delays = MappingProxyType({})) -> Search:
    """Frees parameters as long as some are significant and improve the prediction of left-out pieces.

    Args:
        first: The fit with the set-up as stated, or as estimated so far.
        refit: Function that fits again, with the covariance under the estimated noise.
        space: Parameters that may be freed; groups of more than `MOST_DEVIATIONS` are neither tried nor alternatives.
        delays: Long delays to try before, of which those that later ones make needless are removed again.
    """
    first = _with_long_delays(first, refit, delays)
    groups = {name: each for name, each in space.groups.items() if np.count_nonzero(each) <= MOST_DEVIATIONS}
    # Bonferroni: the chance of a false alarm is that of one test for all candidates together.
    tests = max((space.setup | space.drives).sum() + len(groups), 1)
    threshold = -float(special.ndtri(SIGNIFICANT / 2 / tests))
    least = np.where(space.drives, 0.0, np.maximum(NEGLIGIBLE * _known(first.fit), space.least))
    every = replace(space, least=least, groups=groups)

    def proposed(search: Search) -> Move[Search] | None:
        if search.fit.free.sum() - first.fit.free.sum() >= MOST_DEVIATIONS:
            return None
        step = every.alone(search.fit) or every.together(search.fit)
        if step is None:
            return None

        def taken() -> Search:
            try:
                return step.taken(search, refit)
            except ExcitationError:
                raise _IncredibleError from None

        def kept(tried: Search) -> bool:
            significant = step.is_significant(tried, threshold)
            if significant and (np.abs(tried.fit.theta) > INCREDIBLE * _known(tried.fit))[space.setup].any():
                raise _IncredibleError
            return significant

        return Move(taken, kept)

    try:
        return _without_idle(moved(first, proposed), refit, delays, threshold)
    except _IncredibleError:
        drives_alone = replace(space, setup=np.zeros_like(space.setup), groups={})
        return replace(searched(first, refit, drives_alone), incredible=True)


class _IncredibleError(Exception):
    """Errors beyond `INCREDIBLE` are needed."""


def _known(fit: TrajectoryFit) -> np.ndarray:
    """Standard deviations of the parameters by their prior, huge for those without (p,)."""
    return 1 / np.sqrt(np.maximum(np.diag(fit.prior.known), 1e-300))


def _fit_from(
    fit: TrajectoryFit, refit: Refit, own: np.ndarray, value: float | np.ndarray, *, free: bool = True
) -> TrajectoryFit:
    """Fit that starts from another value of some parameters, by their mask, which are free or fixed."""
    return refit(replace(fit, theta=np.where(own, value, fit.theta), free=np.where(own, free, fit.free)))


def _loosened(fit: TrajectoryFit, at: np.ndarray, std: np.ndarray) -> TrajectoryFit:
    """Fit with other standard deviations (p,) of the prior of some set-up parameters, by their indices."""
    return replace(fit, prior=fit.prior.loosened(at, std)) if len(at) else fit


def _with_long_delays(search: Search, refit: Refit, delays: Delays) -> Search:
    """Search with the long delays with which the channels' noise is smaller."""
    for at, likely in delays.items():
        if not search.fit.free[at] and search.fit.status != "interrupted" and (delay := likely(search.fit)):
            search = after(search, _long_delay(search, refit, at, delay))
    return search


def _long_delay(search: Search, refit: Refit, at: int, delay: float) -> Move[Search]:
    """A long delay that a fit lacks, by its index in θ."""
    fit = search.fit

    def late() -> Search:
        later = _fit_from(fit, refit, np.arange(len(fit.theta)) == at, delay)
        return replace(search, fit=later, deviations=(*search.deviations, Deviation(at, ())))

    return Move(late, lambda tried: np.log(tried.fit.channel_noise / fit.channel_noise).mean() < np.log(BETTER))


def _without_idle(search: Search, refit: Refit, delays: Delays, threshold: float) -> Search:
    """Search without long delays that are no longer significant because a clock error, fitted later, explains them."""
    fit, ours = search.fit, [each.index for each in search.deviations if each.index in delays]
    idle = [at for at in ours if abs(fit.theta[at]) < threshold * np.sqrt(fit.covariance[at, at])]
    if not idle or fit.status == "interrupted":
        return search
    kept = tuple(each for each in search.deviations if each.index not in idle)
    return replace(
        search, fit=_fit_from(fit, refit, np.isin(np.arange(len(fit.theta)), idle), 0.0, free=False), deviations=kept
    )
