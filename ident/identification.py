"""Identification of base parameters from a mechanism and recordings: division of samples, estimators, candidates."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ident.arguments import check_holdout, checked_deviations, checked_names
from ident.errors import ExcitationError, InputError
from ident.estimate import Estimate, HeldOut
from ident.estimation import repairs
from ident.estimation.accumulator import accumulate, triangle_of
from ident.estimation.equations import Equations
from ident.estimation.excitation import blamed
from ident.estimation.flat_channels import flat_channels, without_channels
from ident.estimation.preparation import Prepared, prepared
from ident.estimation.samples import Samples, joined
from ident.estimation.separable import separable
from ident.estimation.setup import PRIORS
from ident.judgement.checks import wrench_checks
from ident.judgement.halves import DISAGREE, disagreement, disagreements, without
from ident.judgement.torque_checks import torque_checks
from ident.judgement.unmeasured import without_unmeasured
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import KNOWN, known_covariance
from ident.recordings.gaps import stretches
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND
from ident.regression.filtered import filtered_least_squares
from ident.regression.ordinary import Fit
from ident.regression.robust import robust_fit
from ident.tolerances import CONDITION_LIMIT, HOLDOUT
from ident.trajectory.angles_alone import LARGEST_END, UNSETTLED
from ident.trajectory.corrected import as_fit, corrected
from ident.trajectory.estimate import OWN, trajectory_estimate
from ident.trajectory.fit.iteration import Report
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.smoothing_choice import chosen_smoothing

ESTIMATORS = ("trajectory", "weighted", "ordinary")

FORMER = {"joint": "trajectory"}
"""Former names of estimators, which are still accepted."""

NO_CUTOFF = "The trajectory estimate filters nothing: --cutoff belongs to --estimator weighted or ordinary."

LEAST_HELD_OUT = 2
"""Least number of held-out samples: a signal's standard deviation needs two."""

FAR_LESS = 30.0
"""Standard deviations from the data, over those of the prior, above which the prior is used."""


def identify(
    mechanism: Mechanism,
    recording: Recording | Sequence[Recording],
    *,
    estimator: str = "trajectory",
    cutoff: str | float | None = None,
    drive: Sequence[str] = (),
    leave_out: Sequence[str] = (),
    offsets: bool = True,
    holdout: float = HOLDOUT,
    held_out: Recording | Sequence[Recording] = (),
    own: Sequence[str] = (),
    setup: Mapping[str, float] | None = None,
    known: Mapping[str, float] | bool | None = None,
    physical: bool = False,
) -> Estimate:
    """Base parameters of a mechanism from recordings, judged on samples that were not fitted.

    Args:
        mechanism: The mechanism, with a prior, from `sim.mechanism`.
        recording: Joint states and wrenches, from `read_log` or `sim.simulate`: one recording, or several that share
            their parameters.
        estimator: As for `identified`; so are `offsets`, `holdout`, `own`, `setup`, `known` and `physical`.
        cutoff: Cut-off of the low-pass for least squares in Hz, `auto`, or None for the recording's own velocities and
            accelerations. The trajectory estimate has none, and uses joint coordinates alone.
        drive: Columns of friction and rotor inertia for joint torques: `viscous`, `coulomb`, `rotor`, `stribeck`.
        leave_out: Channels that are neither fitted nor judged, as `Fz`, `Mx` and `My` of a model that moves in the
            plane normal to z; joints' names for joint torques.
        held_out: Other recordings to judge by.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
        ExcitationError: The motion does not separate the base parameters.
    """
    estimator = FORMER.get(estimator, estimator)
    if estimator == "trajectory" and cutoff is not None:
        raise InputError(NO_CUTOFF)
    options: dict[str, Any] = {"cutoff": cutoff, "drive": drive, "leave_out": leave_out}
    logs, judges = (
        [prepared(mechanism, each, filters=estimator != "trajectory", **options) for each in _recordings(where, given)]
        for where, given in (("recording", recording), ("held_out", held_out))
    )
    return identified(
        logs,
        estimator=estimator,
        offsets=offsets,
        holdout=holdout,
        judges=judges,
        own=own,
        setup=setup,
        known=known,
        physical=physical,
    )


