"""Stages of the trajectory estimate: knots, friction near reversals, noise model, set-up, and confidence intervals.

1. Knots are made denser as long as the channels' noise, taken as white, decreases: jumps need denser knots, but model
   errors do not decrease with them.
2. Torques near reversals get an additional variance (`ident.trajectory.reversals`).
3. Noise is taken as correlated over time if left-out pieces are then predicted better.
4. Set-up errors are searched for (`ident.trajectory.setup_search`).
5. Standard deviations follow from noise estimated independently of the weights (`ident.trajectory.fit.sandwich`).
6. The estimate converges (`SETTLED`): fits before it end once what they decide would not change any more (`NEAR`).
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from ident.errors import ExcitationError, InputError
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import Part, length
from ident.estimation.setup_parameters import SetupParameter
from ident.trajectory.alternatives import better, correlated
from ident.trajectory.bounded_fits import physical_fit, with_positive
from ident.trajectory.cut_pieces import cut
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import Prior, Start, TrajectoryFit
from ident.trajectory.fit.iteration import NEAR, SETTLED, Report, Tolerance
from ident.trajectory.fit.noise_colours import ENOUGH
from ident.trajectory.fit.piece import Piece, residual
from ident.trajectory.fit.repeats import repeating
from ident.trajectory.fit.sandwich import by_samples, with_scatter
from ident.trajectory.left_out import CLEARLY
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import Reversals, at_first, likeliest, rubbing, speeds
from ident.trajectory.setup_search import Deviation, Refit, Search, searched
from ident.trajectory.start import likely_delay, smoothed, start

EXPLORED = 6
"""Rounds of a fit by which knots are chosen: its noise is then accurate to some per cent."""

SMALLER = 0.985
"""Geometric mean of the channels' noise, over that with half as many knots, below which denser ones are used."""

MUCH = 0.7
"""The same ratio below which knots are made four times as dense at once, as for a joint with friction."""

TRIES = 2
"""Number of knot spacings tried without a decrease of the noise, where residuals are correlated over less than the knot
spacing: a single halving may be too little to follow a touch."""

WORTH_A_PRIOR = 0.1
"""Decrease of the mean log error of left-out pieces with which exploring fits take a prior. It stands in for errors of
the set-up, too, which are found later: somebody who bows gains .06 and is predicted worse with it in the end, a UR10
gains .06 and is predicted alike; of three people who lift, whose bodies the data hardly tell, two gain .15 and .26.
"""

MAJORITY, FAR_LESS = 0.5, 30.0
"""Share of the channels that must be predicted for pieces to decide on a prior; and standard deviations from the data,
over those of the prior, above which it is used otherwise: noise, or a contact left out, can pass for excitation."""

WEIGHED = 20
"""Rounds after which white and correlated noise are compared, before the fit with the better one goes on."""

HOPELESS, STEADY, FAR_WORSE = 5, 2.0, 0.7
"""Rounds after which correlated noise that does not predict clearly better is given up, step of θ, in standard
deviations, below which it then is, and increase of the mean log error from which it is anyway: of seven recordings six
were decided by then. A person who bows gains in the end, from an increase of .22 while θ moves by five; an arm that
rubs ends at 1.00, from 1.03 while θ moves by 24."""

OVERRATED = 2.0
"""Variance of the recordings' gradient over that of the working model from which the prior is weighted up."""

KNOTS_PER_SAMPLE, SLACK = 2.0, 1e-6
"""Least number of samples per knot, and relative tolerance of that limit."""

ROUGHER = 1e3
"""Factor by which smoothness that was estimated while set-up errors were in the residuals begins lower than it ended.
The height of a person's pelvis was held smooth at 10^5.0 then, and stayed there (from a thirtieth of it, too), where
10^1.6 explains the vertical force: 52 instead of 92 % of the 95 % intervals held with all of the set-up known.
"""

UNFOLLOWED = 0.125
"""Apparent time shift, over the knot spacing, due to jumps that knots cannot follow: motions with trapezoidal
velocities at 100 Hz, otherwise exact, gave spurious clock errors with shifts of a twentieth."""

LEAST_PIECES, SHORTEST = 6, (2.0, 0.5)
"""Least number of pieces of all recordings together, for prediction of some from the others; and shortest length of
such a piece, s, of all of a recording and of a share of it: at a cut accelerations depend on one side only, but few
samples span more of the motion in many pieces."""


