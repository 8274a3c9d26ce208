"""Channels at times of their own, interpolated at common times; times of a log, with gaps and jitter.

At common times a channel is interpolated linearly, which is wrong between distant samples. Only the trajectory estimate
takes samples at their own times.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ident.errors import LogError
from ident.files.table import BASE, EPOCH, FAR, TIME, Columns, Table
from ident.geometry.se3 import pose
from ident.mechanism.body import is_rigid
from ident.recordings.stated import TRACKED
from ident.tolerances import LEAST_SAMPLES

GAP = 1.5
"""Multiple of the median time step above which a step is a gap."""

AS_MEASURED = "The trajectory estimate does without them; all else sees straight lines between the samples there are."
"""Note on missing samples."""


STREAMS = "a mapping of pairs of times and values"
"""Description of streams, for messages."""


class Sampled(NamedTuple):
    """Samples of a channel at times of its own.

    Attributes:
        time: Sample times, s (N,).
        values: Samples, NaN where one is missing (N,) or (N, d).
    """

    time: np.ndarray
    values: np.ndarray

    @property
    def columns(self) -> np.ndarray:
        """Samples by component (N, d)."""
        return self.values.reshape(len(self.time), -1)


def checked_channel(name: str, values: Iterable[float], samples: int | None) -> np.ndarray:
    """The channel as a read-only array, checked: columns finite or NaN throughout, `samples` long (None: any length).

    Raises:
        LogError: It is no such channel.
    """
    x = _copied(values)
    dimensions = (1,) if samples is None else (1, 2)
    if x.ndim not in dimensions or samples not in (None, len(x)) or x.size == 0:
        raise LogError(
            f"Channel '{name}' needs {samples or 'N > 0'} samples along its first axis, got shape {x.shape}."
        )
    finite = np.isfinite(x)
    if not finite.all() and not (finite | np.isnan(x).all(axis=0)).all():
        bad = tuple(np.argwhere(~finite)[0])
        raise LogError(f"Channel '{name}' needs finite numbers; sample {bad[0]} is {x[bad]}.")
    x.flags.writeable = False
    return x


def check_times(what: str, time: np.ndarray) -> None:
    """Refuses times that are not finite or do not increase."""
    if not np.isfinite(time).all():
        raise LogError(f"{what} need finite numbers.")
    if not (later := np.diff(time) > 0).all():
        raise LogError(f"{what} must increase; sample {int(np.argmin(later)) + 1} does not.")


def checked_stream(name: str, stream: tuple[Iterable[float], Iterable[float]]) -> Sampled:
    """The stream as read-only arrays, checked to have increasing times.

    Raises:
        LogError: They are not a pair of times (N,) and values (N,) or (N, d), finite or missing.
    """
    try:
        time, values = map(_copied, stream)
    except (TypeError, ValueError):
        raise LogError(f"The stream '{name}' needs a pair of times and values, both of numbers.") from None
    if time.ndim != 1 or values.ndim not in (1, 2) or len(time) != len(values) or values.size == 0:
        raise LogError(
            f"The stream '{name}' needs times (N,) and values (N,) or (N, d), got {time.shape} and {values.shape}."
        )
    check_times(f"The times of the stream '{name}'", time)
    if np.isinf(values).any():
        raise LogError(f"The stream '{name}' needs numbers, NaN for a missing one; got an infinite one.")
    time.flags.writeable = values.flags.writeable = False
    return Sampled(time, values)


def _copied(values: Iterable[float]) -> np.ndarray:
    """Numbers as a new array; an array that another recording has checked and frozen is not copied."""
    frozen = isinstance(values, np.ndarray) and values.flags.owndata and not values.flags.writeable
    return np.asarray(values, float) if frozen else np.array(values, float)


def uniform_times(streams: Mapping[str, Sampled], rate: float | None = None) -> np.ndarray:
    """Uniform times over the span that all streams cover, s.

    Args:
        streams: Streams by channel; columns without any sample are ignored.
        rate: Samples per second, by default the fastest joint position's, or that of a moving base.

    Raises:
        LogError: The rate is unknown, or there is no time that all streams cover.
    """
    if rate is None:
        rates = {k: rate_of(x) for k, x in streams.items() if len(x.time) > 1}
        joints = [rates[k] for k in rates if k.endswith("_position") and streams[k].values.ndim == 1]
        if not joints and BASE not in rates:
            raise LogError("Streams without joint positions need a rate for the times that they have in common.")
        rate = max(joints, default=rates.get(BASE, 0.0))
    if not 0 < rate < np.inf:
        raise LogError(f"Streams need a positive rate in Hz for the times that they have in common, got {rate}.")
    if not (spans := {k: span for k, x in streams.items() if (span := covered(x)) is not None}):
        raise LogError("Streams need samples, there is none.")
    latest, soonest = max(spans, key=lambda k: spans[k][0]), min(spans, key=lambda k: spans[k][1])
    start, end = spans[latest][0], spans[soonest][1]
    samples = int(np.floor((end - start) * rate * (1 + 1e-12) + 1e-9)) + 1
    if samples < 2:
        raise LogError(
            f"Streams need a time that all of them cover; '{latest}' begins at {start:g} s and '{soonest}' ends at "
            f"{end:g} s."
        )
    return np.minimum(start + np.arange(samples) / rate, end)


def rate_of(stream: Sampled) -> float:
    """Rate of a stream of at least two samples, from the mean of the steps that are no gaps, Hz."""
    steps = np.diff(stream.time)
    return float(1 / steps[steps <= GAP * np.median(steps)].mean())


def covered(stream: Sampled) -> tuple[float, float] | None:
    """First and last time that all measured components cover; None if none is measured."""
    there = np.isfinite(stream.columns)
    there = there[:, there.any(axis=0)]
    if not there.size:
        return None
    return float(stream.time[there.argmax(axis=0).max()]), float(stream.time[::-1][there[::-1].argmax(axis=0).max()])


def interpolated(stream: Sampled, time: np.ndarray) -> np.ndarray:
    """Linear interpolation, also over missing samples; columns without samples stay NaN (M,) or (M, d)."""
    out = np.full((len(time), stream.columns.shape[1]), np.nan)
    for k, column in enumerate(stream.columns.T):
        there = np.isfinite(column)
        if there.any():
            out[:, k] = np.interp(time, stream.time[there], column[there])
    return out.reshape(len(time), *stream.values.shape[1:])


def interpolated_poses(stream: Sampled, time: np.ndarray) -> np.ndarray:
    """Poses (M, 4, 4) interpolated between those of a stream (N, 16), rotations at a constant rate.

    Raises:
        LogError: They are no poses.
    """
    there = np.isfinite(stream.columns).all(axis=1)
    if stream.columns.shape[1] != 16 or there.sum() < 2 or not is_rigid(stream.columns[there].reshape(-1, 4, 4)):
        raise LogError(f"The stream '{BASE}' needs rigid poses (N, 16), row by row, got shape {stream.values.shape}.")
    poses, own = stream.columns[there].reshape(-1, 4, 4), stream.time[there]
    turned = Slerp(own, Rotation.from_matrix(poses[:, :3, :3]))(np.clip(time, own[0], own[-1]))
    return pose(turned.as_matrix(), interpolated(Sampled(own, poses[:, :3, 3]), time))


def between_samples(stream: Sampled, time: np.ndarray, reach: float) -> np.ndarray:
    """Mask of times at complete samples, or between two that are at most `reach` seconds apart (M,)."""
    own = stream.time[np.isfinite(stream.columns).all(axis=1)]
    if not len(own):
        return np.zeros(len(time), bool)
    before = own[np.maximum(np.searchsorted(own, time, side="right") - 1, 0)]
    after = own[np.minimum(np.searchsorted(own, time), len(own) - 1)]
    return (before <= time) & (time <= after) & (after - before <= reach)


def side_by_side(streams: Iterable[Sampled]) -> Sampled:
    """Streams joined at the times of all of them, NaN where one has no sample (N, d)."""
    streams = list(streams)
    time = streams[0].time
    if all(np.array_equal(stream.time, time) for stream in streams):
        return Sampled(time, np.hstack([stream.columns for stream in streams]))
    time = np.unique(np.concatenate([stream.time for stream in streams]))
    values = []
    for stream in streams:
        values.append(np.full((len(time), stream.columns.shape[1]), np.nan))
        values[-1][np.searchsorted(time, stream.time)] = stream.columns
    return Sampled(time, np.hstack(values))


JITTER, UNIFORM = 0.2, 1e-3
"""Relative deviation of time steps from their median above which a clock is doubtful, and up to which it is uniform."""

SPARSE = 1000
"""Number of common times per sample above which a gap is an error of the clock."""

POSES = " If each row is a pose at rest, say poses = true in the columns file."
"""Advice for logs that look like poses, not like motions."""

SLOW = 1.0
"""Time between samples from which they may be poses at rest, s."""


class Repaired(NamedTuple):
    """A log at uniform times.

    Attributes:
        time: Sample times, s (N,).
        channels: Channels by key of the mapping; complete, or NaN in columns that are missing (N, k).
        streams: Channels as they were measured, for those where this differs.
    """

    time: np.ndarray
    channels: dict[str, np.ndarray]
    streams: dict[str, Sampled]


@dataclass
class Clock:
    """The times of a log.

    Attributes:
        column: Its column of times.
        gaps: True if samples may be missing.
        start: Time of the first sample in the recording, s.
        step: Median step, s.
    """

    column: Columns
    gaps: bool = False
    start: float = 0.0
    step: float = 0.0

    def repaired(self, table: Table, channels: dict[str, np.ndarray], notes: list[str]) -> Repaired:
        """The samples of a log at uniform times.

        Args:
            table: The file.
            channels: Channels at its times, by name (N, k).
            notes: Sentences on what was repaired; more are appended.

        Raises:
            LogError: The times go back, or have a gap or repeat one with other values where samples may not be missing.
        """
        (name,) = self.column.names
        raw = table.column(name, FAR)
        if np.isnan(raw).any():
            raise LogError(f"column '{name}' is empty, but a log needs times.")
        zero = float(raw[0])
        time = (raw - zero) * self.column.factor
        kept = increasing(table, name, time, channels, notes, gaps=self.gaps)
        time, channels = time[kept], {key: x[kept] for key, x in channels.items()}
        self._begin(zero, time, notes)
        self._check_gaps(table, time, kept, notes)
        check_jumps(f"column '{name}'", time, self.step)
        grid = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / self.step) + 1)
        uniform = len(grid) == len(time) and np.abs(time - grid).max() <= UNIFORM * self.step
        if not uniform:
            notes += self._jitter(table, time, kept)
        own = grid if uniform else time
        streams = {key: Sampled(own, x) for key, x in channels.items() if not uniform or _has_gaps(x)}
        grid = _covered(grid, _limiting(streams))
        channels = {key: interpolated(Sampled(own, x), grid) for key, x in channels.items()} if streams else channels
        streams = {key: Sampled(self.start + own, x.values) for key, x in streams.items()}
        return Repaired(self.start + grid, channels, streams)

    def _check_gaps(self, table: Table, time: np.ndarray, kept: np.ndarray, notes: list[str]) -> None:
        """Refuses gaps, or notes them if samples may be missing."""
        (name,), steps = self.column.names, np.diff(time)
        if not (number := int(self._are_gaps(steps).sum())):
            return
        longest, i = f"{steps.max():g} s", int(steps.argmax())
        after = table.row(kept[i + 1])
        if self.gaps:
            notes.append(
                f"Times in column '{name}' have gaps: {number}, the longest of {longest} before {after}. {AS_MEASURED}"
            )
            return
        others = f"; it is the longest of {number} gaps" if number > 1 else ""
        start, end = self.start + time[i : i + 2]
        raise LogError(
            f"{after}, column '{name}' has a gap of {longest}, from {start:g} s to {end:g} s, where steps are "
            f"{self.step:g} s{others}. A filter would invent what is missing: cut the log there, or say that samples "
            "may be missing (--gaps, gaps=True in Python), for the trajectory estimate."
            f"{POSES if self.step >= SLOW else ''}"
        )

    def _are_gaps(self, steps: np.ndarray) -> np.ndarray:
        return steps > GAP * self.step * (1 + 1e-6)

    def _jitter(self, table: Table, time: np.ndarray, kept: np.ndarray) -> list[str]:
        """Notes on the jitter of steps that are no gaps."""
        (name,) = self.column.names
        steps = np.diff(time)
        departure = np.where(self._are_gaps(steps), 0.0, np.abs(steps / self.step - 1))
        i = int(departure.argmax())
        if self.gaps and departure[i] <= UNIFORM:
            return []
        much = int((departure > JITTER).sum())
        return [
            f"Times in column '{name}' jitter: steps depart from {self.step:g} s by up to {100 * departure[i]:.2g} % "
            f"({table.row(kept[i + 1])}); all channels were resampled linearly at {1 / self.step:.6g} Hz."
            + (f" {much} steps depart by more than {100 * JITTER:g} %: doubt the clock." if much else "")
        ]

    def _begin(self, zero: float, time: np.ndarray, notes: list[str]) -> None:
        """Sets start and step."""
        (name,) = self.column.names
        check_samples(len(time), " at different times")
        self.start, self.step = zero * self.column.factor, float(np.median(np.diff(time)))
        if abs(self.start) > EPOCH:
            notes.append(f"Times start at {self.start:.10g} s; they are counted from there.")
            self.start = 0.0
        if self.step < 1e-6 or (self.step >= SLOW and not self.column.unit):
            raise LogError(
                f"column '{name}' has steps of {self.step:g} s, which suggests that its unit is not the second; map "
                f'it, as in time = {{ column = "{name}", unit = "ms" }}.{POSES if self.step >= SLOW else ""}'
            )


def check_samples(number: int, which: str = "") -> None:
    """Refuses fewer samples than a log needs, perhaps of some of them."""
    if number < LEAST_SAMPLES:
        raise LogError(f"a log needs at least {LEAST_SAMPLES} samples{which}, it has {number}.")


def check_jumps(what: str, time: np.ndarray, step: float) -> None:
    """Refuses times so far apart that nearly all common times would be in a gap, as after one wrong time stamp.

    Args:
        what: Name of the times, for the message.
        time: Sample times, s (N,).
        step: Step of the common times, s.

    Raises:
        LogError: They are too far apart.
    """
    if time[-1] - time[0] > SPARSE * len(time) * step:
        i = int(np.diff(time).argmax())
        raise LogError(
            f"{what} jumps from {time[i]:.10g} s to {time[i + 1]:.10g} s where {len(time)} samples have steps of "
            f"{step:g} s; take one side of it ([select] time, in the mapping)."
        )


def increasing(
    table: Table, name: str, time: np.ndarray, channels: dict[str, np.ndarray], notes: list[str], *, gaps: bool
) -> np.ndarray:
    """Indices of the samples, without those that repeat the one before; with gaps, without all that repeat its time."""
    steps = np.diff(time)
    if (steps < 0).any():
        raise LogError(going_back(table, name, time))
    repeated = np.append(False, steps == 0)
    same = [
        all(np.array_equal(x[i], x[i - 1], equal_nan=True) for x in channels.values()) for i in np.flatnonzero(repeated)
    ]
    if not all(same) and not gaps:
        i = int(np.flatnonzero(repeated)[same.index(False)])
        raise LogError(
            f"{table.row(i)}, column '{name}' repeats the time of the sample before, but not its values; which of them "
            "holds is not known. Where samples may be missing (--gaps, gaps=True in Python), the first counts."
        )
    if repeated.any():
        first = table.row(int(repeated.argmax()))
        what = "Samples that repeat the one before" if all(same) else "Samples at the time of the one before"
        notes.append(f"{what} were dropped: {int(repeated.sum())}, the first is {first}.")
    return np.flatnonzero(~repeated)


def going_back(table: Table, name: str, time: np.ndarray, unit: str = "s") -> str:
    """Sentence on times that go back (N,), and what to do: to sort single rows that are late, to part two motions."""
    first, *more = (np.flatnonzero(np.diff(time) < 0) + 1).tolist()
    step = f"{time[first - 1] - time[first]:g} {unit}".rstrip()
    back = f"{table.row(first)}, column '{name}' goes back in time by {step}"
    late = time < np.fmax.accumulate(time)
    if not (late[1:] & late[:-1]).any():
        return f"{back}; sort the log."
    rows, end = table.rows, [*more, len(time)][0]
    spans = f"[{rows[0]}, {rows[first - 1]}] or [{rows[first]}, {rows[end - 1]}]"
    return (
        f"{back} and goes on from there: a clock was reset, or another motion begins, and sorting would interleave "
        f"both. Make logs of the parts, or take one by [select] rows = {spans} in the columns file."
    )


def _has_gaps(x: np.ndarray) -> bool:
    """True if a column lacks some samples, but not all."""
    missing = np.isnan(x)
    return bool((missing.any(axis=0) & ~missing.all(axis=0)).any())


def _covered(grid: np.ndarray, streams: dict[str, Sampled]) -> np.ndarray:
    """The times that all streams cover."""
    if not any(_has_gaps(stream.values) for stream in streams.values()):
        return grid
    first, last = zip(*(span for stream in streams.values() if (span := covered(stream)) is not None), strict=True)
    inside = grid[(grid >= max(first)) & (grid <= min(last))]
    check_samples(len(inside), " that all columns cover")
    return inside


def streams_of(
    table: Table, clock: Columns, channels: dict[str, np.ndarray], notes: list[str], *, gaps: bool | None
) -> dict[str, Sampled]:
    """Channels (N, k) at the times of a table, without repeated samples; `gaps` is None where the format allows any."""
    if gaps is not None:
        # Time steps are checked as in a log with one clock.
        repaired = Clock(clock, gaps).repaired(table, channels, notes)
        return {key: repaired.streams.get(key, Sampled(repaired.time, x)) for key, x in repaired.channels.items()}
    time = table.column(TIME)
    kept = increasing(table, TIME, time, channels, notes, gaps=True)
    if len(kept) < LEAST_SAMPLES:
        raise LogError(f"a log needs at least {LEAST_SAMPLES} samples, {', '.join(channels)} have {len(kept)}.")
    return {key: Sampled(time[kept], x[kept]) for key, x in channels.items()}


def _limiting(streams: Mapping[str, Sampled]) -> dict[str, Sampled]:
    """Streams that limit the common times: all but tracked poses."""
    return {key: stream for key, stream in streams.items() if not key.startswith(TRACKED)}


def together(streams: dict[str, Sampled]) -> Repaired:
    """Streams as measured and at common times, at the rate of the fastest joint position, or of any without joints.

    Raises:
        LogError: Times are too far apart, or too few are covered by all.
    """
    joints = [key for key in streams if key.endswith(".position") and key.startswith("joints.")]
    rate = max(map(rate_of, (streams[key] for key in joints or streams)))
    for key, stream in streams.items():
        check_jumps(f"the time of {key}", stream.time, 1 / rate)
    common = uniform_times(_limiting(streams), rate)
    check_samples(len(common), " that all columns cover")
    return Repaired(common, {key: interpolated(stream, common) for key, stream in streams.items()}, streams)