def identified(
    logs: Prepared | Sequence[Prepared],
    *,
    estimator: str = "trajectory",
    offsets: bool = True,
    holdout: float = HOLDOUT,
    judges: Sequence[Prepared] = (),
    own: Sequence[str] = (),
    setup: Mapping[str, float] | None = None,
    known: Mapping[str, float] | bool | None = None,
    physical: bool = False,
    executor: Executor | None = None,
    report: Report | None = None,
) -> Estimate:
    """Fits recordings and judges the fit on held-out samples.

    Args:
        logs: Mechanism and recording, one or several.
        estimator: `trajectory` for motion, parameters, set-up and noise at once, from joint angles; `weighted` for
            least squares with states taken as exact, channels weighted by their residuals and outliers weighted down;
            `ordinary` for that of the paper.
        offsets: True to fit a constant offset of every channel for which it can be separated from the parameters.
        holdout: Fraction of each recording, its end, that is not fitted; with zero the fit is judged on the fitted
            samples. The trajectory estimate fits three recordings or more whole, and predicts each from the rest.
        judges: Other recordings of the same channels to judge by, of any length; then all logs are fitted whole.
        own: Parameters that each recording has separately in the trajectory estimate: `offset`, `delay`.
        setup: Standard deviations of the set-up for the trajectory estimate, as for `setup_parameters`; by default
            those of the recording.
        known: Standard deviations of the model's φ for the trajectory estimate, as for `body_covariance`: True for the
            default, False for no prior, None for the default where the motion does not separate all parameters.
        physical: True if the trajectory estimate's bodies must be physical, as close to the model's as the recordings
            allow; by default only those of `Estimate.consistent` are.
        executor: Executor for the pieces of the trajectory estimate.
        report: Called with every round of the trajectory estimate, and its step in standard deviations.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        InputError: A recording is too short, or has other channels than the first.
    """
    estimator = FORMER.get(estimator, estimator)
    if estimator not in ESTIMATORS:
        raise InputError(f"An estimator is one of {', '.join(ESTIMATORS)}, got '{estimator}'.")
    check_holdout(holdout)
    own = checked_names("own", own, OWN)
    setup = {} if setup is None else checked_deviations("setup", setup, PRIORS)
    beforehand = {} if known is None or isinstance(known, bool) else checked_deviations("known", known, KNOWN)
    logs = [logs] if isinstance(logs, Prepared) else list(logs)
    if not logs:
        raise InputError("An identification needs at least one recording, got none.")
    logs, judges = ([without_unmeasured(log) for log in several] for several in (logs, judges))
    if estimator != "trajectory":
        if own:
            raise InputError(f"Only the trajectory estimate gives recordings {' and '.join(own)} of their own.")
        if physical:
            raise InputError("Only the trajectory estimate can be held to physical bodies.")
        divided = _without_flat(_divided(logs, holdout, judges, alone=False))
        return _least_squares(divided, estimator == "weighted", offsets)
    # Without a filter no ends are left out.
    logs, judges = ([replace(log, cutoff=None) for log in several] for several in (logs, judges))
    divided = _without_flat(_divided(logs, 0.0 if len(logs) > 2 and not judges else holdout, judges, alone=True))
    told = logs[0].recording
    prior = {**KNOWN, **checked_deviations("known", told.known, KNOWN), **beforehand}
    stated = {**checked_deviations("setup", told.setup, PRIORS), **setup}
    options = {"own": own, "setup": stated, "physical": physical, "executor": executor, "report": report}
    return _joint(divided, offsets, prior, None if known is None else bool(known), **options)


def _recordings(where: str, given: Recording | Sequence[Recording]) -> list[Recording]:
    """One recording or several as a list."""
    several = [given] if isinstance(given, Recording) else list(given) if isinstance(given, Iterable) else [given]
    if wrong := [each for each in several if not isinstance(each, Recording)]:
        raise InputError(f"{where} needs a recording or a list of them, got {type(wrong[0]).__name__}.")
    return several