@dataclass(frozen=True, eq=False)
class Stages:
    """Stages of the trajectory estimate of given recordings.

    Attributes:
        measurement: Channels, and the parameters of one recording.
        recordings: Parts of recordings to fit.
        names: Names of all parameters.
        setup: Those of the set-up by index.
        selections: Indices of each recording's parameters among all.
        prior: Prior of all parameters.
        known: True if it includes a prior of the model's parameters.
        search: True to search for set-up errors.
        executor: Executor for the pieces, None to compute them here.
        report: Called with every round.
    """

    measurement: Measurement
    recordings: Sequence[Part[slice]]
    names: Sequence[str]
    setup: Mapping[int, SetupParameter]
    selections: Sequence[np.ndarray]
    prior: Prior
    known: bool
    search: bool
    executor: Executor | None
    report: Report | None

    @cached_property
    def is_setup(self) -> np.ndarray:
        """Mask of the parameters that belong to the set-up (p,)."""
        return np.isin(np.arange(len(self.names)), list(self.setup))

    @cached_property
    def is_estimated(self) -> np.ndarray:
        """Mask of the set-up parameters that are estimated without a search (p,)."""
        return np.isin(np.arange(len(self.names)), [k for k, each in self.setup.items() if each.estimated])

    def explored(self, steps: Sequence[float], share: int, finest: Sequence[float]) -> TrajectoryEstimate:
        """Exploring fit with white noise and the densest knots that still decrease the noise of a recording notably.

        Args:
            steps: Initial knot spacing of each recording, s.
            share: Step k: every k-th piece of each recording is used; half of it where these do not determine θ.
            finest: Smallest knot spacing of each, s.
        """
        try:
            best = last = self._begun(steps, share)
        except ExcitationError:
            if share == 1:
                raise
            return self.explored(steps, share // 2, finest)
        near, far = correlated(best)
        patience = np.where((near & ~far).any(axis=1), TRIES, 1)
        tries, parts = np.where(near.any(axis=1), patience, 0), np.full(len(patience), 2)
        chosen, noise = np.array(steps), _log_noise(best)
        try:
            while (tried := (tries > 0) & (np.array(last.steps) > finest)).any() and last.fit.status != "interrupted":
                # Rounded down to the smallest one if nearly as small.
                pairs = zip(last.steps / parts, finest, strict=True)
                denser = [least if own < np.sqrt(2) * least else own for own, least in pairs]
                last = self._denser(last, np.where(tried, denser, chosen).tolist(), share)
                ratio = np.exp((_log_noise(last) - noise).mean(axis=1))
                better, parts = tried & (ratio < SMALLER), np.where(ratio < MUCH, 4, 2)
                chosen, noise = np.where(better, last.steps, chosen), np.where(better[:, None], _log_noise(last), noise)
                tries = np.where(better, patience, tries - tried)
                best = last if (chosen == last.steps).all() else best
            if (chosen != best.steps).any() and last.fit.status != "interrupted":
                return self._denser(last, chosen.tolist(), share)
        except (ExcitationError, np.linalg.LinAlgError):
            pass
        return last if last.fit.status == "interrupted" else best

    def _begun(self, steps: Sequence[float], share: int) -> TrajectoryEstimate:
        pieces, selected, counts = self._cut(steps, share)
        # A moving base is followed by cameras, whose errors last; encoders have none that do.
        alone = smoothed(pieces, coloured=self.measurement.of_base > 0, executor=self.executor)
        theta = self.prior.mean[: len(self.measurement.names)]
        reversals = None
        if rubbing(self.measurement.equations):
            rates = [speeds(self.measurement, *pair, theta) for pair in zip(pieces, alone.coefficients, strict=True)]
            reversals = at_first(self.measurement.equations, [piece.signal for piece in pieces], rates)
            pieces = reversals.opened(pieces, rates)
        at = self._start(pieces, selected, alone)
        fit = self._refit(pieces, selected)(at, ~self.is_setup | self.is_estimated, EXPLORED)
        stated = tuple(Deviation(k, ()) for k, each in self.setup.items() if each.row.stated)
        how = Search(fit, stated), counts, tuple(steps), self.known
        return TrajectoryEstimate(self.measurement, *how, reversals=reversals, setup=self.setup)

    def _start(self, pieces: Sequence[Piece], selected: Sequence[np.ndarray], alone: Start) -> Start:
        """Starting point: coordinates smoothed alone, and parameters by least squares, equal in all recordings."""
        p, free = len(self.measurement.names), ~self.is_setup
        prior = self.prior.mean[:p], self.prior.precision[:p, :p]
        begin = start(self.measurement, pieces, alone, prior, free[:p])
        theta = self.prior.mean.copy()
        for chosen in selected:
            theta[chosen] = begin.theta
        return Start(theta, begin.noises, begin.coefficients)

    def _denser(self, coarse: TrajectoryEstimate, steps: Sequence[float], share: int) -> TrajectoryEstimate:
        """Exploring fit with other knots, warm-started from another one."""
        pieces, selected, _ = self._cut(steps, share)
        was = coarse.fit
        places = [
            old.spline.refined(c, new.spline) for old, new, c in zip(was.pieces, pieces, was.coefficients, strict=True)
        ]
        pieces = [replace(new, slack=old.slack) for new, old in zip(pieces, was.pieces, strict=True)]
        at = Start(was.theta, was.noises, places)
        fit = self._refit(pieces, selected)(at, was.free, EXPLORED)
        return replace(coarse.with_fit(fit), steps=tuple(steps))

    def _cut(self, steps: Sequence[float], share: int) -> tuple[list[Piece], list[np.ndarray], tuple[int, ...]]:
        """Pieces of all recordings, the indices in θ of each piece's parameters, and numbers of pieces by recording."""
        cuts = [
            [replace(piece, log=k) for piece in self._cut_one(part, step, share)[::share]]
            for k, (part, step) in enumerate(zip(self.recordings, steps, strict=True))
        ]
        selected = [self.selections[k] for k, own in enumerate(cuts) for _ in own]
        return [piece for own in cuts for piece in own], selected, tuple(map(len, cuts))

    def _cut_one(self, part: Part[slice], step: float, share: int) -> list[Piece]:
        """Pieces of a recording, of which each `share`-th is used; fewer if a coordinate is missing in one of them."""
        fewest, own = 2 if len(self.recordings) == 1 else 1, -(-LEAST_PIECES // len(self.recordings))
        most = int(np.ptp(part.log.recording.time[part.samples]) / SHORTEST[share > 1])
        try:
            least = max(fewest, min(most, own * share))
            return cut(part.log, self.measurement, part.samples, step, least=least)
        except InputError:
            return cut(part.log, self.measurement, part.samples, step, least=fewest)

    def carried(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate of stages with another prior or other columns, as a starting point of these.

        Columns that it lacks are fixed at zero. The equations of columns that it has are not computed again.
        """
        before, was = estimate.fit, estimate.measurement.names
        here = [k for k, name in enumerate(self.measurement.names) if name in was]
        there = [was.index(self.measurement.names[k]) for k in here]
        theta, (free, bounded) = np.zeros(len(self.names)), np.zeros((2, len(self.names)), bool)
        for k, own in enumerate(self.selections):
            at = before.selections[estimate.pieces_of(k).start][there]
            theta[own[here]], free[own[here]], bounded[own[here]] = before.theta[at], before.free[at], before.bound[at]
        selections = [own for own, count in zip(self.selections, estimate.counts, strict=True) for _ in range(count)]
        new = {k: self.names.index(name) for k, name in enumerate(before.names) if name in self.names}
        search = replace(estimate.search, deviations=tuple(each.renumbered(new) for each in estimate.search.deviations))
        beyond = np.array([each.index for each in search.deviations if each.gross], int)
        prior = self.prior.weighted(before.prior.weight).loosened(beyond, self._gross)
        fit = replace(before, names=self.names, selections=selections, prior=prior, theta=theta, free=free)
        fit = replace(fit, bounded=bounded, scatters=None)
        measured = self.measured(estimate.reversals)
        estimate = replace(estimate, measurement=measured, search=search, setup=self.setup, known=self.known)
        if before.shares and set(self.names) <= set(before.names):
            kept = [before.names.index(name) for name in self.names]
            shares = [(precision[np.ix_(kept, kept)], right[kept]) for precision, right in before.shares]
            scatters = before.scatters and [each[np.ix_(kept, kept)] for each in before.scatters]
            return estimate.with_fit(replace(fit, shares=shares, scatters=scatters))
        again = self.refit_of(estimate.with_fit(fit))(fit.end, free, 0)
        return estimate.with_fit(replace(fit, shares=again.shares))

    def preferred(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Exploring estimate of stages without a prior, or one with this prior if it predicts left-out pieces better.

        Where pieces repeat each other, it has to predict them as well. Without pieces to leave out the prior is taken
        wherever it is more precise than the data, and where neither predicts most channels, if it is far more precise.
        """
        fit = estimate.fit
        used = min(sum(len(piece.time) for piece in fit.pieces) / length(self.recordings), 1.0)
        part = np.ix_(~self.is_setup, ~self.is_setup)
        most = np.linalg.eigvals(used * fit.covariance[part] @ self.prior.precision[part]).real.max()
        if most < 1:
            return estimate

        @cache
        def with_prior() -> TrajectoryEstimate:
            return self.refitted(self.carried(estimate), rounds=EXPLORED)

        if len(fit.pieces) < 2:
            return with_prior()
        # Pieces that repeat motions and what is left of them predict each other's errors as well.
        repeated = sum(len(each.starts) for each in repeating(self.measurement, fit)) == len(estimate.counts)
        worth = -WORTH_A_PRIOR if repeated else WORTH_A_PRIOR
        chosen = better(estimate, "prior", lambda: self.carried(estimate), worth - CLEARLY)
        chosen = better(estimate, "prior", with_prior, worth) if chosen.known else chosen
        neither = np.mean((chosen.errors.get("prior", np.zeros((2, 1))) < 1).any(axis=0)) < MAJORITY
        return with_prior() if neither and most > FAR_LESS**2 and not chosen.known else chosen

    def settled(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate near convergence with friction near reversals, and noise white or correlated over time."""
        if estimate.fit.status == "interrupted":
            return estimate
        if estimate.reversals is not None:
            estimate = self._opened(estimate)
        # In the unconverged fit a drive may have been set to zero wrongly.
        white = self.refitted(estimate.with_fit(estimate.fit.unbound), rounds=WEIGHED)
        # Residuals correlated over less than the knot spacing are jumps that knots cannot follow.
        if correlated(white)[1].any():
            white = self._coloured(white)
        if white.fit.status != "stopped":
            return white
        return self.refitted(white, rounds=iteration.ROUNDS - WEIGHED)

    def _coloured(self, white: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with white noise, or with correlated noise if that predicts clearly better."""

        def tried() -> TrajectoryEstimate:
            soon = self.refitted(replace(white, coloured=True), rounds=HOPELESS)
            if soon.fit.status != "stopped":
                return soon
            margin = CLEARLY if soon.fit.trace[-1] < STEADY else -FAR_WORSE
            hopeful = better(white, "", lambda: soon, margin).coloured
            return self.refitted(soon, rounds=WEIGHED - HOPELESS) if hopeful else soon

        return better(white, "correlated noise", tried)

    @cached_property
    def _is_drive(self) -> np.ndarray:
        """Mask of the parameters that are friction or rotor inertia, which are not negative (p,)."""
        equations = self.measurement.equations
        first = equations.parameters.rank
        local = first + np.flatnonzero(~np.isin(equations.drives, equations.mixed))
        out = np.zeros(len(self.names), bool)
        out[[own[local] for own in self.selections]] = True
        return out

    def _opened(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with the likeliest slips and slack given its residuals."""
        fit, measurement = estimate.fit, estimate.measurement
        rates = [speeds(measurement, *point[:3]) for point in fit.points]
        left = np.concatenate([residual(measurement, point) for point in fit.points])
        reversals = likeliest(measurement.equations, left, np.concatenate(rates), fit.points[0].theta)
        opened = replace(fit, pieces=reversals.opened(fit.pieces, rates))
        return replace(estimate.with_fit(opened), reversals=reversals)

    def refitted(
        self,
        estimate: TrajectoryEstimate,
        *,
        rounds: int = iteration.ROUNDS,
        settled: Tolerance = NEAR,
        shares: bool = True,
    ) -> TrajectoryEstimate:
        """Estimate fitted again from its end point, to a tolerance."""
        fit = estimate.fit
        rounds = 0 if fit.status == "interrupted" else rounds
        again = self.refit_of(estimate, settled, shares)(fit.end, fit.free, rounds)
        again = replace(again, status="interrupted") if not rounds else again
        return replace(estimate.with_fit(again), measurement=self.measured(estimate.reversals))

    def whole(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate near convergence from all pieces, with knots, noise and set-up of one from fewer pieces.

        Noise that is correlated there has to predict all pieces better as well: white noise is the more robust choice.
        The covariance of its gradient is that of the fewer pieces, by numbers of samples: enough for score tests.
        """
        pieces, selected, counts = self._cut(estimate.steps, 1)
        alone = smoothed(pieces, estimate.fit.noises, executor=self.executor)
        if estimate.reversals is not None:
            theta = [estimate.fit.theta[own] for own in selected]
            rates = [speeds(self.measurement, *x) for x in zip(pieces, alone.coefficients, theta, strict=True)]
            pieces = estimate.reversals.opened(pieces, rates)
        begun = replace(estimate.fit, pieces=pieces, selections=selected, coefficients=alone.coefficients)
        begun = replace(begun, theta=np.where(begun.free | ~self.is_setup, begun.theta, self.prior.mean))
        begun = replace(begun, noises=[replace(own, channels_rho=0 * own.channels_rho) for own in begun.noises])
        out = self.refitted(replace(estimate.with_fit(begun.unbound), counts=counts, coloured=False))
        out = self._coloured(out) if estimate.coloured else out
        if out.fit.status == "interrupted":
            return out
        return out.with_fit(replace(out.fit, status="near", scatters=by_samples(estimate.fit, pieces)))

    def searched(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with set-up errors, if these are searched for, and with sandwich covariance."""
        estimate = self._with_weighted_prior(estimate if estimate.fit.scatters else self.scattered(estimate))
        if estimate.search.incredible or estimate.fit.status == "interrupted" or len(estimate.fit.pieces) < 2:
            return estimate
        refit = self.refit_of(estimate, shares=False)

        def scattered(begin: Start, free: np.ndarray, rounds: int) -> TrajectoryFit:
            return with_scatter(estimate.measurement, refit(begin, free, rounds), every=False)

        far = [at for at, each in self.setup.items() if each.row.far and self.search]
        delays = {at: partial(likely_delay, estimate.measurement, at) for at in far}
        candidates, least = self.is_setup & ~self.is_estimated & self.search, self._unfollowed(estimate)
        drives, groups = self._is_drive & ~estimate.fit.unbound.free, _groups(self.setup, len(self.names))
        search = searched(estimate.search, scattered, candidates, groups, least, drives, delays, self._gross)
        return replace(estimate, search=search)

    @cached_property
    def _gross(self) -> np.ndarray:
        """Standard deviations of errors beyond what is stated, zero for none (p,)."""
        return np.array([self.setup[k].row.gross if k in self.setup else 0.0 for k in range(len(self.names))])

    def _unfollowed(self, estimate: TrajectoryEstimate) -> np.ndarray:
        """Apparent delays and clock errors due to jumps, zero unless knots are as dense as samples allow (p,)."""
        pieces, out = estimate.fit.pieces, np.zeros(len(self.names))
        half = np.array(max(float(piece.when[-1] - piece.origin) for piece in pieces) / 2)
        between = [float(np.median(np.diff(piece.when))) for piece in pieces]
        pairs = zip((estimate.steps[piece.log] for piece in pieces), between, strict=True)
        step = max((own for own, each in pairs if own <= KNOTS_PER_SAMPLE * each * (1 + SLACK)), default=0.0)
        for at, each in self.setup.items():
            if each.row.shift is not None:
                out[at] = UNFOLLOWED * step / abs(each.row.shift(half))
        return out

    def scattered(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with its covariance under noise that is estimated independently of the weights."""
        if estimate.fit.status == "interrupted":
            return estimate
        return estimate.with_fit(with_scatter(estimate.measurement, estimate.fit))

    def _with_weighted_prior(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with a prior weighted up where recordings carry less information than the fit assumes.

        Weights that take autocorrelated residuals as white overrate the recordings, several times on real robots, so
        that they override a more precise prior. The magnitude of the likelihood is adjusted to the covariance of its
        gradient, as for composite likelihoods (Ribatet, Cooley and Davison, Statistica Sinica 22, 2012,
        doi:10.5705/ss.2009.248).
        """
        fit = estimate.fit
        if not self.known or fit.scatters is None or fit.prior.weight > 1:
            return estimate
        rank = self.measurement.equations.parameters.rank
        curvature, scatter = (np.diag(each - fit.prior.precision)[:rank] for each in (fit.precision, fit.scatter))
        weight = float(np.median(scatter[curvature > 0] / curvature[curvature > 0])) if (curvature > 0).any() else 1.0
        if weight < OVERRATED:
            return estimate
        weighted = replace(fit.unbound, prior=fit.prior.weighted(weight))
        return self.scattered(self.refitted(estimate.with_fit(weighted)))

    def converged(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Converged estimate.

        Friction near reversals and smoothness are estimated anew where set-up errors have been found since: residuals
        contained them.
        The gradient's covariance is computed again: short as the step is, directions that recordings leave
        undetermined, such as the common scale of bodies and torques, turn with θ.
        """
        fit = estimate.fit
        if fit.status != "near":
            return estimate
        if estimate.search.deviations:
            estimate = estimate if estimate.reversals is None else self._opened(estimate)
            rougher = [replace(own, jerk=own.jerk / ROUGHER) for own in fit.noises]
            estimate = estimate.with_fit(replace(estimate.fit, noises=rougher))
        out = self.refitted(estimate, settled=SETTLED, shares=False)
        again = replace(out.fit, scatters=fit.scatters, trace=(*fit.trace, *out.fit.trace))
        return self.scattered(out.with_fit(again))

    def with_physical_bodies(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with physical bodies."""
        refit = self.refit_of(estimate, settled=SETTLED)
        fit = physical_fit(estimate.fit, refit, self.measurement.equations, iteration.ROUNDS)
        return self.scattered(estimate.with_fit(fit))

    def measured(self, reversals: Reversals | None) -> Measurement:
        """Measurement with the estimated slips of friction."""
        return self.measurement if reversals is None else self.measurement.with_slips(reversals.slip)

    def refit_of(self, estimate: TrajectoryEstimate, settled: Tolerance = NEAR, shares: bool = True) -> Refit:
        """Function that fits the pieces of an estimate again, with its noise model, friction and prior.

        Args:
            estimate: The estimate.
            settled: Tolerance with which fits end.
            shares: True for the shares of the pieces, which fits have anyway if they are long or drives may be at their
                bound.
        """
        return self._refit(estimate.fit.pieces, estimate.fit.selections, estimate, settled, shares)

    def _refit(
        self,
        pieces: Sequence[Piece],
        selected: Sequence[np.ndarray],
        estimate: TrajectoryEstimate | None = None,
        settled: Tolerance = NEAR,
        shares: bool = False,
    ) -> Refit:
        """Function that fits pieces, each with its own subset of the parameters, as an estimate; to explore by default.

        Drives that the estimate does not have are fitted only where they are free.
        """
        solve = partial(
            iteration.fit,
            self.measurement if estimate is None else self.measured(estimate.reversals),
            pieces,
            prior=self.prior if estimate is None else estimate.fit.prior,
            names=self.names,
            selections=selected,
            coloured=estimate is not None and estimate.coloured,
            explore=estimate is None,
            settled=settled,
            executor=self.executor,
            report=self.report,
        )
        drives = self._is_drive if estimate is None else self._is_drive & estimate.fit.unbound.free
        # Of a long recording a covariance has the responses of some pieces only, and would compute those of the others.
        is_long = sum(len(piece.when) for piece in pieces) > ENOUGH

        def refit(begin: Start, free: np.ndarray, rounds: int) -> TrajectoryFit:
            bounded = drives | (self._is_drive & free)
            asked = shares or (estimate is not None and bool(bounded.any() or is_long))
            return with_positive(partial(solve, shares=asked), bounded, begin, free, rounds)

        return refit


def _log_noise(estimate: TrajectoryEstimate) -> np.ndarray:
    """Logarithms of the noise by which knots are chosen, of every recording (L, s).

    It is that of the channels but poses. Commands have none: what knots do not follow is then in the angles'.
    """
    equations = estimate.measurement.equations
    angles, own = slice(0 if equations.servos is None else None), len(equations.channels)
    return np.log([np.r_[each.channels[:own], each.states[angles]] for each in estimate.fit.noises])


def _groups(setup: Mapping[int, SetupParameter], number: int) -> dict[str, np.ndarray]:
    """Directions in θ along which several set-up parameters change together, by description (p,) each."""
    groups = defaultdict[str, np.ndarray](lambda: np.zeros(number))
    for at, each in setup.items():
        for name, share in each.together.items():
            groups[each.row.together.format(name)][at] = share
    return {text: direction for text, direction in sorted(groups.items()) if np.count_nonzero(direction) > 1}
