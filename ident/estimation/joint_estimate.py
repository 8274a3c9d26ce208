"""The joint estimate of recordings: from their channels to parameters, set-up, trajectories and noise."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ident.errors import ExcitationError, InputError
from ident.estimation import joint
from ident.estimation.equations import Equations
from ident.estimation.joint import JointFit, Prior, Report, Start
from ident.estimation.measurement import Measurement
from ident.estimation.physical import physical_fit
from ident.estimation.piece import Piece
from ident.estimation.preparation import Prepared
from ident.estimation.setup import setup_parameters
from ident.estimation.setup_search import Refit, Search, searched
from ident.estimation.smoothing_start import smoothed, start
from ident.estimation.trajectory_pieces import WIDEST, WIDEST_BESIDE_TORQUES, cut, knot_distance
from ident.parameters.prior import known_covariance
from ident.recordings.wrench import GROUND

JUMPS, DRIFTS = 0.15, 0.9
"""Correlation from sample to sample from which a channel's residual asks for denser knots, and from which for none."""

SMALLER = 0.95
"""Part of a channel's noise that has to remain at most for denser knots to be worth it."""

ENOUGH = 10_000
"""Samples that noise, knots and set-up are found from first: what they say is hardly told better by more."""

OWN = ("offset", "delay")
"""What each of several recordings may have for itself."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint estimate.

    Attributes:
        measurement: Channels, and the parameters of one recording.
        search: Trajectories, parameters and noise, and what of the set-up was found not to be as stated.
        counts: Number of pieces of each recording.
        step: Largest distance of the knots, s.
        known: Whether a prior of the model's parameters was put in.
    """

    measurement: Measurement
    search: Search
    counts: tuple[int, ...]
    step: float
    known: bool

    @property
    def fit(self) -> JointFit:
        """Trajectories, parameters and noise."""
        return self.search.fit

    @cached_property
    def is_setup(self) -> np.ndarray:
        """Which parameters are of the set-up (p,)."""
        return _is_setup(self.measurement, self.fit.names)

    @cached_property
    def covariance_of_setup(self) -> np.ndarray:
        """What the priors leave open of the set-up adds to the covariance of all parameters (p, p).

        To the covariance with all of the set-up fitted belongs how far that would move the parameters: it was not.
        """
        whole = self.fit.covariance_with(self.is_setup)
        moves = whole @ np.where(self.is_setup, self.fit.gradient, 0)
        return whole - self.fit.covariance + np.outer(moves, moves)

    def as_stated(self) -> "Joint":
        """The same with the set-up as it was stated."""
        fit = replace(self.fit, theta=np.where(self.is_setup, 0.0, self.fit.theta))
        return replace(self, search=replace(self.search, fit=fit, deviations=()))

    def _pieces(self, which: int) -> slice:
        first = sum(self.counts[:which])
        return slice(first, first + self.counts[which])

    def parameters_of(self, which: int) -> np.ndarray:
        """Parameters of one recording."""
        return self.fit.theta[self.fit.selections[self._pieces(which).start]]

    def places_of(self, which: int) -> list[tuple[Piece, np.ndarray]]:
        """Pieces and spline coefficients of one recording."""
        own = self._pieces(which)
        return list(zip(self.fit.pieces[own], self.fit.coefficients[own], strict=True))

    def offsets_beside_first(self, which: int) -> np.ndarray:
        """By how much constant offsets of the first recording exceed those of another one (C,)."""
        constants = self.measurement.constants
        return constants(self.parameters_of(0)) - constants(self.parameters_of(which))


def joint_estimate(
    recordings: Sequence[tuple[Prepared, slice]],
    equations: Equations,
    *,
    setup: Mapping[str, float] | None = None,
    known: Mapping[str, float] | None = None,
    own: Sequence[str] = (),
    search: bool = True,
    physical: bool = False,
    knots: float | None = None,
    executor: Executor | None = None,
    report: Report | None = None,
) -> Joint:
    """Estimates trajectories, parameters, set-up and noise of recordings that share their parameters.

    Args:
        recordings: Mechanism and recording, and the samples to take.
        equations: Channels and columns.
        setup: What is known of the set-up, as for `setup_parameters`.
        known: How well φ of the model is known, as for `known_deviations`; None for not at all.
        own: What each recording has for itself, out of `OWN`.
        search: Whether to look for what of the set-up is not as stated.
        physical: Whether the bodies have to be physical.
        knots: Distance of the trajectory's knots, s, by default what the motion asks for.
        executor: Where pieces are worked on, by default here.
        report: Called with every round and its step in standard deviations.
    """
    if unknown := [kind for kind in own if kind not in OWN]:
        raise InputError(f"Recordings may have {' and '.join(OWN)} for themselves, got '{unknown[0]}'.")
    first, joints = recordings[0][0], recordings[0][0].mechanism.joints
    measurement = _measurement(first, equations, setup)
    names, selections = _shared(measurement, len(recordings), own)
    prior = _prior(measurement, names, known)
    task = _Task(measurement, recordings, names, selections, prior, known is not None, search, executor, report)
    samples = sum(part.stop - part.start for _, part in recordings)
    share = max(1, round(samples / ENOUGH))
    if knots:
        begin = task.searched(task.fitted(knots, share))
    else:
        widest = WIDEST if measurement.components else WIDEST_BESIDE_TORQUES
        step = min(knot_distance(prepared.recording, joints, widest) for prepared, _ in recordings)
        finest = 2 / min(prepared.recording.rate for prepared, _ in recordings)
        begin = _fine_enough(task, share, step, finest)
    estimate = task.searched(task.fitted(begin.step, begin=begin)) if share > 1 else begin
    return task.with_physical_bodies(estimate) if physical else estimate


