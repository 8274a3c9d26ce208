"""Channels as they were measured, each at its own times, with rates, jitter and gaps, and interpolated at common times.

At common times a channel is interpolated linearly, which is wrong between distant samples. Only the trajectory estimate
takes samples at their own times.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ident.arguments import check_type
from ident.errors import LogError
from ident.files.table import BASE
from ident.mechanism.body import is_rigid

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


def at_common_times(streams: Mapping[str, tuple[Any, Any]], rate: float | None = None) -> dict[str, Any]:
    """Fields of a recording made of streams, by name.

    Args:
        streams: Times and values by channel; `rate` as for `uniform_times`.
    """
    check_type("streams", streams, Mapping, STREAMS)
    checked = {name: checked_stream(name, stream) for name, stream in streams.items()}
    time = uniform_times(checked, rate)
    measured = {name: interpolated(stream, time) for name, stream in checked.items() if name != BASE}
    base = interpolated_poses(checked[BASE], time) if BASE in checked else None
    return {"time": time, "measured": measured, "base": base, "streams": checked}


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
    spans = {k: span for k, x in streams.items() if (span := covered(x)) is not None}
    if not spans:
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
    out = np.tile(np.eye(4), (len(time), 1, 1))
    out[:, :3, :3] = Slerp(own, Rotation.from_matrix(poses[:, :3, :3]))(np.clip(time, own[0], own[-1])).as_matrix()
    out[:, :3, 3] = interpolated(Sampled(own, poses[:, :3, 3]), time)
    return out


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
