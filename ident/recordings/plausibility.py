"""Faults in a log: whole turns where a range ends, other units than meant, commands that give no torque."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np

from ident.errors import LogError
from ident.files.column import Columns
from ident.files.table import Table, short
from ident.mechanism.mechanism import Mechanism
from ident.recordings.columns.mapping import ColumnMapping
from ident.recordings.recording import Recording
from ident.recordings.stated import Servo, model_servo
from ident.recordings.times import Sampled
from ident.recordings.wrench import GROUND
from ident.tolerances import KILONEWTONS, TURNS

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
    m = max(1, len(time) // 100)
    # Differences and integrals over many samples have less noise than derivatives.
    integral = np.append(0, np.cumsum((dx[1:] + dx[:-1]) / 2 * np.diff(time)))
    a, b = x[m:] - x[:-m], integral[m:] - integral[:-m]
    power, other, common = float(a @ a), float(b @ b), float(a @ b)
    return common / power if common**2 > 0.81 * power * other > 1e-30 else 0.0


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
        if turns:
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