@dataclass(frozen=True, eq=False)
class _Task:
    """What is estimated, and how.

    Attributes:
        measurement: Channels, and the parameters of one recording.
        recordings: Mechanism and recording, and the samples to take.
        names: Names of all parameters.
        selections: Which of these each recording has.
        prior: What is known of them.
        known: Whether that of the model's parameters is put in.
        search: Whether to look for what of the set-up is not as stated.
        executor: Where pieces are worked on.
        report: Called with every round.
    """

    measurement: Measurement
    recordings: Sequence[tuple[Prepared, slice]]
    names: Sequence[str]
    selections: Sequence[np.ndarray]
    prior: Prior
    known: bool
    search: bool
    executor: Executor | None
    report: Report | None

    @cached_property
    def is_setup(self) -> np.ndarray:
        """Which parameters are of the set-up (p,)."""
        return _is_setup(self.measurement, self.names)

    def fitted(self, step: float, share: int = 1, begin: Joint | None = None) -> Joint:
        """The estimate with the set-up as stated, or as it was found before.

        Args:
            step: Largest distance of the knots, s.
            share: One in so many pieces of each recording is taken.
            begin: An estimate to go on from: of fewer pieces, or with other knots; then the set-up is as stated again.
        """
        # Halves of what is fitted are compared: of one recording, or of several.
        least = 2 if len(self.recordings) == 1 else 1
        cuts = [cut(log, self.measurement, part, step, least=least)[::share] for log, part in self.recordings]
        pieces = [piece for own_pieces in cuts for piece in own_pieces]
        selected = [self.selections[k] for k, own_pieces in enumerate(cuts) for _ in own_pieces]
        refit = self._refit(pieces, selected)
        before = begin.search if begin and begin.step == step else None
        free = before.fit.free if before else ~self.is_setup
        if begin is None:
            at = _start(self.measurement, pieces, self.prior, selected, free, self.executor)
        else:
            theta = np.where(free | ~self.is_setup, begin.fit.theta, self.prior.mean)
            at = Start(theta, begin.fit.noise, smoothed(pieces, begin.fit.noise, executor=self.executor).coefficients)
        interrupted = begin is not None and begin.fit.status == "interrupted"
        fit = refit(at, free, 0 if interrupted else joint.ROUNDS)
        fit = replace(fit, status="interrupted") if interrupted else fit
        found = replace(before, fit=fit) if before else Search(fit)
        return Joint(self.measurement, found, tuple(map(len, cuts)), step, self.known)

    def searched(self, estimate: Joint) -> Joint:
        """The estimate with what of the set-up is not as stated, if that is to be looked for."""
        if not self.search or estimate.search.incredible:
            return estimate
        refit = self._refit(estimate.fit.pieces, estimate.fit.selections)
        groups = _groups(self.measurement, self.names)
        return replace(estimate, search=searched(estimate.search, refit, self.is_setup, groups))

    def with_physical_bodies(self, estimate: Joint) -> Joint:
        """The estimate with bodies that are physical."""
        refit = self._refit(estimate.fit.pieces, estimate.fit.selections)
        fit = physical_fit(estimate.fit, refit, self.measurement.equations, joint.ROUNDS)
        return replace(estimate, search=replace(estimate.search, fit=fit))

    def _refit(self, pieces: Sequence[Piece], selected: Sequence[np.ndarray]) -> Refit:
        """What fits pieces, each with its own of the parameters."""
        solve = partial(
            joint.fit,
            self.measurement,
            pieces,
            prior=self.prior,
            names=self.names,
            selections=selected,
            executor=self.executor,
            report=self.report,
        )
        return partial(_with_positive_drives, solve, self.measurement.equations)


def _fine_enough(task: _Task, share: int, step: float, finest: float) -> Joint:
    """Knots get denser as long as residuals are correlated, if that makes them smaller: something jumps.

    Where they are correlated over long times mostly the model is not quite right, and no trajectory should make up for
    that. Or else knots are much too far apart: then denser ones leave no drift, which the set-up must not explain. If a
    fit with denser knots does not settle, the best that did is taken.
    """

    def denser(estimate: Joint) -> Joint:
        return task.fitted(max(estimate.step / 2, finest), share, begin=estimate)

    coarse = task.fitted(step, share)
    try:
        if _drifts(coarse) and coarse.fit.status != "interrupted" and coarse.step > finest:
            fine = denser(coarse)
            coarse = fine if _smaller(fine, coarse) and not _drifts(fine) else coarse
    except (ExcitationError, np.linalg.LinAlgError):
        pass
    best = fine = task.searched(coarse)
    try:
        while _jumps(fine) and not _drifts(fine) and fine.fit.status != "interrupted" and fine.step > finest:
            fine = task.searched(denser(fine))
            if fine.fit.status == "stopped" and best.fit.status == "converged":
                break
            best = fine if _smaller(fine, best) else best
    except (ExcitationError, np.linalg.LinAlgError):
        pass
    return best