@dataclass(frozen=True)
class _Divided:
    """Samples to fit and samples to judge by.

    Attributes:
        fitted: Recordings and the samples of each to fit.
        judged: Recordings and the samples of each to judge by.
        apart: True if the latter are separate recordings.
        smoothing: Time constant with which the angles of samples to judge by are smoothed, s.
    """

    fitted: list[tuple[Prepared, slice]]
    judged: list[tuple[Prepared, slice | np.ndarray]]
    apart: bool
    smoothing: float = 0.0

    @property
    def equations(self) -> Equations:
        """Channels and columns, without offsets."""
        return self.fitted[0][0].equations

    @property
    def held(self) -> bool:
        """True if something besides the contacts holds the base, measured or not."""
        first = self.fitted[0][0].recording
        return GROUND in first.wrenches or not first.wrenches

    @property
    def samples(self) -> Samples:
        """All samples to fit."""
        return joined([log.samples[log.taken(part)] for log, part in self.fitted])

    def with_logs(self, logs: Sequence[Prepared], judges: Sequence[Prepared]) -> "_Divided":
        """Division into the same parts of other versions of the recordings."""
        fitted = [(log, part) for log, (_, part) in zip(logs, self.fitted, strict=True)]
        return replace(
            self, fitted=fitted, judged=[(log, part) for log, (_, part) in zip(judges, self.judged, strict=True)]
        )

    def held_out(self, fits: Sequence[Fit]) -> HeldOut:
        """Residuals on the samples to judge by, of one fit for all recordings or one for each."""
        samples = [log.samples[log.taken(part)] for log, part in self.judged]
        each = list(fits) * len(samples) if len(fits) == 1 else fits
        residual = np.concatenate([fit.residual(x) for fit, x in zip(each, samples, strict=True)])
        time, starts = _in_a_row([log.recording.time[log.taken(part)] for log, part in self.judged])
        return HeldOut(time, joined(samples), fits[0], residual, starts)


def _in_a_row(times: Sequence[np.ndarray]) -> tuple[np.ndarray, tuple[int, ...]]:
    """Times of recordings one after the other, and the indices at which each begins or continues after a gap."""
    out, starts = times[0][:0], list[int]()
    for own in times:
        starts += [len(out) + run.start for run in stretches(own, np.ones(len(own), bool))]
        out = np.append(out, own - own[0] + out[-1] + np.median(np.diff(own)) if len(out) else own)
    return out, tuple(starts)


def _least_squares(divided: _Divided, weighted: bool, offsets: bool) -> Estimate:
    """Estimate by least squares with states taken as exact."""
    equations, samples = divided.equations, divided.samples
    singular_values, poor = _excited(equations, samples)
    if poor:
        raise poor
    with_offsets = separable(equations.with_offsets(range(len(equations.channels))), samples)
    full = robust_fit(with_offsets, samples, weighted=weighted)
    fit = full if offsets else robust_fit(equations, samples, weighted=weighted)
    model = divided.held_out([_model_as_it_came(full, samples)])
    rivals = {"model": model.ratio}
    return Estimate(divided.fitted, fit, full.offsets, divided.held_out([fit]), singular_values, rivals=rivals)


