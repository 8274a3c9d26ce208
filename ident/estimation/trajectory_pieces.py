"""A recording cut into pieces of the joint estimate: coordinates, channels and contacts, each with its own spline."""

from itertools import pairwise

import numpy as np
from scipy import ndimage

from ident.errors import InputError
from ident.estimation.measurement import Measurement
from ident.estimation.piece import Piece
from ident.estimation.preparation import Prepared
from ident.estimation.spline import ORDER, Spline
from ident.geometry.quaternion import continuous_quaternions, without_jumps
from ident.recordings.recording import Recording
from ident.recordings.sampled import Sampled, between_samples, interpolated, side_by_side
from ident.recordings.smoothing import chosen_cutoff
from ident.recordings.table import BASE
from ident.recordings.wrench import GROUND, Sensor

LONGEST, MOST = 20.0, 5000
"""Length of a piece, s, and its samples: what is lost at a cut is little beside it, and memory is bounded."""

KNOTS = 2.3
"""Knots in a period of the highest frequency that angles tell of: wrenches tell of higher ones."""

WIDEST, WIDEST_BESIDE_TORQUES = 0.15, 0.3
"""Largest distance of knots, s, where a wrench is measured, and where joint torques alone are: friction jumps in these,
which denser knots follow."""

MARGIN = 0.15
"""How far a trajectory reaches beyond its samples for a wrench that is late, s."""

AVERAGED = 0.05
"""Time to either side over which contacts are averaged, s."""


def knot_distance(recording: Recording, joints: tuple[str, ...], widest: float) -> float:
    """Distance of the knots that the motion asks for, s, or the largest one that there may be."""
    try:
        highest = chosen_cutoff(coordinates(recording.without_streams, joints).values, recording.rate)
    except InputError:
        return widest
    return float(np.clip(1 / (KNOTS * highest), 2 / recording.rate, widest))


def coordinates(recording: Recording, joints: tuple[str, ...]) -> Sampled:
    """Measured coordinates: position and quaternion of a moving base, then those of the joints (N, n)."""
    parts = [recording.as_measured(f"{joint}_position") for joint in joints]
    parts = [Sampled(t, without_jumps(x)) if x.ndim == 2 else Sampled(t, x) for t, x in parts]
    if recording.base is not None:
        time, poses = recording.as_measured(BASE)
        parts.insert(0, Sampled(time, _positions_and_quaternions(poses.reshape(-1, 4, 4))))
    return side_by_side(parts)


def _positions_and_quaternions(poses: np.ndarray) -> np.ndarray:
    """Of poses (N, 4, 4), quaternions without jumps of sign; NaN where a pose is missing (N, 7)."""
    there = np.isfinite(poses).all(axis=(1, 2))
    out = np.full((len(poses), 7), np.nan)
    out[there] = np.hstack([poses[there, :3, 3], continuous_quaternions(poses[there, :3, :3])])
    return out


def cut(prepared: Prepared, measurement: Measurement, part: slice, step: float, *, least: int = 2) -> list[Piece]:
    """A part of a recording as two pieces or more, or as many as asked for; streams at times of their own.

    Args:
        prepared: The recording.
        measurement: Its channels.
        part: Which of the samples at common times, from whose first to whose last one it is.
        step: Largest distance of the knots, s.
        least: How many pieces at least; at a cut accelerations follow from one side alone.

    Raises:
        InputError: In one of the pieces a coordinate has hardly any samples.
    """
    recording = prepared.recording
    states, time = coordinates(recording, prepared.mechanism.joints), recording.time
    channels, wrenches = _channels(prepared, measurement)
    first, last = part.start, part.stop
    number = max(least, int(np.ceil(max((time[last - 1] - time[first]) / LONGEST, (last - first) / MOST))))
    borders = np.linspace(first, last, number + 1).round().astype(int)
    ends = np.append(time, np.nextafter(time[-1], np.inf))
    pieces = []
    for a, b in pairwise(borders):
        x, y = (slice(*np.searchsorted(each.time, (ends[a], ends[b]))) for each in (states, channels))
        _check(states.values[x], ends[a], ends[b])
        end = max(time[b - 1], *states.time[x][-1:], *channels.time[y][-1:])
        spline = Spline.over(time[a] - MARGIN, end + MARGIN, step)
        coordinate_samples = states.time[x], (states.values[x], None, None)
        late = None if measurement.frame is None else len(measurement.components)
        pieces.append(
            Piece(spline, *coordinate_samples, channels.time[y], channels.values[y], wrenches[y], float(time[0]), late)
        )
    return pieces


