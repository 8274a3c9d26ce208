"""Predictions of held-out channels by every candidate, by one rule and from the same motions.

Motions are smoothed from joint angles alone. A candidate predicts each channel from the motion whose time constant
leaves it about the smallest residual of that channel in the fitted part, where the joints move that rub.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.estimation.equations import Equations, stated_drive_channels
from ident.estimation.preparation import Part
from ident.estimation.samples import Samples, joined
from ident.judgement.evidence import Unmodelled
from ident.judgement.unmodelled import HypothesisFit, unmodelled
from ident.problem import Problem
from ident.regression.held_out import HeldOut, picked, where_moving
from ident.regression.ordinary import Fit
from ident.trajectory.corrected import Smoothed
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import axis_speeds


@dataclass(frozen=True, eq=False)
class Candidate:
    """Parameters that predict channels.

    Attributes:
        equations: Equations of m columns and C channels.
        values: Coefficients for all recordings to judge by, or for each (1 or J, m).
        stated_drives: True to add the drives as the model states them.
    """

    equations: Equations
    values: np.ndarray
    stated_drives: bool = False

    @classmethod
    def model(cls, equations: Equations, samples: Samples) -> "Candidate":
        """The model as it came: its prior and the drives that it states, with mean residuals of samples as offsets."""
        prior = equations.parameters.regroup(equations.mechanism.known)
        values = np.r_[prior, np.zeros(len(equations.names) - len(prior))]
        model = cls(equations, values[None], stated_drives=True)
        if equations.offsets:
            values[-len(equations.offsets) :] = model.residuals(samples)[0].mean(axis=0)[list(equations.offsets)]
        return model

    def residuals(self, samples: Samples) -> np.ndarray:
        """Measured less predicted channels for each row of values (1 or J, N, C)."""
        left = self.equations.residual(samples, self.values)
        return left - stated_drive_channels(self.equations, samples.motion) if self.stated_drives else left


LONGEST = 0.5
"""Longest time constant of smoothing to try, s, a filter at 0.3 Hz."""

STEPS = 0.5, 0.25, 0.125
"""Steps in octaves in which constants near the best of those an octave apart are tried: of somebody who lifts, a
quarter of an octave beside the best one adds a fifth to the residual of a moment."""

AS_GOOD = 1.02
"""Residual over the smallest up to which a shorter constant is taken: too long a one distorts a faster motion, too
short a one adds a little noise. On six recordings of robots and people, estimates and least squares predict 2.5 % worse
than with the constants that are best for what is held out, and 3.6 % worse without this."""

COMPARED = 1_500
"""Approximate largest number of fitted samples by which constants are compared."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """A candidate's prediction.

    Attributes:
        constants: Time constants of smoothing, s, for all recordings to judge by or for each (1 or J, C).
        versions: Samples to judge by with each of the motions.
        chosen: Index of the version that predicts each channel (M, C).
        residual: Measured less predicted channels (M, C).
    """

    constants: np.ndarray
    versions: tuple[Samples, ...]
    chosen: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True, eq=False)
class Predictions:
    """Samples to fit and to judge by, with motions smoothed from angles alone.

    Attributes:
        problem: The problem.
        estimate: Its trajectory estimate.
    """

    problem: Problem
    estimate: TrajectoryEstimate

    @cached_property
    def logs(self) -> list[Smoothed]:
        """The fitted recordings."""
        measurement = self.estimate.measurement
        return [Smoothed(part.log, measurement, k) for k, part in enumerate(self.problem.fitted)]

    @cached_property
    def _judges(self) -> list[Smoothed]:
        if not self.problem.apart:
            return self.logs
        return [Smoothed(part.log, self.estimate.measurement, None) for part in self.problem.judged]

    @cached_property
    def _fitted(self) -> list[np.ndarray]:
        """Indices of fitted samples by which constants are compared."""
        every = [part.indices for part in self.problem.settled]
        return [taken[:: -(-sum(map(len, every)) // COMPARED)] for taken in every]

    def _resting(self, part: Part[slice | np.ndarray], taken: np.ndarray) -> np.ndarray:
        """Mask of the torques of joints that rub and are slower than their v0 (N, C)."""
        equations, reversals = self.problem.equations, self.estimate.reversals
        if reversals is None:
            return np.zeros((len(taken), len(equations.channels)), bool)
        return reversals.resting(axis_speeds(self.estimate.measurement.equations, part.log.samples.motion.dq[taken]))

    @cached_property
    def _counting(self) -> list[np.ndarray]:
        """Masks of the fitted measurements by which constants are compared."""
        parts = zip(self.problem.fitted, self._fitted, strict=True)
        each = [self._resting(part, taken) for part, taken in parts]
        counting, ends = where_moving(np.concatenate(each)), np.cumsum([len(x) for x in each])
        return np.split(counting, ends[:-1])

    def of(self, candidate: Candidate, setup: TrajectoryEstimate) -> Predicted:
        """Prediction of the samples to judge by.

        Args:
            candidate: Parameters that predict.
            setup: Set-up that they are for.
        """
        constants, parts = self._constants(candidate, setup), self.problem.judged
        tried = np.unique(constants)
        versions, residuals = list[Samples](), list[np.ndarray]()
        for T in tried.tolist():
            own = zip(self._judges, parts, strict=True)
            each = [log.samples(setup, T, part.indices, left_out=self.problem.leaves_out) for log, part in own]
            left = [candidate.residuals(x) for x in each]
            residuals.append(np.concatenate([x[min(k, len(x) - 1)] for k, x in enumerate(left)]))
            versions.append(joined(each))
        rows = np.broadcast_to(np.searchsorted(tried, constants), (len(parts), constants.shape[1]))
        chosen = np.repeat(rows, [len(part.indices) for part in parts], axis=0)
        return Predicted(constants, tuple(versions), chosen, picked(np.stack(residuals), chosen))

    def held_out(self, own: Predicted, fit: Fit, rivals: dict[str, np.ndarray]) -> HeldOut:
        """The estimate's prediction as that of a fit, beside residuals of other candidates (M, C)."""
        problem = self.problem
        ends = np.cumsum([0, *(len(part.indices) for part in problem.judged)]).tolist()
        resting = np.concatenate([self._resting(part, part.indices) for part in problem.judged])
        left_out = tuple(map(slice, ends[:-1], ends[1:])) if problem.leaves_out else ()
        return HeldOut(
            *(*problem.in_a_row, own.versions, own.chosen, fit, own.residual, resting),
            rivals=rivals,
            left_out=left_out,
            fitted=problem.judges_fitted,
        )

    def unmodelled(self, constant: float) -> tuple[Unmodelled, ...]:
        """Forces and lengths that the model may lack; recordings of which each is left out are divided in halves.

        Args:
            constant: Time constant of smoothing, s.
        """
        estimate, problem = self.estimate, self.problem
        fitted = list(zip(self.logs, self._fitted, self._counting, strict=True))
        judged = [(log, part.indices) for log, part in zip(self._judges, problem.judged, strict=True)]
        if problem.leaves_out:
            half = len(fitted) // 2
            fitted, judged = fitted[:half], judged[half:]
        thin = -(-sum(len(taken) for _, taken in judged) // COMPARED)
        counting = np.concatenate([each for *_, each in fitted])
        own = [estimate.setup[each.index].row.stated for each in estimate.search.deviations]
        comparisons = []
        for setup in (estimate, estimate.as_stated()) if own and not any(own) else (estimate,):
            equations = self.logs[0].equations(setup)
            m = len(equations.names)
            used = joined([log.samples(setup, constant, taken) for log, taken, _ in fitted])
            ahead = joined([log.samples(setup, constant, taken[::thin]) for log, taken in judged])
            known = estimate.fit.prior.known[:m, :m]
            comparisons.append(HypothesisFit(equations, setup.fit.theta[:m], known, used, counting, ahead))
        return unmodelled(comparisons)

    def _constants(self, candidate: Candidate, setup: TrajectoryEstimate) -> np.ndarray:
        """Time constants of smoothing, s, for all recordings to judge by or for each that is left out (1 or J, C)."""
        # Octaves from the longest constant, exact as keys, to half the time between samples, a filter at a third of
        # their rate: without noise heel strikes need it, and even shorter ones would pass outliers.
        finest = 0.5 * min(float(np.median(np.diff(log.prepared.recording.time))) for log in self.logs)
        lowest = min(float(np.ceil(np.log2(finest / LONGEST) / STEPS[-1])) * STEPS[-1], 0.0)
        new, squares = np.arange(0.0, lowest - STEPS[-1], -1.0), dict[float, np.ndarray]()
        for step in (*STEPS, 0.0):
            squares |= {x: self._squares(candidate, setup, LONGEST * 2**x) for x in new.tolist() if x not in squares}
            octaves, each = np.array(list(squares)), np.stack(list(squares.values()))
            best = np.where(each <= AS_GOOD**2 * each.min(axis=0), octaves[:, None, None], 0.0).min(axis=0)
            new = np.unique(np.clip([best - step, best + step], lowest, 0.0))
        return LONGEST * 2**best

    def _squares(self, candidate: Candidate, setup: TrajectoryEstimate, T: float) -> np.ndarray:
        """Sums of squared residuals of the fitted part for a time constant (1 or J, C)."""
        parts = zip(self.logs, self._fitted, self._counting, strict=True)
        each = [
            (np.where(counting, candidate.residuals(log.samples(setup, T, taken)), 0) ** 2).sum(axis=1)
            for log, taken, counting in parts
        ]
        if not self.problem.leaves_out:
            return np.sum(each, axis=0)
        return np.stack([sum(x[min(k, len(x) - 1)] for i, x in enumerate(each) if i != k) for k in range(len(each))])