def _joint(
    divided: _Divided, offsets: bool, prior: Mapping[str, float], wanted: bool | None, **options: Any
) -> Estimate:
    """Trajectory estimate of trajectories, parameters, set-up and noise."""
    equations, samples = divided.equations, divided.samples
    singular_values, poor = _excited(equations, samples)
    still = samples.motion.base is None and not np.ptp(samples.motion.q, axis=0).any()
    if poor and (still or wanted is False):
        raise poor
    known = prior if wanted or poor else None
    with_offsets = separable(equations.with_offsets(range(len(equations.channels))), samples)
    if not divided.held:
        # Where the sum of all wrenches is zero, a constant one is weight, not an offset.
        components = len(equations.channels) - len(equations.torques)
        with_offsets = equations.with_offsets([k for k in with_offsets.offsets if k >= components])
    # No search if the set-up is exact, or if something is grossly wrong.
    search = any((PRIORS | options["setup"]).values()) and not any(_grossly_wrong(log) for log, _ in divided.fitted)
    columns = with_offsets if offsets else equations
    estimate = partial(trajectory_estimate, divided.fitted, columns, search=search, **options)
    trajectory = _known_enough(estimate, known, prior if wanted is None else known)
    rms = disagreement(trajectory)
    widening = rms if rms is not None and rms > DISAGREE else 1.0
    divided = replace(divided, smoothing=chosen_smoothing(divided.fitted, trajectory))
    mended = _corrected(divided, trajectory)
    fit = as_fit(trajectory, mended.samples, mended.equations, widening)
    fits = [fit]
    if not divided.apart and len(divided.fitted) > 2:
        values = (without(trajectory, k) for k in range(len(divided.fitted)))
        fits = [replace(fit, values=x[: len(fit.values)]) for x in values]
    rivals, filtered_at = _rivals(divided, with_offsets, trajectory, fit)
    return Estimate(
        logs=mended.fitted,
        fit=fit,
        offsets=fit.offsets,
        held_out=mended.held_out(fits),
        singular_values=singular_values,
        trajectory=trajectory,
        rivals=rivals,
        filtered_at=filtered_at,
        disagreement=rms,
        disagreements=disagreements(trajectory),
        widening=widening,
        bounded=trajectory.bounds,
    )


def _grossly_wrong(log: Prepared) -> bool:
    """True if a wrench or torque is so wrong that a search for small set-up errors is pointless."""
    frames, base = wrench_checks(log)
    torques = torque_checks(log)
    wrench = any(check.suspicious for check in frames.values()) or (base is not None and base.suspicious)
    return wrench or (torques is not None and torques.grossly_wrong)


def _known_enough(
    estimate: Callable[..., TrajectoryEstimate], known: Mapping[str, float] | None, prior: Mapping[str, float] | None
) -> TrajectoryEstimate:
    """Trajectory estimate, with a prior if the data alone are far less precise: noise can pass for excitation.

    Args:
        estimate: Function that estimates with given standard deviations of φ.
        known: Standard deviations to use first, None for no prior.
        prior: Standard deviations to fall back on, None for none.
    """
    try:
        trajectory = _solvable(estimate, known)
    except ExcitationError:
        if known or prior is None:
            raise
        return _solvable(estimate, prior)
    if known or prior is None:
        return trajectory
    equations = trajectory.measurement.equations
    beforehand = np.diag(known_covariance(equations.mechanism, equations.parameters, prior))
    far_less = np.diag(trajectory.fit.covariance)[: equations.parameters.rank] > FAR_LESS**2 * beforehand
    return _solvable(estimate, prior) if far_less.any() else trajectory


def _solvable(estimate: Callable[..., TrajectoryEstimate], known: Mapping[str, float] | None) -> TrajectoryEstimate:
    """Trajectory estimate; raises an ExcitationError if its equations are singular up to rounding."""
    try:
        return estimate(known=known)
    except np.linalg.LinAlgError:
        raise ExcitationError(
            "The trajectory estimate's equations are singular but for rounding: some joint angles follow a curve "
            "exactly, as computed or smoothed ones do, or hardly move in what is fitted. Take the angles as they were "
            "measured, hold joints that rest (--fix), or fit what the model knows as well (--prior on)."
        ) from None


def _corrected(divided: _Divided, trajectory: TrajectoryEstimate) -> _Divided:
    """Recordings with the set-up of a trajectory estimate and smoothed motion, that to judge by from angles alone."""
    smoothing = divided.smoothing
    logs = [corrected(log, trajectory, k, smoothing, part) for k, (log, part) in enumerate(divided.fitted)]
    if divided.apart:
        judges = [corrected(log, trajectory, None, smoothing) for log, _ in divided.judged]
    elif len(divided.fitted) > 2:
        judges = [corrected(log, trajectory, k, smoothing) for k, (log, _) in enumerate(divided.judged)]
    else:
        judges = logs
    return divided.with_logs(logs, judges)


