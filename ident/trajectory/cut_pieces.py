"""Pieces of a recording for the trajectory estimate: coordinates, channels, contacts and a spline for each piece."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ident.errors import InputError
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import Prepared
from ident.estimation.recorded_motion import WIDTH, base_coordinates, measured_poses, usual_cutoff
from ident.files.table import BASE
from ident.geometry.se3 import without_jumps
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff
from ident.recordings.times import Sampled, between_samples, interpolated, side_by_side
from ident.recordings.wrench import GROUND, Sensor
from ident.trajectory.algebra.spline import ORDER, Spline
from ident.trajectory.fit.piece import Piece

LONGEST, MOST = 20.0, 5000
"""Largest length of a piece, s, and number of its samples: losses at cuts are relatively small, memory is bounded."""

KNOTS = 2.3
"""Knots per period of the highest frequency in the angles: wrenches contain higher ones."""

WIDEST, WIDEST_BESIDE_TORQUES = 0.15, 0.3
"""Largest knot spacing, s, if a wrench is measured, and for joint torques alone, whose jumps of friction lead to denser
knots later."""

MARGIN = 0.15
"""Extension of a trajectory beyond its samples, for a delayed wrench, s."""

AVERAGED = 0.05
"""Time on either side over which contacts are averaged, s."""


def knot_distance(recording: Recording, joints: tuple[str, ...], widest: float) -> float:
    """Knot spacing for the highest frequency of the motion, s, `widest` at most."""
    try:
        if recording.base is None:
            highest = usual_cutoff(recording, joints)
        else:
            highest = chosen_cutoff(coordinates(recording.without_streams, joints).values, recording.rate)
    except InputError:
        return widest
    return float(np.clip(1 / (KNOTS * highest), 2 / recording.rate, widest))


def coordinates(recording: Recording, joints: tuple[str, ...]) -> Sampled:
    """Measured coordinates: position and quaternion of a moving base, then the joints' (N, n)."""
    parts = [recording.as_measured(f"{joint}_position") for joint in joints]
    parts = [Sampled(t, without_jumps(x)) if x.ndim == 2 else Sampled(t, x) for t, x in parts]
    if recording.base is not None:
        time, poses = recording.as_measured(BASE)
        parts.insert(0, Sampled(time, base_coordinates(poses.reshape(-1, 4, 4))))
    return side_by_side(parts)


def cut(prepared: Prepared, measurement: Measurement, part: slice, step: float, *, least: int = 2) -> list[Piece]:
    """Pieces of a part of a recording, at least `least` of them, with streams at their own times.

    Args:
        prepared: The recording.
        measurement: Its channels.
        part: Samples at common times that the part spans.
        step: Largest knot spacing, s.
        least: Least number of pieces; at a cut accelerations depend on one side only.

    Raises:
        InputError: In one of the pieces a coordinate has too few samples.
    """
    recording = prepared.recording
    states, time = coordinates(recording, prepared.mechanism.joints), recording.time
    channels, wrenches = _channels(prepared, measurement)
    echo = _echo(prepared, measurement, states, channels.time)
    own = channels.time[np.isfinite(channels.values[:, : len(measurement.equations.channels)]).any(axis=1)]
    held = float(np.median(np.diff(own))) / 2 if _commands_alone(measurement) else 0.0
    first, last = part.start, part.stop
    number = max(least, int(np.ceil(max((time[last - 1] - time[first]) / LONGEST, (last - first) / MOST))))
    borders = np.linspace(first, last, number + 1).round().astype(int)
    ends = np.append(time, np.nextafter(time[-1], np.inf))
    pieces = []
    for a, b in pairwise(borders):
        x, y = (slice(*np.searchsorted(each.time, (ends[a], ends[b]))) for each in (states, channels))
        _check(recording, prepared.mechanism.joints, states.values[x], ends[a], ends[b])
        end = max(time[b - 1], *states.time[x][-1:], *channels.time[y][-1:])
        spline = Spline.over(time[a] - MARGIN, end + MARGIN, step)
        late = len(measurement.equations.channels if measurement.frame is None else measurement.components)
        measured = channels.time[y], channels.values[y], wrenches[y]
        piece = Piece(spline, states.time[x], states.values[x], *measured, float(time[0]), late)
        pieces.append(piece if echo is None else replace(piece, held=held, echo=echo[y]))
    return pieces


def _check(recording: Recording, joints: tuple[str, ...], samples: np.ndarray, start: float, end: float) -> None:
    """Raises an InputError if a coordinate (N, n) has too few samples to determine the unpenalised polynomial."""
    samples_of = np.isfinite(samples).sum(axis=0)
    if samples_of.min() < ORDER:
        names = [f"The joint '{joint}'" for joint in joints for _ in range(recording[f"{joint}_position"][0].size)]
        names = ["The base"] * (len(samples_of) - len(names)) + names
        raise InputError(
            f"{names[samples_of.argmin()]} needs at least {ORDER} samples from {start:g} to {end:g} s, it has "
            f"{samples_of.min()}; leave that part of the recording out."
        )


