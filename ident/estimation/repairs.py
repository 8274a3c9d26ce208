"""Repairs of a recording before a fit: clipped samples, outliers and constant channels; and coordinates at rest."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.errors import LogError
from ident.estimation.equations import COMPONENTS
from ident.files.table import KINDS
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from ident.recordings.smoothing import at_rest, despiked, limits, moves, quantum
from ident.recordings.times import Sampled
from ident.recordings.wrench import GROUND
from ident.tolerances import HUGE, TINY

PHYSICAL = ("_position", "_velocity", "_acceleration", "_torque", "_command", "_force")
"""Ends of the names of channels that a fit may use."""

MOSTLY = 0.5
"""Share of clipped samples above which a whole channel is left out: the rest is one side of the signal only."""


class Clipped(NamedTuple):
    """Channel clipped at the limits of its sensor's range.

    Attributes:
        channel: Name of the channel; `contact Fx` for a contact's wrench.
        limits: Limits of the range.
        samples: Mask of the samples at common times that are at a limit (N,).
        kept: True if the other samples are used.
    """

    channel: str
    limits: tuple[float, ...]
    samples: np.ndarray
    kept: bool

    @property
    def share(self) -> float:
        """Share of the samples that are clipped."""
        return float(self.samples.mean())


class Stuck(NamedTuple):
    """Channel that is constant although the model predicts a change.

    Attributes:
        channel: Name of the channel.
        value: Its value.
        in_fitted: True if it is constant in the fitted samples only.
    """

    channel: str
    value: float
    in_fitted: bool


class Mended(NamedTuple):
    """Recording that a fit can use.

    Attributes:
        recording: The recording.
        steps: Resolution of recorded channels by name, where it can be detected; coordinates as `JOINT_position`.
        clipped: Channels clipped by a sensor's range.
        constant: Constant channels, which are left out, with their values.
        notes: Notes on what was left out and repaired.
    """

    recording: Recording
    steps: dict[str, float]
    clipped: tuple[Clipped, ...]
    constant: dict[str, float]
    notes: list[str]


def mended(recording: Recording, mechanism: Mechanism, leave_out: Collection[str]) -> Mended:
    """Recording without some channels, constant ones, clipped samples and gross outliers.

    Raises:
        LogError: A number is too large.
    """
    tree = mechanism.tree
    of_joints = [f"{joint}_{kind}" for joint in tree.joints for kind in ("torque", "command")]
    empty = [channel for channel in of_joints if np.isnan(recording.measured.get(channel, 0)).all()]
    recording = without_channels(_within_range(recording), tree, leave_out)
    recorded, clipped = _steps(recording, tree), tuple[Clipped, ...]()
    notes = [f"Left out, since they have no numbers: {', '.join(empty)}."] if empty else []
    if not recording.still:
        recording, clipped = _without_clipped(recording, mechanism)
        recording, of_spikes = _without_spikes(recording, mechanism.joints)
        notes += of_spikes
    constant = constants(recording, tree)
    notes += [f"Left out, as asked for: {', '.join(leave_out)}."] if leave_out else []
    return Mended(without_channels(recording, tree, constant), recorded, clipped, constant, notes)


def _within_range(recording: Recording) -> Recording:
    """Recording whose numbers below `TINY` are zero.

    Raises:
        LogError: A number of a joint, a wrench or a moving base is too large.
    """
    measured = {k: _in_range(k, x) if k.endswith(PHYSICAL) else x for k, x in recording.measured.items()}
    streams = {name: Sampled(time, _in_range(name, x)) for name, (time, x) in recording.streams.items()}
    if recording.base is not None:
        _in_range("the base's pose", recording.base)
    return replace(recording, measured=measured, streams=streams)


def _in_range(name: str, x: np.ndarray) -> np.ndarray:
    """Samples of a channel, of which none is too large, with zeros for numbers below `TINY`."""
    size = np.abs(x)
    if (size >= HUGE).any():
        at = int(np.unravel_index(np.nanargmax(size), x.shape)[0])
        raise LogError(f"channel '{name}' needs numbers below {HUGE:g}, sample {at} has {np.nanmax(size):.3g}.")
    return np.where(size < TINY, 0.0, x)


def _components(recording: Recording, tree: Tree) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yields channels of wrenches and torques with the names of their components."""
    for name in recording.wrenches:
        called = tuple(c if name == GROUND else f"{name} {c}" for c in COMPONENTS)
        yield from ((f"{name}_force", called[:3]), (f"{name}_torque", called[3:]))
    for body in tree.bodies:
        if f"{body.joint}_torque" in recording.measured:
            yield f"{body.joint}_torque", body.freedom_names


