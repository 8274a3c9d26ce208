"""Identification of a simulated person on two force plates who holds a rail, from a wrong prior, with known truth."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import linalg

from experiments.runs.workers import Checkpoint, Workers, worker_pool
from experiments.studies.person_recordings import SENSORS, Laboratory, drawn, humanoid, mistaken, moved, recorded
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.accumulator import accumulate
from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import channel_scales
from ident.estimation.preparation import prepared
from ident.estimation.samples import joined
from ident.identification import identified
from ident.mechanism.mechanism import Mechanism
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.prior import conditioned, known_covariance
from ident.recordings.recording import Recording
from ident.tolerances import INTERVAL
from ident.trajectory.fit.fitted import inverse_of_precision
from ident.trajectory.fit.iteration import Report
from ident.trajectory.fit.piece import Piece, Point
from ident.trajectory.fit.piece_equations import normal_equations
from ident.trajectory.result import TrajectoryEstimate
from sim.motion.person import ACTIVITIES

USUAL = 6.0
"""Cut-off, Hz, that gait laboratories use for markers."""

HELD_OUT = 1000
"""Offset of the seeds of recordings that are not fitted."""

FILE = "persons.npz"
"""File in the output folder with the persons of whom intervals are counted."""

MOVED = 0.5
"""Standard deviation over the prior one, below which a combination counts as determined."""


@dataclass(frozen=True, eq=False)
class PersonStudy:
    """Results of the study.

    Attributes:
        estimate: The estimate of all recordings.
        true: The person.
        activities: Activity of each recording.
        recordings: The recordings.
        seconds: Length of each, s.
        filtered: Base parameters by least squares at filtered states (r,).
        held_out: Base-wrench regressor of motions that were not recorded (N, 6, r); they are exact: only ψ has errors.
        laboratory: The laboratory.
    """

    estimate: Estimate
    true: Mechanism
    activities: tuple[str, ...]
    recordings: tuple[Recording, ...]
    seconds: float
    filtered: np.ndarray
    held_out: np.ndarray
    laboratory: Laboratory
    _begun: dict[tuple[int, float], np.ndarray] = field(default_factory=dict)

    @cached_property
    def psi(self) -> np.ndarray:
        """True base parameters (r,)."""
        return self.estimate.base.regroup(self.true.known)

    @property
    def mechanism(self) -> Mechanism:
        """The person with the prior."""
        return self.estimate.prepared.mechanism

    @property
    def _trajectory(self) -> TrajectoryEstimate:
        assert self.estimate.trajectory is not None
        return self.estimate.trajectory

    @cached_property
    def distances(self) -> tuple[np.ndarray, np.ndarray]:
        """As `distances_by`, including the uncertainty of the set-up."""
        return self.distances_by(self.estimate.covariance_setup)

    def distances_by(self, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Precision and errors along independently estimated combinations of base parameters, the best known first.

        Args:
            covariance: Covariance of the fitted parameters, base parameters first (p, p).

        Returns:
            Standard deviations over the prior ones, and errors in standard deviations (k,); without combinations known
            to rounding.
        """
        rank = len(self.psi)
        variances, directions = linalg.eigh(
            covariance[:rank, :rank], known_covariance(self.mechanism, self.estimate.base)
        )
        # Smaller ones are rounding beside the prior's.
        uncertain = variances > 1e-10
        std = np.sqrt(variances[uncertain])
        return std, directions[:, uncertain].T @ (self.estimate.psi - self.psi) / std

    @property
    def determined(self) -> np.ndarray:
        """True for combinations that the recordings determine (k,)."""
        return self.distances[0] < MOVED

    @cached_property
    def candidates(self) -> dict[str, np.ndarray]:
        """Base parameters of the compared estimators (r,)."""
        prior = self.estimate.base.regroup(self.mechanism.known)
        return {"prior": prior, "filtered least squares": self.filtered, "trajectory estimate": self.estimate.psi}

    @cached_property
    def errors(self) -> dict[str, np.ndarray]:
        """RMS errors of the wrench of motions that were not recorded over its scale, by estimator (6,)."""
        scales = channel_scales([self.held_out @ self.psi], COMPONENTS)
        off = {name: self.held_out @ (psi - self.psi) for name, psi in self.candidates.items()}
        return {name: np.sqrt((x**2).mean(axis=0)) / scales for name, x in off.items()}

    @cached_property
    def segments(self) -> dict[str, np.ndarray]:
        """φ of all segments: `true`, `prior` and `estimate`, and standard deviations `std` (b, 10) each."""
        estimate, std = self.after([self.seconds] * len(self.activities))
        true, prior = (arm.known.reshape(-1, 10) for arm in (self.true, self.mechanism))
        return {"true": true, "prior": prior, "estimate": estimate, "std": std}

    @property
    def coverage(self) -> float:
        """Coverage of the 95 % intervals of determined combinations."""
        return float((np.abs(self.distances[1][self.determined]) < INTERVAL).mean())

    @property
    def noise_of_angles(self) -> float:
        """Median of the estimated standard deviations of the hinges' angles, degrees."""
        joint = self._trajectory
        hinges = np.concatenate(
            [np.zeros(joint.measurement.of_base, bool)]
            + [np.full(body.coordinates, not body.is_ball) for body in self.true.tree.bodies]
        )
        return float(np.degrees(np.median(joint.fit.coordinate_noise[hinges])))

    def predicted_deviation(self, seconds: Sequence[float]) -> float:
        """Standard deviation of the wrench predicted for other motions, after the first seconds of each recording.

        Relative to the prior one, as a geometric mean of the channels, and from noise alone: the set-up is the
        estimated one.
        """
        both = [self._covariance(each, setup=False) for each in (seconds, [0.0] * len(self.activities))]
        now, before = ((self._squares * covariance).sum(axis=(1, 2)) for covariance in both)
        return float(np.exp(np.log(now / before).mean() / 2))

    @cached_property
    def _squares(self) -> np.ndarray:
        """Products of the columns of each channel's regressor, summed over samples (6, r, r)."""
        Y = self.held_out.swapaxes(0, 1)
        return Y.swapaxes(1, 2) @ Y

    def after(self, seconds: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """φ and its standard deviations, from the prior and the first seconds of each recording (b, 10) each.

        The noise is that of all of them.
        """
        estimate = self.estimate
        phi, std = conditioned(self.mechanism, estimate.base, estimate.psi, self._covariance(seconds))
        return phi.reshape(-1, 10), std.reshape(-1, 10)

    def _covariance(self, seconds: Sequence[float], *, setup: bool = True) -> np.ndarray:
        """Covariance of base parameters after the first seconds of each recording (r, r).

        Args:
            seconds: Length of each.
            setup: True to include the uncertainty of the set-up.
        """
        joint, rank = self._trajectory, self.estimate.base.rank
        fit, own = joint.fit, np.repeat(np.arange(len(joint.counts)), joint.counts)
        precision = fit.prior.precision.copy()
        for k, length in enumerate(np.array(seconds)[own].tolist()):
            precision += self._share(k, length) if length > 0 else 0.0
        open_ = (fit.free | (joint.is_setup & setup)) & (np.diag(precision) > 0)
        return inverse_of_precision(precision[np.ix_(open_, open_)])[:rank, :rank]

    def _share(self, k: int, seconds: float) -> np.ndarray:
        """Information on θ in the first seconds of a piece (p, p)."""
        joint, fit = self._trajectory, self._trajectory.fit
        if seconds >= self.seconds:
            return fit.shares[k][0]
        if (k, seconds) not in self._begun:
            begun = beginning(fit.pieces[k], seconds)
            self._begun[k, seconds] = np.zeros_like(fit.shares[k][0])
            if not len(begun.when):
                return self._begun[k, seconds]
            # A trajectory through too few samples to be determined adds no information.
            with suppress(np.linalg.LinAlgError):
                coefficients = fit.coefficients[k][: begun.spline.size]
                at = Point(begun, coefficients, fit.theta, fit.noises[begun.log])
                equations = normal_equations(joint.measurement, at, np.arange(len(fit.theta)))
                self._begun[k, seconds] = equations.eliminated.precision
        return self._begun[k, seconds]


def beginning(piece: Piece, seconds: float) -> Piece:
    """The first seconds of a piece's samples and trajectory.

    A trajectory beyond the samples is hardly determined, and its equations may have no solution.
    """
    there, felt = (x < piece.origin + seconds for x in (piece.time, piece.when))
    last = max((float(x[-1]) for x in (piece.time[there], piece.when[felt]) if len(x)), default=piece.spline.start)
    # One interval more, as channels may be late.
    intervals = int((last - piece.spline.start) / piece.spline.step) + 2
    return replace(
        piece,
        spline=replace(piece.spline, intervals=min(intervals, piece.spline.intervals)),
        time=piece.time[there],
        states=piece.states[there],
        when=piece.when[felt],
        measured=piece.measured[felt],
        wrenches=piece.wrenches[felt],
        slack=None if piece.slack is None else piece.slack[felt],
    )


def least_squares_from_prior(estimate: Estimate) -> np.ndarray:
    """Base parameters next to the prior with the best fit at filtered states, treated as exact (r,).

    The prior is kept where a singular value is below a thousandth of the largest.
    """
    logs = [prepared(part.log.mechanism, part.log.recording, cutoff=USUAL) for part in estimate.logs]
    equations = logs[0].equations
    samples = joined([log.samples[slice(log.edge, len(log.samples) - log.edge)] for log in logs])
    R = accumulate(equations, samples).root
    prior = equations.parameters.regroup(equations.mechanism.known)
    step, *_ = np.linalg.lstsq(R[:, :-1], R[:, -1] - R[:, :-1] @ prior, rcond=1e-3)
    return np.asarray(prior + step)


def held_out_regressor(base: BaseParameters, activities: Sequence[str], seconds: float, seed: int) -> np.ndarray:
    """Base-wrench regressor of motions that are not recorded (N, 6, r)."""
    true, columns = humanoid(), []
    for number, activity in enumerate(activities):
        motion = moved(activity, Laboratory().times(seconds), HELD_OUT + seed + number)
        Y = base_wrench_regressor(true.tree, *motion.states, gravity=true.gravity, base=motion.base)
        columns.append(Y[..., list(base.kept)])
    return np.concatenate(columns)


def study(
    seconds: float,
    *,
    seed: int = 0,
    laboratory: Laboratory = Laboratory(),  # noqa: B008
    activities: Sequence[str] | None = None,
    executor: Executor | None = None,
    report: Report | None = None,
) -> PersonStudy:
    """Simulates recordings of all activities, and others that are held out, and identifies the person.

    Args:
        seconds: Length of each recording.
        seed: Seed of the motions, the noise and the wrong prior.
        laboratory: The laboratory, with its noise and set-up errors.
        activities: Recorded activities, by default all of `ACTIVITIES`.
        executor: Executor for the pieces of the trajectory estimate.
        report: Called in each round of it.

    Raises:
        InputError: Recordings are too short.
    """
    if seconds < 2:
        raise InputError(f"A recording of a person needs two seconds or more, got {seconds:g}.")
    activities = ACTIVITIES if activities is None else activities
    who, first = mistaken(humanoid(), np.random.default_rng((seed, 2))), seed * len(ACTIVITIES)
    faults = drawn(humanoid(), SENSORS, laboratory.setup, np.random.default_rng((seed, 3)))
    recordings, unseen = (
        tuple(recorded(activity, seconds, start + k, laboratory, faults) for k, activity in enumerate(activities))
        for start in (first, HELD_OUT + first)
    )
    fitted, judges = (
        [prepared(who, each, name=activity) for each, activity in zip(several, activities, strict=True)]
        for several in (recordings, unseen)
    )
    estimate = identified(fitted, judges=judges, known=True, executor=executor, report=report)
    held_out = held_out_regressor(estimate.base, activities, seconds, first)
    filtered = least_squares_from_prior(estimate)
    return PersonStudy(estimate, humanoid(), tuple(activities), recordings, seconds, filtered, held_out, laboratory)


def laboratory(source: str, rate: float, noise: float | None = None) -> Laboratory:
    """A laboratory whose angles have noise that is white or `correlated`, or come from `markers`.

    Raises:
        InputError: The noise of angles, in degrees, is out of range, or stated for angles from markers.
    """
    if source == "markers":
        if noise is not None:
            raise InputError(
                f"Noise of angles (--noise) belongs to --from angles or correlated, those from markers have that of "
                f"the markers; got {noise:g}."
            )
        return Laboratory(rate=rate, markers=True)
    noise = Laboratory.angle_deg if noise is None else noise
    if not 0 < noise < 30:
        raise InputError(f"Noise of angles (--noise) is from above 0 to below 30 degrees, got {noise:g}.")
    return Laboratory(noise, 0.9 if source == "correlated" else 0.0, rate=rate)


def with_and_without_rail(
    seconds: float, *, laboratory: Laboratory, workers: int = 1, **more: Any
) -> tuple[PersonStudy, PersonStudy]:
    """Studies of a person who holds a rail and of one who does not.

    Args:
        seconds: Length of each recording.
        laboratory: The laboratory.
        workers: Local processes for the pieces of the trajectory estimate.
        more: Further arguments of `study`.
    """
    with ExitStack() as stack:
        more["executor"] = stack.enter_context(worker_pool(workers)) if workers > 1 else None
        held, free = (study(seconds, laboratory=replace(laboratory, rail=rail), **more) for rail in (True, False))
        return held, free


def counts(
    number: int, seconds: float, folder: Path, workers: Workers, *, seed: int, laboratory: Laboratory, **more: Any
) -> list[dict[str, Any]]:
    """Precision and errors of several persons, with successive seeds from the given one, each as `counted` has them.

    Args:
        number: Number of persons.
        seconds: Length of each recording.
        folder: Folder of the file of the persons that are done.
        workers: Workers that share the persons.
        seed: Seed of the first person.
        laboratory: The laboratory.
        more: Further arguments of `study`, in JSON types.
    """
    identity = {"seconds": seconds, "seed": seed, "laboratory": asdict(laboratory), **more}
    work = partial(counted, seconds, {"laboratory": laboratory, **more})
    return workers.collected(work, range(seed, seed + number), Checkpoint("persons", folder / FILE, identity))


def counted(seconds: float, given: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Precision and errors of a person; run by workers."""
    person = study(seconds, seed=seed, **given)
    better = float((person.errors["prior"] / person.errors["trajectory estimate"]).min())
    out: dict[str, Any] = {"noise_of_angles": person.noise_of_angles, "times_better": better}
    out |= {"verdict": str(person.estimate.verdict())}
    for name, pair in (("with_setup", person.distances), ("of_noise", person.distances_by(person.estimate.covariance))):
        out[name] = {"std": pair[0].tolist(), "z": pair[1].tolist()}
    return out