def _rivals(
    divided: _Divided, equations: Equations, trajectory: TrajectoryEstimate, fit: Fit
) -> tuple[dict[str, np.ndarray], float | None]:
    """Residual ratios of other candidates with the set-up as stated: the model's prior, and least squares.

    Args:
        divided: Samples to fit and to judge by.
        equations: Their columns, with offsets.
        joint: The trajectory estimate.
        fit: The trajectory estimate as a fit.

    Returns:
        Ratios of residual to signal by candidate (C,), and the cut-off of least squares, Hz.
    """
    stated = _corrected(divided, trajectory.as_stated())
    held = stated.held_out([_model_as_it_came(replace(fit, equations=equations), stated.samples)])
    rank, prior = equations.parameters.rank, trajectory.fit.prior
    known = prior.mean[:rank], prior.known[:rank, :rank]
    others = not divided.apart and len(divided.fitted) > 2
    filtered = filtered_least_squares(divided.fitted, divided.judged, equations, known, others=others)
    left = replace(held, residual=held.samples.measured - np.concatenate(filtered.predicted))
    return {"model": held.ratio, "least squares": left.ratio}, filtered.cutoffs[0]


def _model_as_it_came(fit: Fit, samples: Samples) -> Fit:
    """Fit replaced by the model's prior parameters, without drives, with the mean residuals of samples as offsets."""
    equations = fit.equations
    prior = equations.parameters.regroup(equations.mechanism.known)
    model = replace(fit, values=np.r_[prior, np.zeros(len(equations.names) - len(prior))])
    if equations.offsets:
        model.values[-len(equations.offsets) :] = model.residual(samples).mean(axis=0)[list(equations.offsets)]
    return model


def _divided(logs: Sequence[Prepared], holdout: float, judges: Sequence[Prepared], *, alone: bool) -> _Divided:
    """Samples to fit, and samples of the same or other recordings to judge by.

    Args:
        logs: Recordings to fit.
        holdout: Fraction of each, its end, to judge by.
        judges: Other recordings to judge by instead.
        alone: True if accelerations of the samples to judge by will follow from angles alone.

    Raises:
        InputError: There are too few samples, or channels differ.
    """
    first = logs[0].equations
    for other, role in [
        *((log, "A log to fit besides the first") for log in logs[1:]),
        *((j, "A log to judge by") for j in judges),
    ]:
        if other.equations.channels != first.channels:
            raise InputError(
                f"{role} needs the channels {', '.join(first.channels)}; it has {', '.join(other.equations.channels)}."
            )
    whole, ends = zip(*(_split(log, 0.0 if judges else holdout) for log in logs), strict=True)
    measured = [log.samples.measured[part] for log, part in zip(logs, whole, strict=True)]
    if any(map(len, measured)) and not any(np.ptp(x, axis=0).any() for x in measured if len(x)):
        raise InputError("Every measured channel is constant; there is nothing to fit.")
    if judges:
        ends = tuple(slice(judge.edge, len(judge.samples) - judge.edge) for judge in judges)
        for judge, end in zip(judges, ends, strict=True):
            if end.stop - end.start < LEAST_HELD_OUT:
                raise InputError(
                    f"The log to judge by has {len(judge.samples)} samples; with {judge.edge} left out at either end, "
                    "where the filter settles, nothing remains."
                )
    needed = len(first.names) + len(first.channels)
    rows = sum(len(log.taken(part)) for log, part in zip(logs, whole, strict=True))
    judged = sum(len(log.taken(part)) for log, part in zip(judges or logs, ends, strict=True))
    if rows < needed or judged < LEAST_HELD_OUT:
        raise InputError(
            f"{sum(len(log.samples) for log in logs)} samples, {logs[0].edge} left out at either end and "
            f"{holdout:.0%} held out, are too few for {len(first.names)} parameters.{_lost(logs)}"
        )
    fitted = [(_with_rests(log, part), part) for log, part in zip(logs, whole, strict=True)]
    to_judge = [(log, _settled(log, end) if alone else end) for log, end in zip(judges or logs, ends, strict=True)]
    return _Divided(fitted, to_judge, bool(judges))


