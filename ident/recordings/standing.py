"""Wrenches of force plates: about the frame's origin, zero while unloaded, assigned to the body on the plate."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ident.errors import LogError
from ident.files.table import Table
from ident.geometry.se3 import inverse
from ident.mechanism.mechanism import Mechanism
from ident.recordings.plates import THRESHOLD, Plate
from ident.recordings.recording import Recording
from ident.recordings.smoothing import runs
from ident.recordings.times import Sampled
from ident.recordings.wrench import Sensor, pose_in_base
from ident.tolerances import NAMED

CLOSE = 1.5
"""Ratio of the distances of two bodies from a force below which the assignment is doubtful."""

FADES = 0.1
"""Ratio of the lowest tenth of an unloaded plate's forces to their median up to which they are no noise: of white noise
it is 0.49 with three components and 0.19 with one, of a simulated contact 0.03. Forces that were set to zero do not
tell: those of 2 to 20 N beside them make predictions of a walker up to 3 % worse."""

FEWEST = 20
"""Smallest number of unloaded samples by which that is decided."""

WHITE, SURE = 0.054, 0.55
"""Share of white noise of one component that is below `FADES` times its median, and what is added to it, over the root
of the number of samples, so that a larger share does not pass for such noise: 1 % of 4000 draws of 20 to 1000 do."""


def about_origins(
    table: Table, channels: Mapping[str, np.ndarray], plates: Mapping[str, Plate], notes: list[str], *, gaps: bool
) -> dict[str, np.ndarray]:
    """Channels with moments about the plates' origins in place of points of application: `M = M_free + p × F`.

    Where the force does not exceed the threshold, the wrench is zero.

    Args:
        table: The file, for messages.
        channels: Measured channels by key of the mapping, in SI units (N, k).
        plates: Plates by the names of their wrenches.
        notes: Sentences on what was done; more are appended.
        gaps: True if samples may be missing.

    Raises:
        LogError: A point of application is missing while a force acts.
    """
    out = dict(channels)
    for name, plate in plates.items():
        force, torque = (f"wrenches.{name}.{kind}" for kind in ("force", "torque"))
        known = ~np.isnan(out[force]).all(axis=0)
        size = np.linalg.norm(out[force][:, known], axis=1)
        # Bodies that take turns need samples without a force between them.
        exact = plate.threshold is None and len(plate.bodies) == 1 and _fades(size)
        threshold = 0.0 if exact else THRESHOLD if plate.threshold is None else plate.threshold
        # Of missing samples and components nothing is known.
        quiet = size <= (threshold if known.any() else -1.0)
        if plate.point is not None:
            if exact:
                quiet |= (size <= THRESHOLD) & _left_out(out[f"wrenches.{name}.point"])
            out[torque] = _moment(table, f"wrenches.{name}", out, plate, quiet, threshold, gaps)
        elif not threshold:
            continue
        for key in (force, torque):
            measured = ~np.isnan(out[key]).all(axis=0)
            out[key] = np.where(quiet[:, None] & measured, 0.0, out[key])
        if size[quiet].any():
            unused = "" if plate.point is None else ", nor is its point of application used"
            largest, rms = max(threshold, size[quiet].max()), np.sqrt(np.mean(size[quiet] ** 2))
            notes.append(
                f"The wrench '{name}' counts as nothing in {quiet.sum()} of {len(quiet)} samples, whose force is at "
                f"most {largest:.3g} N, {rms:.2g} N root mean square{unused}."
            )
        elif exact:
            notes.append(
                f"All forces of the wrench '{name}' count: those of at most {THRESHOLD:g} N fade as in simulations, so "
                f"they are no noise. 'threshold' = {THRESHOLD:g} leaves them out."
            )
    return out


def _fades(size: np.ndarray) -> bool:
    """True if forces (N,) of at most `THRESHOLD` are no noise but those of a simulated contact, which fade."""
    low = size[size <= THRESHOLD]
    if low.size < FEWEST:
        return False
    least, tenth = np.quantile(low, (0.1, max(0.1, WHITE + SURE / np.sqrt(low.size))))
    return bool(least > 0 and tenth <= FADES * np.median(low))


def _left_out(point: np.ndarray) -> np.ndarray:
    """Mask of the samples whose point of application is missing or zero, as files have it where there is none (N,)."""
    point = point[:, ~np.isnan(point).all(axis=0)]
    return np.isnan(point).any(axis=1) | (point == 0).all(axis=1) & (point.shape[1] > 0)


def _moment(
    table: Table, where: str, channels: dict[str, np.ndarray], plate: Plate, quiet: np.ndarray, least: float, gaps: bool
) -> np.ndarray:
    """Moment about the frame's origin of a force at a point (N, 3); removes point and free moment from the channels."""
    measured, free = (channels.pop(f"{where}.{kind}") for kind in ("point", "free_moment"))
    force = channels[f"{where}.force"]
    assert plate.point is not None
    point = np.where(quiet[:, None], 0.0, np.where(np.isnan(plate.point), measured, plate.point))
    lost = np.isnan(point).any(axis=1) & np.isfinite(force).all(axis=1)
    if lost.any() and not gaps:
        raise LogError(
            f"{table.row(int(lost.argmax()))}, {where}.point is missing, as in {lost.sum()} of {len(lost)} samples "
            f"with more than {least:.3g} N; with a higher 'threshold' their force counts as nothing."
        )
    known = ~np.isnan(free).all(axis=0)
    return np.where(known, free, 0.0) + np.cross(point, force)