def _channels(prepared: Prepared, measurement: Measurement) -> tuple[Sampled, np.ndarray]:
    """Measured channels (M, C), and `Piece.wrenches` at the same times (M, 2, 6 k)."""
    recording = prepared.recording
    contacts = [_on_mechanism(recording, name) for name in measurement.contacts]
    parts = []
    if measurement.frame is not None:
        time, ground = _on_mechanism(recording, GROUND)
        parts = [Sampled(time, ground[:, list(measurement.components)])]
    elif measurement.components:
        # Nothing holds the base: the sum of all wrenches is zero, at the times of the slowest contact.
        time = min((contact.time for contact in contacts), key=len, default=recording.time)
        parts = [Sampled(time, np.zeros((len(time), len(measurement.components))))]
    parts += _torques(prepared, measurement)
    missing = Sampled(recording.time, np.full((len(recording.time), 3 * WIDTH), np.nan))
    poses = [measured_poses(recording, x) if x in recording.trackers else missing for x in measurement.tracked]
    # Their channels, and then the first and the second halves of their orientations.
    parts += [Sampled(x.time, x.values[:, first : first + WIDTH]) for first in (0, WIDTH, 2 * WIDTH) for x in poses]
    time, values = side_by_side(parts)
    values, references = np.split(values, [measurement.width], axis=1)
    there = [between_samples(contact, time, _reach(contact)) for contact in contacts]
    values = np.where(np.all([prepared.usable(time), *there], axis=0)[:, None], values, np.nan)
    wrenches = np.hstack([np.zeros((len(time), 0)), *(interpolated(contact, time) for contact in contacts)])
    rate = (len(time) - 1) / (time[-1] - time[0])
    averages = average_of_neighbours(wrenches, max(1, round(AVERAGED * rate)))
    halves = np.nan_to_num(references).reshape(len(time), 2, WIDTH * len(poses))
    return Sampled(time, values), np.concatenate([np.stack([averages, wrenches - averages], axis=1), halves], axis=2)


def _torques(prepared: Prepared, measurement: Measurement) -> Iterator[Sampled]:
    """Yields measured joint torques (N,), of commanded joints their commands times `kp`."""
    recording = prepared.recording
    freedoms = [(body.joint, k) for body in prepared.mechanism.tree.bodies for k in range(body.freedoms)]
    for joint, component in (freedoms[k] for k in measurement.equations.torques):
        servo = recording.servos.get(joint)
        stream = recording.as_measured(f"{joint}_command" if servo else f"{joint}_torque")
        own = stream.columns[:, component] * (servo.kp if servo else 1.0)
        if servo and _commands_alone(measurement):
            # The mean over the time that each is held, but for the half sample, which is in `Piece.held`.
            own[1:-1] += np.diff(own, 2) / 24
        elif servo:
            # Channels share their times here, so that the half sample of a held command is in its values. Within
            # samples, angles whose acceleration jumps are off their spline.
            own = (own + np.append(own[:1], own[:-1])) / 2
            own[1:-1] -= np.diff(own, 2) / 12
        yield Sampled(stream.time, own)


def _commands_alone(measurement: Measurement) -> bool:
    """True if all channels are commands, which share a lag."""
    servos = measurement.equations.servos
    return servos is not None and not measurement.components and bool(servos[0].all())


def _echo(prepared: Prepared, measurement: Measurement, states: Sampled, time: np.ndarray) -> np.ndarray | None:
    """`Piece.echo` at the times of the channels (M, C), from the measured coordinates."""
    equations, first = measurement.equations, measurement.of_base
    if equations.servos is None:
        return None
    q = interpolated(states, time)[:, first:]
    lengths = prepared.mechanism.tree.freedom_coordinates(q)[:, list(equations.torques)]
    out, end = np.zeros((len(time), measurement.width)), len(equations.channels)
    out[:, end - len(equations.torques) : end] = equations.servos[0] * lengths
    return out


def _on_mechanism(recording: Recording, name: str) -> Sampled:
    """Wrench `[F; τ]` of the surroundings on the mechanism, in the sensor's frame (N, 6)."""
    time, values = side_by_side([recording.as_measured(f"{name}_{kind}") for kind in ("force", "torque")])
    return Sampled(time, values if recording.sensors.get(name, Sensor()).applied_to_link else -values)


def _reach(contact: Sampled) -> float:
    """Longest time between samples of a contact across which it is interpolated, s."""
    return max(AVERAGED, 2 * float(np.median(np.diff(contact.time))))


def average_of_neighbours(x: np.ndarray, reach: int) -> np.ndarray:
    """Means over the `reach` samples before and after each sample, without the sample itself (N, k)."""
    kernel = np.ones(2 * reach + 1)
    kernel[reach] = 0
    out = np.empty(x.shape)
    for column, averages in zip(x.T, out.T, strict=True):
        averages[:] = np.convolve(column, kernel)[reach : reach + len(x)]
    return out / np.convolve(np.ones(len(x)), kernel)[reach : reach + len(x), None]