def _with_rests(log: Prepared, part: slice) -> Prepared:
    """Recording with notes on joints that rest in the fitted part and move later."""
    sentences = [] if part.start >= part.stop else repairs.rests(log.recording, log.mechanism.tree, part)
    whole = {note.partition(" rests at ")[0] for note in log.notes}
    more = [f"In what is fitted, {x}" for x in sentences if x.partition(" rests at ")[0] not in whole]
    return replace(log, notes=(*log.notes, *more)) if more else log


def _lost(logs: Sequence[Prepared]) -> str:
    """Sentence on the samples lost to clipping and gaps, with a leading space; empty if none are."""
    inside = [slice(log.edge, len(log.samples) - log.edge) for log in logs]
    kept = sum(len(log.taken(part)) for log, part in zip(logs, inside, strict=True))
    if kept == sum(part.stop - part.start for part in inside):
        return ""
    filtered = (
        ", or nearer to one than the filter settles; the trajectory estimate filters nothing" if logs[0].edge else ""
    )
    return f" Of those, {kept} are left: the others are clipped, left out or in a gap{filtered}."


def _without_flat(divided: _Divided) -> _Divided:
    """Division without channels that are constant in the fitted samples, unless none would be left."""
    flat = flat_channels(divided.fitted)
    flat = {name: x for name, x in flat.items() if name in divided.equations.channels}
    if not flat or len(flat) == len(divided.equations.channels):
        return divided
    logs, judges = ([without_channels(log, flat) for log, _ in several] for several in (divided.fitted, divided.judged))
    return divided.with_logs(logs, judges)


def _split(log: Prepared, holdout: float) -> tuple[slice, slice]:
    """Samples of a recording to fit and to judge by; the same ones if nothing is held out."""
    edge, samples = log.edge, len(log.samples)
    if 2 * edge >= samples:
        raise InputError(
            f"A cut-off of {log.cutoff:g} Hz settles in {edge} samples at either end, more than half of the "
            f"{samples} recorded; take a higher one."
        )
    if not holdout:
        return slice(edge, samples - edge), slice(edge, samples - edge)
    usable = log.taken(slice(0, samples))
    split = int(usable[round((1 - holdout) * len(usable))]) if len(usable) else samples
    return slice(edge, split), slice(split, samples - edge)


def _settled(log: Prepared, part: slice) -> slice | np.ndarray:
    """Part to judge by without the ends of the recording and at gaps, unless too little would remain."""
    time, kept = log.recording.time, np.zeros(len(log.samples), bool)
    for run in stretches(time, log.covered):
        first, last = time[run][[0, -1]]
        edge = min(UNSETTLED, LARGEST_END * (last - first))
        kept[run] = (time[run] > first + edge) & (time[run] < last - edge)
    settled = np.arange(len(kept))[part][kept[part]]
    return settled if len(log.taken(settled)) >= LEAST_HELD_OUT else part


def _excited(equations: Equations, samples: Samples) -> tuple[np.ndarray, ExcitationError | None]:
    """Singular values of the unit-norm columns, each channel divided by its signal, and an error if some are too small.

    The error names the parameters in combinations that the motion does not separate.
    """
    signal = np.maximum(samples.measured.std(axis=0), 1e-300)
    weights = np.broadcast_to(1 / signal, samples.measured.shape)
    columns = accumulate(equations, samples, factors=weights).root[:, : len(equations.names)]
    norms = np.linalg.norm(columns, axis=0)
    # A decomposition of the triangle is faster than one of all rows, and less likely to fail to converge.
    _, s, directions = np.linalg.svd(triangle_of(columns / np.where(norms > 0, norms, 1)))
    hidden = directions[s <= s[0] / CONDITION_LIMIT]
    if not len(hidden):
        return s, None
    names = blamed(hidden, equations.names)
    return s, ExcitationError(
        f"In {', '.join(equations.channels)} the recorded motion excites {len(s) - len(hidden)} of {len(s)} "
        f"parameters; it does not separate {', '.join(names)}. Move the joints further (experiments.excite "
        "designs a motion), measure more, or put in what the model knows (--prior on).",
        names,
    )
