"""Fits of the trajectory estimate, each with its pieces of the recordings, knots, noise model and parameters."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ident.errors import InputError
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import Part
from ident.estimation.setup_parameters import SetupParameter
from ident.trajectory.cut_pieces import cut
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.iteration import NEAR, Report, Tolerance
from ident.trajectory.fit.noise_colours import ENOUGH
from ident.trajectory.fit.piece import Piece, residual
from ident.trajectory.fit.sandwich import with_scatter
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import Reversals, at_first, likeliest, rubbing, speeds
from ident.trajectory.setup_search import Deviation, Search
from ident.trajectory.start import smoothed, start

EXPLORED = 6
"""Rounds of a fit by which knots are chosen: its noise is then accurate to some per cent."""

LEAST_PIECES, SHORTEST = 6, (2.0, 0.5)
"""Least number of pieces of all recordings together, for prediction of some from the others; and shortest length of
such a piece, s, of all of a recording and of a share of it: at a cut accelerations depend on one side only, but few
samples span more of the motion in many pieces."""


@dataclass(frozen=True, eq=False)
class Stages:
    """Fits of given recordings with given parameters.

    Attributes:
        measurement: Channels, and the parameters of one recording.
        recordings: Parts of recordings to fit.
        names: Names of all parameters.
        setup: Those of the set-up by index.
        of_recording: Indices of each recording's parameters among all.
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
    of_recording: Sequence[np.ndarray]
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

    @cached_property
    def is_drive(self) -> np.ndarray:
        """Mask of the parameters that are friction or rotor inertia, which are not negative (p,)."""
        equations = self.measurement.equations
        local = equations.parameters.rank + np.flatnonzero(~np.isin(equations.drives, equations.mixed))
        out = np.zeros(len(self.names), bool)
        out[[own[local] for own in self.of_recording]] = True
        return out

    @cached_property
    def gross(self) -> np.ndarray:
        """Standard deviations of errors beyond what is stated, zero for none (p,)."""
        return np.array([self.setup[k].row.gross if k in self.setup else 0.0 for k in range(len(self.names))])

    def measured(self, reversals: Reversals | None) -> Measurement:
        """Measurement with the estimated slips of friction."""
        return self.measurement if reversals is None else self.measurement.with_slips(reversals.slip)

    def begun(self, steps: Sequence[float], share: int) -> TrajectoryEstimate:
        """Exploring fit with given knot spacings, s, of every `share`-th piece, begun from angles alone."""
        pieces = self.cut(steps, share)
        # A moving base is followed by cameras, whose errors last; encoders have none that do.
        alone = smoothed(pieces, coloured=self.measurement.of_base > 0, executor=self.executor)
        p, theta, reversals = len(self.measurement.names), self.prior.mean.copy(), None
        if rubbing(self.measurement.equations):
            rates = [speeds(self.measurement, *x, theta[:p]) for x in zip(pieces, alone.coefficients, strict=True)]
            reversals = at_first(self.measurement.equations, [piece.signal for piece in pieces], rates)
            pieces = reversals.opened(pieces, rates)
        prior = self.prior.mean[:p], self.prior.precision[:p, :p]
        theta[np.array(self.of_recording)], noises = start(self.measurement, pieces, alone, prior, ~self.is_setup[:p])
        free = ~self.is_setup | self.is_estimated
        at = theta, free, noises, alone.coefficients, pieces
        fit = TrajectoryFit(self.names, self.of_recording, self.prior, *at)
        stated = tuple(Deviation(k, ()) for k, each in self.setup.items() if each.row.stated)
        how = Search(fit, stated), tuple(steps), self.known
        begun = TrajectoryEstimate(self.measurement, *how, reversals=reversals, setup=self.setup)
        return self.refitted(begun, rounds=EXPLORED, explore=True)

    def denser(self, coarse: TrajectoryEstimate, steps: Sequence[float], share: int) -> TrajectoryEstimate:
        """Exploring fit with other knots, warm-started from another one."""
        pieces = self.cut(steps, share)
        was = coarse.fit
        places = [
            old.spline.refined(c, new.spline) for old, new, c in zip(was.pieces, pieces, was.coefficients, strict=True)
        ]
        pieces = [replace(new, slack=old.slack) for new, old in zip(pieces, was.pieces, strict=True)]
        fit = replace(was, pieces=pieces, coefficients=places)
        return self.refitted(replace(coarse.with_fit(fit), steps=tuple(steps)), rounds=EXPLORED, explore=True)

    def cut(self, steps: Sequence[float], share: int) -> list[Piece]:
        """Every `share`-th piece of all recordings."""
        cuts = zip(self.recordings, steps, strict=True)
        return [
            replace(piece, log=k)
            for k, (part, step) in enumerate(cuts)
            for piece in self._cut_one(part, step, share)[::share]
        ]

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
        was, there = estimate.fit, {name: k for k, name in enumerate(estimate.fit.names)}
        here = np.array([k for k, name in enumerate(self.names) if name in there])
        old = np.array([there[self.names[k]] for k in here])
        theta, (free, bounded) = np.zeros(len(self.names)), np.zeros((2, len(self.names)), bool)
        theta[here], free[here], bounded[here] = was.theta[old], was.free[old], was.bound[old]
        new = dict(zip(old.tolist(), here.tolist(), strict=True))
        deviations = tuple(each.renumbered(new) for each in estimate.search.deviations)
        beyond = np.array([each.index for each in deviations if each.gross], int)
        fit = replace(
            was,
            names=self.names,
            of_recording=self.of_recording,
            prior=self.prior.weighted(was.prior.weight).loosened(beyond, self.gross),
            theta=theta,
            free=free,
            bounded=bounded,
            scatters=None,
        )
        search = replace(estimate.search, fit=fit, deviations=deviations)
        measured = self.measured(estimate.reversals)
        carried = replace(estimate, measurement=measured, search=search, setup=self.setup, known=self.known)
        if was.shares and len(here) == len(self.names):
            shares = [(precision[np.ix_(old, old)], right[old]) for precision, right in was.shares]
            scatters = was.scatters and [each[np.ix_(old, old)] for each in was.scatters]
            return carried.with_fit(replace(fit, shares=shares, scatters=scatters))
        return carried.with_fit(replace(fit, shares=self.fitted(carried, rounds=0).shares))

    def opened(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with the likeliest slips and slack given its residuals, if joints rub."""
        if estimate.reversals is None:
            return estimate
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
        explore: bool = False,
    ) -> TrajectoryEstimate:
        """Estimate fitted again from its end point, arguments as for `fitted`."""
        rounds = 0 if estimate.fit.status == "interrupted" else rounds
        again = self.fitted(estimate, rounds=rounds, settled=settled, shares=shares, explore=explore)
        again = again if rounds else replace(again, status="interrupted")
        return replace(estimate.with_fit(again), measurement=self.measured(estimate.reversals))

    def scattered(self, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
        """Estimate with its covariance under noise that is estimated independently of the weights."""
        if estimate.fit.status == "interrupted":
            return estimate
        return estimate.with_fit(with_scatter(estimate.measurement, estimate.fit))

    def fitted(
        self,
        estimate: TrajectoryEstimate,
        begin: TrajectoryFit | None = None,
        *,
        rounds: int = iteration.ROUNDS,
        settled: Tolerance = NEAR,
        shares: bool = True,
        explore: bool = False,
    ) -> TrajectoryFit:
        """Fit with the noise model and friction of an estimate.

        Drives that the starting point does not have are fitted only where they are free.

        Args:
            estimate: The estimate.
            begin: Starting point, by default the estimate's end point.
            rounds: Largest number of rounds.
            settled: Tolerance with which the fit ends.
            shares: True for the shares of the pieces, which fits have anyway if they are long or have drives at their
                bound.
            explore: True to end as soon as the channels' noise has converged, without shares.
        """
        begin = estimate.fit if begin is None else begin
        drives = self.is_drive & begin.counted
        # Of a long recording a covariance has the responses of some pieces only, and would compute those of the others.
        is_long = sum(len(piece.when) for piece in begin.pieces) > ENOUGH
        solve = partial(
            iteration.fit,
            self.measured(estimate.reversals),
            coloured=estimate.coloured,
            explore=explore,
            settled=settled,
            executor=self.executor,
            rounds=rounds,
            report=self.report,
        )

        def solved(at: TrajectoryFit) -> TrajectoryFit:
            # Drives at their bound are tried again by their scores.
            return solve(at, shares=not explore and (shares or is_long or bool((drives & ~at.free).any())))

        return with_positive(solved, begin, drives)


def with_positive(
    solve: Callable[[TrajectoryFit], TrajectoryFit], begin: TrajectoryFit, drives: np.ndarray
) -> TrajectoryFit:
    """Fit with no drive below zero.

    At a minimum under bounds (conditions of Karush, Kuhn and Tucker) each drive at zero would be negative if it were
    free. After the largest number of rounds no drive is freed again: the fit that goes on from there does that.

    Args:
        solve: Function that fits the free parameters from a starting point.
        begin: Starting point.
        drives: Mask of the drives (p,), which may be freed.
    """
    fit = _bounded(solve, begin, drives)
    # A drive that is negative while others are negative too may be positive once these are zero.
    untried = drives.copy()
    while fit.status != "stopped" and (gains := _gains(fit, untried & ~fit.free)).any():
        best = np.arange(len(drives)) == np.argmax(gains)
        untried &= ~best
        fit = _bounded(solve, replace(fit, free=fit.free | best), drives)
    return replace(fit, bounded=drives & ~fit.free)


def _bounded(
    solve: Callable[[TrajectoryFit], TrajectoryFit], begin: TrajectoryFit, drives: np.ndarray
) -> TrajectoryFit:
    """Fit with drives that come out negative fixed at zero."""
    fit = solve(begin)
    while fit.status != "interrupted" and (negative := drives & fit.free & (fit.theta < 0)).any():
        fit = solve(replace(fit, theta=np.where(negative, 0.0, fit.theta), free=fit.free & ~negative))
    return fit


def _gains(fit: TrajectoryFit, held: np.ndarray) -> np.ndarray:
    """Decrease of the cost if one parameter at zero were free, zero if it would be negative (p,)."""
    gains = np.zeros(len(held))
    if fit.shares and fit.status != "interrupted":
        values, std = fit.scores(np.eye(len(held))[held])
        gains[held] = np.where(values > 0, (values / std) ** 2, 0.0)
    return gains
