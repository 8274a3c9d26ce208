"""Faults in a log: gaps, limits at which sensors clip, outliers, whole turns where a range ends, wrong units."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.table import Table, short
from ident.mechanism.mechanism import Mechanism
from ident.recordings.mapping import ColumnMapping
from ident.recordings.recording import Recording
from ident.recordings.smoothing import UNIFORM, quantum, white_noise
from ident.recordings.stated import Servo, model_servo
from ident.recordings.times import Sampled, between_samples
from ident.recordings.wrench import GROUND
from ident.tolerances import KILONEWTONS, NORMAL_MAD, ROUNDING, TURNS

AT_ONCE = 1_000_000
"""Numbers of all windows that are in memory at the same time."""

INTERPOLATED = 0.05
"""Longest time between samples that is no gap, s: over it a motion of a few hertz is linear to some per cent of its
size. In a stream with a lower rate one missing sample is no gap."""

SHARE, FEWEST = 0.005, 5
"""Least share and least number of samples at an extreme value for it to be a limit."""

LASTS = 3
"""Least length of the longest run of such samples: with rounded values single ones occur by chance."""

CROWDED = 4.0
"""Least ratio of the samples at an extreme value to those at any of the `NEXT` adjacent values. At the peak of a
rounded sinusoid the ratio is up to 2.4, 1 over √2 - 1."""

NEXT = 3
"""Number of values adjacent to the extreme one that are compared."""

LEVELS = 10
"""Least number of distinct other values: a channel that switches between few levels is not clipped."""

STILL, BY_NOISE = 0.003, 6.0
"""A coordinate moves during a run at a limit if it changes by more than this share of its range plus this many standard
deviations of its noise. During a rest sensors repeat a value without being clipped."""

WINDOW = 11
"""Samples of the running median."""

GROSS = 8.0
"""Multiple of the typical deviation from the running median beyond which a sample is an outlier, if it also exceeds
the channel's own spread."""

ISOLATED = 2
"""Longest run of samples that counts as an outlier; an impact lasts longer."""


def runs(samples: np.ndarray) -> np.ndarray:
    """First samples and ends of the runs of true samples in a mask (N,), in order (k, 2)."""
    edges = np.diff(np.concatenate([[False], samples, [False]]).astype(np.int8))
    return np.stack([np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)], axis=1)