def _check(samples: np.ndarray, start: float, end: float) -> None:
    """Refuses a piece of coordinates (N, n) whose samples leave open what the prior cannot see."""
    samples_of = np.isfinite(samples).sum(axis=0)
    if samples_of.min() < ORDER:
        raise InputError(
            f"Coordinate {int(samples_of.argmin()) + 1} needs at least {ORDER} samples from {start:g} to "
            f"{end:g} s, it has {samples_of.min()}; leave that part of the recording out."
        )


def _channels(prepared: Prepared, measurement: Measurement) -> tuple[Sampled, np.ndarray]:
    """Measured channels (M, C), and wrenches of contacts then, averages and what is left of them (M, 2, 6 k)."""
    recording = prepared.recording
    contacts = [_on_mechanism(recording, name) for name in measurement.contacts]
    parts = []
    if measurement.frame is not None:
        time, ground = _on_mechanism(recording, GROUND)
        parts = [Sampled(time, ground[:, list(measurement.components)])]
    elif measurement.components:
        # Nothing holds the base: all wrenches come to zero, as often as the slowest contact says.
        time = min((contact.time for contact in contacts), key=len, default=recording.time)
        parts = [Sampled(time, np.zeros((len(time), len(measurement.components))))]
    freedoms = [(body.joint, k) for body in prepared.mechanism.tree.bodies for k in range(body.freedoms)]
    for joint, component in (freedoms[k] for k in measurement.equations.torques):
        stream = recording.as_measured(f"{joint}_torque")
        parts.append(Sampled(stream.time, stream.columns[:, component]))
    time, values = side_by_side(parts)
    there = [between_samples(contact, time, _reach(contact)) for contact in contacts]
    values = np.where(np.all([prepared.usable(time), *there], axis=0)[:, None], values, np.nan)
    wrenches = np.hstack([np.zeros((len(time), 0)), *(interpolated(contact, time) for contact in contacts)])
    rate = (len(time) - 1) / (time[-1] - time[0])
    averages = average_of_neighbours(wrenches, max(1, round(AVERAGED * rate)))
    return Sampled(time, values), np.stack([averages, wrenches - averages], axis=1)


def _on_mechanism(recording: Recording, name: str) -> Sampled:
    """A wrench `[F; τ]` that the surroundings exert on the mechanism, in the sensor's frame (N, 6)."""
    time, values = side_by_side([recording.as_measured(f"{name}_{kind}") for kind in ("force", "torque")])
    return Sampled(time, values if recording.sensors.get(name, Sensor()).applied_to_link else -values)


def _reach(contact: Sampled) -> float:
    """Longest time between samples of a contact over which it is interpolated, s."""
    return max(AVERAGED, 2 * float(np.median(np.diff(contact.time))))


def average_of_neighbours(x: np.ndarray, reach: int) -> np.ndarray:
    """Averages of samples over those before and after them, themselves left out (N, k)."""
    kernel = np.ones(2 * reach + 1)
    kernel[reach] = 0
    there = ndimage.convolve1d(np.ones(len(x)), kernel, mode="constant")
    return ndimage.convolve1d(x, kernel, axis=0, mode="constant") / there[:, None]
