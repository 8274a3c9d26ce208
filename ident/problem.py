"""The problem that an estimator solves: recordings, the samples of them to fit and to judge by, and what is known."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from ident.display.brief import listed
from ident.errors import InputError
from ident.estimation import repairs
from ident.estimation.equations import COMPONENTS, Equations, predicted_channels
from ident.estimation.preparation import Part, Prepared, equations_of
from ident.estimation.samples import Samples, joined
from ident.parameters.prior import KNOWN
from ident.recordings.recording import Recording
from ident.recordings.smoothing import stretches
from ident.recordings.times import POSES, SLOW
from ident.recordings.wrench import GROUND
from ident.regression.held_out import HeldOut
from ident.regression.ordinary import Fit
from ident.trajectory.angles_alone import LARGEST_END, UNSETTLED
from ident.trajectory.fit.iteration import Report

LEAST_FITTED = 12
"""Least number of a recording's samples from which its trajectory is estimated. Of 9 parts of a simulated double
pendulum, 1 had an estimate from 9 samples, and all from 12; of 45 estimates from 12 to 27 samples, with a prior, 42
missed no parameter by more than 2 standard deviations, 3 missed one by 8 (none was called usable)."""

ROW = 5
"""Number of samples in a row that no two recordings have alike, as noise is none where channels have few digits."""

FITTED = "A log to fit besides the first"
"""Such a log in messages."""

LEAST_HELD_OUT = 2
"""Least number of held-out samples: a signal's standard deviation needs two."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A problem for any estimator: samples to fit and to judge by, and prior knowledge.

    Attributes:
        fitted: Parts of recordings to fit.
        judged: Parts of recordings to judge by.
        apart: True if the latter are separate recordings.
        offsets: True to fit a constant offset of every channel for which it can be separated from the parameters.
        known: Standard deviations of the model's φ, as for `body_covariance`.
        wanted: True to use them, False not to, None where the data are far less precise.
        setup: Standard deviations of the set-up that replace the default ones.
        own: Parameters that each recording has separately: `offset`, `delay`.
        physical: True if the bodies must be physical.
        executor: Executor for the pieces of an estimate, by default none.
        report: Called with every round, and its step in standard deviations.
    """

    fitted: list[Part[slice]]
    judged: list[Part[slice | np.ndarray]]
    apart: bool
    offsets: bool = True
    known: Mapping[str, float] = field(default_factory=lambda: dict(KNOWN))
    wanted: bool | None = None
    setup: Mapping[str, float] = field(default_factory=dict)
    own: Sequence[str] = ()
    physical: bool = False
    executor: Executor | None = None
    report: Report | None = None

    @property
    def equations(self) -> Equations:
        """Channels and columns, without offsets."""
        return self.fitted[0].log.equations

    @property
    def held(self) -> bool:
        """True if something besides the contacts holds the base, measured or not."""
        first = self.fitted[0].log.recording
        return GROUND in first.wrenches or not first.wrenches

    @property
    def samples(self) -> Samples:
        """All samples to fit."""
        return joined([part.used for part in self.fitted])

    @property
    def settled(self) -> list[Part[slice | np.ndarray]]:
        """Parts to fit without the ends of the recordings and at gaps, as those to judge by."""
        return [_settled(part.log, part.samples) for part in self.fitted]

    @property
    def leaves_out(self) -> bool:
        """True if each of the recordings is judged by, predicted from the others."""
        return not self.apart and len(self.fitted) > 2

    @property
    def judges_fitted(self) -> bool:
        """True if nothing is held out, so that the fitted samples are judged by."""
        return not (self.apart or self.leaves_out) and bool(
            np.isin(self.judged[0].indices, self.fitted[0].indices).any()
        )

    def with_logs(self, logs: Sequence[Prepared], judges: Sequence[Prepared]) -> "Problem":
        """Problem of other versions of the recordings, divided into the same parts."""
        fitted = [part.of(log) for log, part in zip(logs, self.fitted, strict=True)]
        judged = [part.of(log) for log, part in zip(judges, self.judged, strict=True)]
        return replace(self, fitted=fitted, judged=judged)

    def held_out(self, fit: Fit) -> HeldOut:
        """Residuals of a fit on the samples to judge by, at the recorded motion."""
        samples = joined([part.used for part in self.judged])
        residual, none = fit.residual(samples), np.zeros(samples.measured.shape, int)
        return HeldOut(*self.in_a_row, (samples,), none, fit, residual, none > 0, fitted=self.judges_fitted)

    @property
    def in_a_row(self) -> tuple[np.ndarray, tuple[int, ...]]:
        """Times of the recordings to judge by in a row, and indices at which each begins or continues after a gap."""
        times = [part.times for part in self.judged]
        out, starts = times[0][:0], list[int]()
        for own in times:
            starts += [len(out) + run.start for run in stretches(own, np.ones(len(own), bool))]
            out = np.append(out, own - own[0] + out[-1] + np.median(np.diff(own)) if len(out) else own)
        return out, tuple(starts)


def problem_of(
    logs: Sequence[Prepared], holdout: float, judges: Sequence[Prepared], *, alone: bool, **more: Any
) -> Problem:
    """Problem with samples to fit, and samples of the same or other recordings to judge by; no channel is constant.

    Args:
        logs: Recordings to fit.
        holdout: Fraction of each, its end, to judge by.
        judges: Other recordings to judge by instead.
        alone: True if accelerations of the samples to judge by will follow from angles alone.
        more: Other fields of the problem.

    Raises:
        InputError: There are too few samples, or channels differ.
    """
    check_different(logs, judges)
    first = logs[0].equations
    for other, role in [*((log, FITTED) for log in logs[1:]), *((j, "A log to judge by") for j in judges)]:
        # A log to judge by is judged in its forces and torques alone.
        poses = [[f"poses '{x}'" for x in sorted(log.recording.trackers) if role == FITTED] for log in (logs[0], other)]
        required, there = (*first.channels, *poses[0]), (*other.equations.channels, *poses[1])
        if there != required:
            raise InputError(f"{role} needs the channels {', '.join(required)}; it has {', '.join(there)}.")
        moves = [log.samples.motion.base is not None for log in (logs[0], other)]
        if moves[0] != moves[1] or not np.allclose(other.mechanism.gravity, logs[0].mechanism.gravity):
            raise InputError(
                f"{role} needs a base that {'moves' if moves[0] else 'rests in the same direction of gravity'}, as "
                "that of the first; identify it by itself, and `compare` the results."
            )
    whole, ends = zip(*(_split(log, 0.0 if judges else holdout) for log in logs), strict=True)
    measured = [log.samples.measured[part] for log, part in zip(logs, whole, strict=True)]
    if any(map(len, measured)) and not any(np.ptp(x, axis=0).any() for x in measured if len(x)):
        raise InputError(_nothing_varies(logs[0]))
    if judges:
        ends = tuple(slice(judge.edge, len(judge.samples) - judge.edge) for judge in judges)
        for judge, end in zip(judges, ends, strict=True):
            if end.stop - end.start < LEAST_HELD_OUT:
                raise InputError(
                    f"The log to judge by has {len(judge.samples)} samples; with {judge.edge} left out at either end, "
                    "where the filter settles, nothing remains."
                )
    # Bodies that may be taken as known are a row for each base parameter.
    known = alone and more.get("wanted") is not False and logs[0].mechanism.prior is not None
    rows = len(first.names) + len(first.channels) - known * first.parameters.rank
    needed, least = -(-rows // len(first.channels)), LEAST_FITTED if alone else 1
    fitted = [len(log.taken(part)) for log, part in zip(logs, whole, strict=True)]
    judged = sum(len(log.taken(part)) for log, part in zip(judges or logs, ends, strict=True))
    if sum(fitted) < needed or min(fitted) < least or judged < LEAST_HELD_OUT:
        raise InputError(
            f"{sum(len(log.samples) for log in logs)} samples, {logs[0].edge} left out at either end and "
            f"{100 * holdout:.0f} % held out, are too few for {len(first.names)} parameters.{_lost(logs)} The fit "
            f"needs {needed}, of each log at least {least}, and the judgement {LEAST_HELD_OUT}; there are "
            f"{' + '.join(map(str, fitted))} and {judged}.{POSES if 1 / logs[0].recording.rate >= SLOW else ''}"
        )
    to_fit = [Part(_with_rests(log, part), part) for log, part in zip(logs, whole, strict=True)]
    to_judge = [_settled(log, end) if alone else Part(log, end) for log, end in zip(judges or logs, ends, strict=True)]
    return _without_flat(Problem(to_fit, to_judge, bool(judges), **more))


def _nothing_varies(log: Prepared) -> str:
    """Sentence on a recording whose channels are all constant, or that has none where nothing holds the base."""
    if log.recording.wrenches or log.equations.torques:
        return f"Every measured channel ({', '.join(log.equations.channels)}) is constant; there is nothing to fit."
    unused = log.recording.unused
    there = f"columns that are not used are {listed(unused)}" if unused else "all of its columns are used"
    return (
        "Nothing holds the base, so that a wrench on a body or a joint torque is needed, and none is mapped; "
        f'{there}. Wrenches belong under [wrenches], those of plates with frame = "world" and on = BODY: '
        "`multicontact columns MODEL LOG` writes a mapping to correct."
    )


def check_different(logs: Sequence[Prepared], judges: Sequence[Prepared] = ()) -> None:
    """Refuses a recording that is fitted twice, or fitted and to judge by."""
    rows = cache(_rows)
    for number, log in enumerate((*logs, *judges)):
        for before, other in enumerate(logs[:number]):
            one, shared = log.recording, tuple(sorted(log.recording.measured.keys() & other.recording.measured.keys()))
            few, many = sorted((rows(each, shared) for each in (one, other.recording)), key=len)
            # Most samples of one recording, in rows of `ROW`, are the other's in all channels that both have.
            if one is other.recording or (shared and len(few) > ROW and float(np.isin(few, many).mean()) > 0.5):
                raise InputError(
                    "A recording can be fitted once only, but one of them is given twice: most samples of number "
                    f"{number + 1} are those of number {before + 1}."
                    if number < len(logs)
                    else "The recording to judge by (held_out) has to be another one than the recording that is fitted."
                )


def _rows(recording: Recording, names: tuple[str, ...]) -> np.ndarray:
    """A number for each different row of `ROW` samples, the same wherever its values are the same (k,)."""
    sample = np.zeros(len(recording.time))
    columns = (column for name in names for column in recording[name].reshape(len(sample), -1).T)
    for k, column in enumerate(columns):
        sample += np.sqrt(2 + k) * np.nan_to_num(column)
    count = max(len(sample) - ROW + 1, 0)
    return np.unique(np.sum([np.sqrt(2 + k) * sample[k : k + count] for k in range(ROW)], axis=0))


def _with_rests(log: Prepared, part: slice) -> Prepared:
    """Recording with notes on joints that rest in the fitted part and move later."""
    inside = {} if part.start >= part.stop else repairs.rests(log.recording, log.mechanism.tree, part)
    always = repairs.rests(log.recording, log.mechanism.tree)
    more = {joint: x for joint, x in inside.items() if joint not in always}
    notes = [f"In what is fitted, {repairs.rest_note(*each)}" for each in more.items()]
    return replace(log, notes=(*log.notes, *notes), resting=(*log.resting, *more)) if more else log


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


def _without_flat(problem: Problem) -> Problem:
    """Problem without channels that are constant in the fitted samples, unless none would be left."""
    flat = _flat_channels(problem.fitted)
    flat = {name: x for name, x in flat.items() if name in problem.equations.channels}
    if not flat or len(flat) == len(problem.equations.channels):
        return problem
    every = (problem.fitted, problem.judged)
    logs, judges = ([_less_channels(part.log, flat) for part in parts] for parts in every)
    return problem.with_logs(logs, judges)


def _flat_channels(parts: Sequence[Part[slice]]) -> dict[str, float]:
    """Channels that are constant in the parts of recordings to fit, with their values."""
    every = [repairs.constants(part.log.recording, part.log.mechanism.tree, part.samples) for part in parts]
    return {name: x for name, x in every[0].items() if all(each.get(name) == x for each in every)}


def _less_channels(log: Prepared, flat: Mapping[str, float]) -> Prepared:
    """Recording without channels that are constant in the fitted samples; a note or a finding reports them.

    Args:
        log: The recording.
        flat: Channels to leave out and their values.
    """
    mechanism, motion, old, notes = log.mechanism, log.samples.motion, log.equations, list(log.notes)
    kept = [k for k, name in enumerate(old.channels) if name not in flat]
    samples = replace(log.samples, measured=log.samples.measured[:, kept])
    channels = tuple(old.channels[k] for k in kept)
    equations, sensors = equations_of(mechanism, log.recording, log.frame, samples, channels, log.drives)
    predicted = predicted_channels(mechanism, motion, log.frame, torques=bool(old.torques))
    stuck = repairs.stuck(flat, predicted, notes, in_fitted=True)
    return replace(
        log,
        recording=repairs.without_channels(log.recording, mechanism.tree, flat),
        equations=equations,
        samples=samples,
        sensors=sensors,
        wrench=np.where(np.isin(COMPONENTS, list(flat)), np.nan, log.wrench),
        notes=tuple(notes),
        stuck=(*log.stuck, *stuck),
    )


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


def _settled(log: Prepared, part: slice) -> Part[slice | np.ndarray]:
    """Part to judge by without the ends of the recording and at gaps, unless too little would remain."""
    time, kept = log.recording.time, np.zeros(len(log.samples), bool)
    for run in stretches(time, log.covered):
        first, last = time[run][[0, -1]]
        edge = min(UNSETTLED, LARGEST_END * (last - first))
        kept[run] = (time[run] > first + edge) & (time[run] < last - edge)
    settled = np.arange(len(kept))[part][kept[part]]
    chosen = Part(log, settled)
    return chosen if len(chosen.indices) >= LEAST_HELD_OUT else Part(log, part)