def placed(recording: Recording, mechanism: Mechanism, plates: Mapping[str, Plate], notes: list[str]) -> Recording:
    """The recording with its plates in the frame of a base at rest, and a wrench for each body on a plate.

    Args:
        recording: The recording, its plates in the model's world.
        mechanism: The mechanism, into whose base frame they are moved if the base rests.
        plates: Plates by the names of their wrenches.
        notes: Sentences on the bodies on plates; more are appended.

    Raises:
        LogError: The ground rests in the world while the base moves, or the body on a plate cannot be found.
    """
    for name, plate in plates.items():
        sensor = recording.sensors[name]
        if recording.base is None:
            sensor = replace(sensor, pose=inverse(mechanism.pose) @ sensor.pose)
        elif sensor.body is None:
            raise LogError(
                f"[wrenches.{name}] rests in the world while the base moves: give it another name, and the body that "
                "is 'on' it."
            )
        recording = recording.with_sensors({name: sensor})
        if len(plate.bodies) > 1:
            recording = _taking_turns(recording, mechanism, name, plate, notes)
    return recording


def _taking_turns(recording: Recording, mechanism: Mechanism, name: str, plate: Plate, notes: list[str]) -> Recording:
    """The recording with a separate wrench for each body that may be on a plate, zero while it is not."""
    sensor = recording.sensors[name]
    who, close = _standing(recording, mechanism, sensor, name, plate)
    notes.append(_contact_note(recording.time, who, close, name, plate.bodies))
    others = [body for k, body in enumerate(plate.bodies) if body != plate.expected and (who == k).any()]
    if plate.expected and others:
        here = f"{plate.expected} was expected on '{name}'"
        notes.append(f"{here}; its force is that of {', '.join(others)}, which counts.")
    sensors = {key: x for key, x in recording.sensors.items() if key != name}
    measured, streams, units = dict(recording.measured), dict(recording.streams), dict(recording.units)
    for kind in ("force", "torque"):
        channel = f"{name}_{kind}"
        values, stream, unit = measured.pop(channel), streams.pop(channel, None), units.pop(channel, None)
        for k, body in enumerate(plate.bodies):
            own = f"{body} on {name}"
            sensors[own] = replace(sensor, body=body, plate=name)
            measured[f"{own}_{kind}"] = np.where((who == k)[:, None], values, 0.0)
            units |= {} if unit is None else {f"{own}_{kind}": unit}
            if stream is not None:
                at_stream = who[_nearest(recording.time, stream.time)] == k
                streams[f"{own}_{kind}"] = Sampled(stream.time, np.where(at_stream[:, None], stream.values, 0.0))
    return replace(recording, measured=measured, streams=streams, units=units, sensors=sensors)


def _standing(
    recording: Recording, mechanism: Mechanism, sensor: Sensor, name: str, plate: Plate
) -> tuple[np.ndarray, list[tuple[int, str]]]:
    """Index of the body on a plate, -1 for none (N,), and starts of doubtful episodes with the next nearest body.

    In every episode of force it is the body whose origin p is nearest to the line of action of the force, averaged with
    the force as weight: |(M - p × F) × F| / F². That line meets the plate at the centre of pressure.
    """
    tree = mechanism.tree
    force, torque = recording[f"{name}_force"], recording[f"{name}_torque"]
    if not np.isfinite(np.hstack([force, torque])).all():
        raise LogError(f"[wrenches.{name}] needs all six components to find who is on it.")
    poses = tree.poses(recording.of_joints(tree.joints, "position"))[:, [tree.names.index(b) for b in plate.bodies]]
    to_sensor = inverse(pose_in_base(sensor, np.eye(4), recording.base))
    origins = (to_sensor.reshape(-1, 1, 4, 4) @ poses)[..., :3, 3]
    size = np.linalg.norm(force, axis=1)
    arms = np.cross(torque[:, None] - np.cross(origins, force[:, None]), force[:, None])
    weighted = np.linalg.norm(arms, axis=2) / np.maximum(size, 1e-12)[:, None]
    who, close = np.full(len(size), -1), []
    # Forces above the threshold; interpolated between two samples they may be lower, but not zero.
    for first, end in runs(size > 0):
        during = slice(first, end)
        distances = weighted[during].sum(axis=0) / size[during].sum()
        order = np.argsort(distances, kind="stable")
        who[during] = order[0]
        if distances[order[1]] < CLOSE * distances[order[0]]:
            close.append((int(first), plate.bodies[order[1]]))
    return who, close


def _contact_note(
    time: np.ndarray, who: np.ndarray, close: Sequence[tuple[int, str]], name: str, bodies: Sequence[str]
) -> str:
    """A note on the bodies found on a plate, with times."""
    borders = np.flatnonzero(np.diff(who, prepend=-1, append=-1))
    spans = [(a, b - 1) for a, b in pairwise(borders) if who[a] >= 0]
    listed = [f"{bodies[who[a]]} from {time[a]:.2f} to {time[b]:.2f} s" for a, b in spans[:NAMED]]
    more = f", and {len(spans) - NAMED} times more" if len(spans) > NAMED else ""
    doubt = "".join(f" From {time[a]:.2f} s on {body} is nearly as near." for a, body in close[:NAMED])
    return f"By its force, on '{name}' is {', '.join(listed) or 'nobody'}{more}.{doubt}"


def _nearest(time: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Indices of the times nearest to those asked for."""
    after = np.clip(np.searchsorted(time, asked), 1, len(time) - 1)
    return np.where(asked - time[after - 1] <= time[after] - asked, after - 1, after)