def _columns(recording: Recording, tree: Tree, read: Callable[[str], np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of the components of wrenches and torques by name, from a function that reads a channel."""
    every = _components(recording, tree)
    return {name: x for channel, names in every for name, x in zip(names, read(channel).T, strict=True)}


def _steps(recording: Recording, tree: Tree) -> dict[str, float]:
    """Resolution of recorded channels by name, and of coordinates as `JOINT_position`, where it can be detected."""
    columns = _columns(recording, tree, lambda channel: recording.as_measured(channel).columns)
    columns |= {name: recording.as_measured(name).columns[:, 0] for name in _positions(tree)}
    return {name: step for name, x in columns.items() if (step := quantum(x))}


def _positions(tree: Tree) -> list[str]:
    """Channels of the coordinates of hinges and slides."""
    return [f"{body.joint}_position" for body in tree.bodies if body.coordinates == 1]


def _without_clipped(recording: Recording, mechanism: Mechanism) -> tuple[Recording, tuple[Clipped, ...]]:
    """Recording with clipped samples of its streams set missing, and the clipped channels.

    At common times, where no sample can be missing, clipped values stay as read.
    """
    tree, q = mechanism.tree, recording.of_joints(mechanism.joints, "position")
    if recording.base is not None:
        q = np.hstack([q, recording.base.reshape(len(q), -1)])
    streams, clipped = dict(recording.streams), list[Clipped]()
    for channel, names in _components(recording, tree):
        time, values = recording.as_measured(channel)
        columns = values.reshape(len(time), -1).copy()
        for column, name in zip(columns.T, names, strict=True):
            ends = [end for end in limits(column) if moves(np.interp(recording.time, time, end.samples) > 0, q)]
            if ends:
                own = np.any([end.samples for end in ends], axis=0)
                at_common_times = np.interp(recording.time, time, own) > 0
                kept = not _optional(name, tree) or at_common_times.mean() <= MOSTLY
                clipped.append(Clipped(name, tuple(end.value for end in ends), at_common_times, kept))
                column[own] = np.nan
                streams[channel] = Sampled(time, columns.reshape(values.shape))
    useless = [each.channel for each in clipped if not each.kept]
    return without_channels(replace(recording, streams=streams), tree, useless), tuple(clipped)


def _optional(name: str, tree: Tree) -> bool:
    """True if a channel may be missing: a contact needs all its components."""
    return name in COMPONENTS or name in tree.freedoms


def without_channels(recording: Recording, tree: Tree, names: Collection[str]) -> Recording:
    """Recording without some of the ground's components and the joints' torques."""
    measured, streams = dict(recording.measured), dict(recording.streams)
    for channel, own in _components(recording, tree):
        out = [name in names for name in own]
        if any(out):
            values = recording[channel]
            measured[channel] = np.where(out, np.nan, values.reshape(len(values), -1)).reshape(values.shape)
            if channel in streams:
                time, x = streams[channel]
                streams[channel] = Sampled(time, np.where(out, np.nan, x.reshape(len(x), -1)).reshape(x.shape))
    return replace(recording, measured=measured, streams=streams)


def constants(recording: Recording, tree: Tree, part: slice = slice(None)) -> dict[str, float]:
    """Ground components and joint torques that are constant in a part, with their values.

    The estimated noise of such a channel would be zero, and its weight infinite.
    """
    columns = _columns(recording, tree, lambda channel: recording[channel].reshape(len(recording.time), -1)[part])
    return {name: float(x[0]) + 0.0 for name, x in columns.items() if _optional(name, tree) and np.ptp(x) == 0}


def rests(recording: Recording, tree: Tree, part: slice = slice(None)) -> dict[str, float]:
    """Positions of the hinges and slides at rest in a part of a recording, by default in all of it, by joint."""
    first, last = recording.time[part][[0, -1]]
    sampled = {name: recording.as_measured(name) for name in _positions(tree)}
    every = {name: x.columns[(x.time >= first) & (x.time <= last), 0] for name, x in sampled.items()}
    every = {name: x for name, x in every.items() if np.isfinite(x).any()}
    largest = max((float(np.nanmax(x) - np.nanmin(x)) for x in every.values()), default=0.0)
    return {
        name.removesuffix("_position"): float(np.nanmedian(x))
        for name, x in every.items()
        if largest and at_rest(x, largest)
    }


def rest_note(joint: str, position: float) -> str:
    """Note on a joint at rest."""
    return f"'{joint}' rests at {position:.4g}."


def _without_spikes(recording: Recording, joints: Sequence[str]) -> tuple[Recording, list[str]]:
    """Recording with isolated gross outliers interpolated, and notes on them.

    Streams stay as measured: the trajectory estimate gives outliers less weight.
    """
    measured, notes = dict(recording.measured), []
    for kind, symbol in zip(KINDS, ("q", "dq", "ddq", "torques"), strict=True):
        names = [name for name in (f"{joint}_{kind}" for joint in joints) if name in recording.measured]
        names = [name for name in names if recording[name].ndim == 1]
        values, counts = despiked(np.reshape([recording[name] for name in names], (len(names), len(recording.time))).T)
        measured |= zip(names, values.T, strict=True)
        if counts.any():
            notes.append(f"{counts.sum()} gross outliers in {symbol} were interpolated.")
    for name in recording.wrenches:
        values, counts = despiked(recording.wrench(name).values)
        measured |= {f"{name}_force": values[:, :3], f"{name}_torque": values[:, 3:]}
        if counts.any():
            parts = ", ".join(f"{n} in {c}" for n, c in zip(counts, COMPONENTS, strict=True) if n)
            notes.append(f"Gross outliers of the wrench '{name}' were interpolated: {parts}.")
    return replace(recording, measured=measured), notes


def stuck(
    constant: Mapping[str, float], predicted: Mapping[str, np.ndarray], notes: list[str], *, in_fitted: bool = False
) -> tuple[Stuck, ...]:
    """Constant channels that should change by the model; the others are noted.

    Args:
        constant: Constant channels and their values.
        predicted: Channels predicted by the model (N,) each.
        notes: List to which a note is added.
        in_fitted: True if they are constant in the fitted samples, by default in all.
    """
    largest = max((np.abs(x).max() for x in predicted.values()), default=0.0)
    changing = [name for name in constant if np.ptp(predicted[name]) > 1e-6 * largest]
    still = [name for name in constant if name not in changing]
    if still:
        where = " in what is fitted" if in_fitted else ""
        notes.append(f"{', '.join(still)} never change{where}, nor do they by the model, and are left out.")
    return tuple(Stuck(name, float(constant[name]), in_fitted) for name in changing)