def running_median(x: np.ndarray, width: int, at: np.ndarray | None = None) -> np.ndarray:
    """Medians of the windows around samples (N,), or around those `at` indices (n,), beyond the ends of the end values.

    Args:
        x: Samples (N,).
        width: Samples of a window; one of even width begins a sample earlier, and gives the larger middle value.
        at: Indices of the windows' samples; by default all.
    """
    middle = width // 2
    windows = sliding_window_view(np.pad(x, (middle, width - middle - 1), mode="edge"), width)
    wanted = np.arange(len(x)) if at is None else at
    out = np.empty(len(wanted))
    step = max(1, AT_ONCE // width)
    for first in range(0, len(wanted), step):
        part = slice(first, first + step)
        out[part] = np.partition(windows[wanted[part]], middle, axis=1)[:, middle]
    return out


def longest_step(stream: Sampled) -> float:
    """Longest time between samples of a stream that is no gap, s."""
    return max(INTERPOLATED, 2 * float(np.median(np.diff(stream.time)))) if len(stream.time) > 1 else INTERPOLATED


def covered(recording: Recording, channels: Iterable[str]) -> np.ndarray:
    """Mask of the common times that lie in no gap of any of the channels (N,)."""
    inside = np.ones(len(recording.time), bool)
    for name in (name for name in channels if name in recording.streams):
        stream = recording.streams[name]
        there = np.isfinite(stream.columns)
        measured = Sampled(stream.time, stream.columns[:, there.any(axis=0)])
        if measured.values.size:
            inside &= between_samples(measured, recording.time, longest_step(measured))
    return inside


def stretches(time: np.ndarray, inside: np.ndarray) -> list[slice]:
    """Slices of consecutive samples without a gap.

    Args:
        time: Common times, s (N,).
        inside: Mask of the times that lie in no gap (N,).
    """
    at = np.flatnonzero(inside)
    if not len(at):
        return []
    far = np.diff(time[at]) > longest_step(Sampled(time, time))
    breaks = np.flatnonzero(far | (np.diff(at) > 1)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(at, breaks)]


class Limit(NamedTuple):
    """A value beyond which a signal does not go.

    Attributes:
        value: The value.
        samples: Mask of the samples at it (N,).
    """

    value: float
    samples: np.ndarray


def limits(x: np.ndarray) -> list[Limit]:
    """Limits at which a signal is clipped: its smallest value, its largest, both or none.

    Zero is no limit: an unloaded force plate reads it. A signal may also rest at an extreme value; `moves` tells the
    two apart by the motion.

    Args:
        x: Samples, NaN where one is missing (N,).
    """
    if not np.nanmax(x, initial=-np.inf) > np.nanmin(x, initial=np.inf):
        return []
    ends = (_limit(x, float(np.nanmin(x))), _limit(x, float(np.nanmax(x))))
    return [each for each in ends if each is not None]


def _limit(x: np.ndarray, extreme: float) -> Limit | None:
    """The extreme value as a limit, None if it is none."""
    same = ROUNDING * np.nanmax(np.abs(x - extreme))
    samples = np.abs(x - extreme) <= same
    count = int(samples.sum())
    if extreme == 0 or count < max(FEWEST, SHARE * len(x)) or _longest(samples) < LASTS:
        return None
    others = np.round(np.abs(x - extreme)[np.isfinite(x) & ~samples] / same)
    _, beside = np.unique(others, return_counts=True)
    alone = len(beside) >= LEVELS and count > CROWDED * beside[:NEXT].max()
    return Limit(extreme, samples) if alone else None


def _longest(samples: np.ndarray) -> int:
    """Length of the longest run of true samples in a mask (N,)."""
    return int(np.diff(runs(samples)).max(initial=0))


def moves(samples: np.ndarray, q: np.ndarray) -> bool:
    """True if the mechanism moves while a signal is at a limit; otherwise the signal rests there.

    Args:
        samples: Mask of the samples at the limit (N,).
        q: Joint coordinates (N, n).
    """
    spans = [slice(first, end) for first, end in runs(samples) if end - first >= LASTS]
    enough = STILL * np.ptp(q, axis=0) + BY_NOISE * np.array([white_noise(x) for x in q.T])
    crossed = [(np.ptp(q[span], axis=0) > enough).any() for span in spans]
    # The mechanism has to move in most of the runs.
    return bool(np.mean(crossed or [0.0]) > 1 / 2)


def despiked(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Channels with their isolated gross outliers interpolated (Hampel's filter).

    A step of the resolution is no outlier, not even in a channel that is constant for a while.

    Args:
        x: Channels (N, C); those with NaN stay as they are.

    Returns:
        The channels (N, C), and the number of samples replaced in each (C,).
    """
    out, counts = np.array(x, float), np.zeros(x.shape[1], int)
    for c in np.flatnonzero(np.isfinite(out).all(axis=0)):
        bad = _gross(out[:, c])
        for first, end in runs(bad):
            bad[first:end] = end - first <= ISOLATED
        counts[c] = bad.sum()
        if bad.any() and not bad.all():
            out[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), out[~bad, c])
    return out, counts


def _gross(x: np.ndarray) -> np.ndarray:
    """Mask of the samples of a channel that are far from the running median (N,)."""
    deviation = np.abs(x - running_median(x, WINDOW))
    usual = max(np.median(deviation), UNIFORM * quantum(x))
    least = NORMAL_MAD * max(GROSS * usual, np.median(np.abs(x - np.median(x))))
    # The typical deviation around a sample matters for few of them, and takes most of the time.
    out = deviation > least
    far = np.flatnonzero(out)
    out[far] = deviation[far] > NORMAL_MAD * GROSS * running_median(deviation, 5 * WINDOW, far)
    return out


RANGE = 1.01
"""Largest range of a wrapped angle in turns; the rest is noise at its ends."""

FAST, CLOSE = 0.25, 0.05
"""Largest step beside a jump, and largest difference of a jump without its turn from the steps beside it, in turns. A
joint that goes through less than a quarter of a turn in a sample can be followed; no joint goes through nine tenths of
a turn in one sample and rests before and after it."""

FAR_APART = 20.0
"""Range of commands over that of the positions from which their units differ."""


def turns_of(columns: Columns) -> dict[str, tuple[float, ...]]:
    """Numbers that may be a whole turn, by the columns that make an angle.

    The unit of a column in a sum is not known: besides the angle's own, its encoder may turn before a gear.
    """
    if not columns.sums:
        return dict.fromkeys(columns.read, (2 * np.pi / columns.factor,))
    terms = [pair for each in columns.sums for pair in zip(each.columns, each.weights, strict=True)]
    return {name: (2 * np.pi / abs(weight * columns.factor), 2 * np.pi, 360.0) for name, weight in terms}


def unwrapped(x: np.ndarray, turns: Sequence[float]) -> tuple[np.ndarray, int]:
    """A column without jumps by a whole turn, and their number; it is unchanged if there are none.

    A jump counts if, without a whole turn, it is like the steps before and after it.

    Args:
        x: The column, NaN where samples are missing (N,).
        turns: Numbers that may be a whole turn; the first with such jumps is taken.
    """
    there = np.flatnonzero(np.isfinite(x))
    steps = np.diff(x[there])
    if len(steps) < 3:
        return x, 0
    low, high = np.percentile(x[there], (1, 99))
    for turn in turns:
        wraps = np.where(np.abs(steps) > turn / 2, np.sign(steps), 0)
        if not wraps.any() or high - low > RANGE * turn:
            continue
        rest = (steps - turn * wraps) / turn
        beside = (np.append(rest[1], rest[:-1]) + np.append(rest[1:], rest[-2])) / 2
        wraps[(np.abs(rest - beside) > CLOSE) | (np.abs(beside) > FAST)] = 0
        if wraps.any():
            out = x.copy()
            out[there[1:]] -= turn * np.cumsum(wraps)
            return out, int(np.count_nonzero(wraps))
    return x, 0


def with_continuous_angles(table: Table, turns: Mapping[str, Sequence[float]], notes: list[str]) -> Table:
    """The table with wrapped columns unwrapped, each piece from where the one before ended.

    Args:
        table: The file, or a piece of it that begins with the last sample of the piece before.
        turns: Numbers that may be a whole turn, by column, as from `turns_of`.
        notes: Sentences on what was detected; more are appended.
    """
    cells, ends = dict(table.cells), table.memory.turned
    for name in (name for name in turns if name in table.cells):
        # What cannot be read is refused where it is used.
        with suppress(LogError):
            x = table.column(name, gaps=True)
            out, number = unwrapped(x, turns[name])
            if number:
                notes.append(
                    f"Column '{short(name)}' jumps by a whole turn {number} times, as an angle does where its range "
                    "ends; it was made continuous."
                )
            if number or ends.get(name):
                cells[name] = out + ends.get(name, 0.0)
                gone = (cells[name] - x)[np.isfinite(x)]
                ends[name] = float(gone[-1]) if len(gone) else ends[name]
    return replace(table, cells=cells)


def check_angles(recording: Recording, mapping: ColumnMapping, hinges: Sequence[str]) -> None:
    """Refuses positions of hinges that look like degrees, unless their unit is stated."""
    for joint in hinges:
        columns, extent = mapping.columns[f"joints.{joint}.position"], float(np.ptp(recording[f"{joint}_position"]))
        if extent > TURNS and not columns.unit:
            raise LogError(
                f"column '{columns.names[0]}', the position of joint '{joint}', ranges over {extent:.3g} rad, which "
                f'looks like degrees; map it, as in position = {{ column = "{columns.names[0]}", unit = "deg" }} '
                f'under [joints.{joint}], or state its unit "rad".'
            )


def check_rates(recording: Recording, hinges: Sequence[str]) -> None:
    """Refuses rates of hinges in degrees whose integrals are in radians, or the reverse."""
    for joint, (kind, rate) in product(hinges, (("position", "velocity"), ("velocity", "acceleration"))):
        x, dx = (recording.measured.get(f"{joint}_{quantity}") for quantity in (kind, rate))
        if x is None or dx is None:
            continue
        factor = rate_factor(recording.time, x, dx)
        if any(0.8 < abs(factor) / suspected < 1.25 for suspected in (180 / np.pi, np.pi / 180)):
            raise LogError(
                f"the {rate} of joint '{joint}' is {factor:.3g} times the derivative of its {kind}, so one of them is "
                f"in degrees; map it with its unit under [joints.{joint}]."
            )


def rate_factor(time: np.ndarray, x: np.ndarray, dx: np.ndarray) -> float:
    """Factor of dx to the derivative of x; 0 if the two are hardly correlated."""
    return float(rate_factors(time, x[:, None], dx[:, None])[0, 0])


def rate_factors(time: np.ndarray, x: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Factors of columns (N, l) to the derivatives of others (N, k); 0 if two are hardly correlated (k, l)."""
    m = max(1, len(time) // 100)
    # Differences and integrals over many samples have less noise than derivatives.
    integral = np.insert(np.cumsum((dx[1:] + dx[:-1]) / 2 * np.diff(time)[:, None], axis=0), 0, 0.0, axis=0)
    a, b = x[m:] - x[:-m], integral[m:] - integral[:-m]
    power, common = (a * a).sum(axis=0)[:, None], a.T @ b
    least = 0.81 * power * (b * b).sum(axis=0)
    alike = (common**2 > least) & (least > 1e-30)
    return np.where(alike, common, 0.0) / np.where(alike, power, 1.0)


def unit_of_force(recording: Recording, mapping: ColumnMapping, mechanism: Mechanism) -> list[str]:
    """A note if the ground's force is so far below the mechanism's weight that its unit may be kilonewtons."""
    force = recording.measured.get(f"{GROUND}_force")
    if force is None or recording.base is not None or mechanism.prior is None:
        return []
    force = force[:, ~np.isnan(force[0])]
    largest = float(np.linalg.norm(force, axis=1).max())
    stated = mapping.columns[f"wrenches.{GROUND}.force"].unit
    if not force.shape[1] or largest >= mechanism.weight / KILONEWTONS or stated:
        return []
    return [
        f"The ground's force is at most {largest:.3g} N where the mechanism weighs {mechanism.weight:.4g} N: its unit "
        f'may be kN; map it, with unit = "kN" under [wrenches.{GROUND}].'
    ]


def with_servos(recording: Recording, servos: Mapping[str, Servo], mechanism: Mechanism, notes: list[str]) -> Recording:
    """Recording with the servos of its commanded joints, and without commands that give no torque.

    Args:
        recording: The recording, with channels `JOINT_command`.
        servos: Servos that the log's mapping states, by joint; others are those of the model's position actuators.
        mechanism: The mechanism.
        notes: Sentences on what was detected; more are appended.

    Raises:
        LogError: Commands and positions are in different units, or nothing but commands without gains is measured.
    """
    commanded = [joint for joint in mechanism.tree.joints if f"{joint}_command" in recording.measured]
    used, unused = dict[str, Servo](), list[str]()
    for joint in commanded:
        servo = servos.get(joint) or model_servo(mechanism, joint)
        if servo is None or f"{joint}_torque" in recording.measured:
            unused.append(joint)
        else:
            _check_unit_of_command(recording, joint)
            used[joint] = servo
    if without := [joint for joint in unused if f"{joint}_torque" not in recording.measured]:
        note = (
            f"Commands of {', '.join(without)} are not used: the model has no position actuator with a gear of 1 for "
            "them, and no kp is stated under [joints.NAME]."
        )
        if not (used or recording.wrenches or recording.torques(mechanism.tree.joints) is not None):
            raise LogError(f"nothing is left to fit. {note}")
        notes.append(note)
    recording = recording.without([f"{joint}_command" for joint in unused])
    measured, streams = dict(recording.measured), dict(recording.streams)
    for body in (body for body in mechanism.tree.bodies if body.joint in used and body.turns):
        command = f"{body.joint}_command"
        # A command that is unwrapped may be whole turns away from its position.
        turns = 2 * np.pi * np.round(np.median(measured[command] - measured[f"{body.joint}_position"]) / (2 * np.pi))
        measured[command] = measured[command] - turns
        if command in streams:
            streams[command] = Sampled(streams[command].time, streams[command].values - turns)
    scales = {joint: std for joint, std in recording.scales.items() if joint not in without}
    return replace(recording, measured=measured, streams=streams, servos=used, scales=scales)


def _check_unit_of_command(recording: Recording, joint: str) -> None:
    command, position = recording[f"{joint}_command"], recording[f"{joint}_position"]
    size, usual = (float(np.abs(x).max()) for x in (command, position))
    if size > FAR_APART * usual > 0 and np.ptp(command) > FAR_APART * np.ptp(position):
        raise LogError(
            f"the commands of joint '{joint}' reach {size:.3g}, its positions {usual:.3g}; both need one unit: map the "
            f'command with its own, as in command = {{ column = ..., unit = "deg" }} under [joints.{joint}].'
        )