def _jumps(estimate: Joint) -> bool:
    """Whether a channel's residual asks for denser knots."""
    return bool((estimate.fit.noise.channels_rho > JUMPS).any())


def _drifts(estimate: Joint) -> bool:
    """Whether a channel's residual is correlated over so long times that denser knots hardly help."""
    return bool((estimate.fit.noise.channels_rho >= DRIFTS).any())


def _smaller(fine: Joint, coarse: Joint) -> bool:
    """Whether denser knots made a channel's noise smaller."""
    return bool((fine.fit.noise.channels < SMALLER * coarse.fit.noise.channels).any())


def _start(
    measurement: Measurement,
    pieces: Sequence[Piece],
    prior: Prior,
    selections: Sequence[np.ndarray],
    free: np.ndarray,
    executor: Executor | None,
) -> Start:
    """Where the fit begins: all recordings with the same parameters."""
    p = len(measurement.names)
    begin = start(measurement, pieces, prior.mean[:p], (prior.mean[:p], prior.precision[:p, :p]), free[:p], executor)
    theta = prior.mean.copy()
    for chosen in selections:
        theta[chosen] = begin.theta
    return Start(theta, begin.noise, begin.coefficients)


def _measurement(prepared: Prepared, equations: Equations, setup: Mapping[str, float] | None) -> Measurement:
    recording = prepared.recording
    # What a mechanism was read from need not cross to another process, nor can it.
    equations = replace(equations, mechanism=replace(equations.mechanism, source=None))
    contacts = {name: recording.sensors[name] for name in recording.wrenches if name != GROUND}
    plates = dict.fromkeys(sensor.plate or name for name, sensor in contacts.items())
    held = GROUND in recording.wrenches
    seen = (
        np.isfinite(prepared.wrench).all(axis=0)
        if held
        else np.arange(6) < len(equations.channels) - len(equations.torques)
    )
    return Measurement(
        equations,
        prepared.frame if held else None,
        tuple(np.flatnonzero(seen).tolist()),
        contacts,
        setup_parameters(equations, tuple(plates), dict(setup or {}), held=held),
        recording.base is not None,
    )


def _shared(measurement: Measurement, recordings: int, own: Sequence[str]) -> tuple[list[str], list[np.ndarray]]:
    """Names of all parameters, and which of them each recording has."""
    names, selections = list(measurement.names), [np.arange(len(measurement.names))]
    mine = [k for k, name in enumerate(measurement.names) if name.partition("(")[0] in own]
    for number in range(2, recordings + 1):
        chosen = np.arange(len(measurement.names))
        chosen[mine] = len(names) + np.arange(len(mine))
        names += [f"{measurement.names[k]} of log {number}" for k in mine]
        selections.append(chosen)
    return names, selections


def _is_setup(measurement: Measurement, names: Sequence[str]) -> np.ndarray:
    own = {each.name for each in measurement.setup}
    return np.array([name.partition(" of log ")[0] in own for name in names], bool)


def _groups(measurement: Measurement, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Directions in which the axes of all joints turn alike."""
    axes = {each.name: each.axis for each in measurement.setup if each.kind == "axis"}
    turned = {axis: np.array([axes.get(name) == axis for name in names], float) for axis in range(3)}
    return {f"a turn of all joint axes about {'xyz'[k]}": d for k, d in turned.items() if d.sum() > 1}


def _prior(measurement: Measurement, names: Sequence[str], known: Mapping[str, float] | None) -> Prior:
    """What is known of all parameters."""
    std = {each.name: each.std for each in measurement.setup}
    precision = np.diag(
        [1 / std[base] ** 2 if base in std else 0.0 for base in (n.partition(" of log ")[0] for n in names)]
    )
    mean = np.zeros(len(names))
    if known is not None:
        parameters, mechanism = measurement.equations.parameters, measurement.equations.mechanism
        mean[: parameters.rank] = parameters.regroup(mechanism.known)
        precision[: parameters.rank, : parameters.rank] = np.linalg.inv(known_covariance(mechanism, parameters, known))
    return Prior(mean, precision)


def _with_positive_drives(
    solve: partial[JointFit], equations: Equations, begin: Start, free: np.ndarray, rounds: int
) -> JointFit:
    """A fit whose friction and rotor inertias are not negative: what would be is none."""
    first = equations.parameters.rank
    drives = np.zeros(len(free), bool)
    drives[first : first + len(equations.drives)] = True
    fit = solve(begin, free=free, rounds=rounds)
    while (negative := drives & fit.free & (fit.theta < 0)).any():
        theta = np.where(negative, 0.0, fit.theta)
        fit = solve(Start(theta, fit.noise, fit.coefficients), free=fit.free & ~negative, rounds=rounds)
    return fit
