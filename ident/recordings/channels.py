"""The channels of a log in SI units: columns by the mapping or by their names; whole turns and wrong units."""

import re
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from difflib import get_close_matches
from itertools import product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import LogError
from ident.files.table import BALL, BASE, COMMAND, KINDS, UNITS, Columns, Table, listed, short
from ident.geometry.se3 import without_jumps
from ident.mechanism.mechanism import Mechanism
from ident.recordings.followers import moved, with_followers
from ident.recordings.mapping import STATED, ColumnMapping, check_no_column_twice
from ident.recordings.recording import Recording
from ident.recordings.standing import about_origins
from ident.recordings.stated import TRACKED, annotations
from ident.recordings.times import AS_MEASURED, POSES
from ident.recordings.wrench import GROUND, Sensor
from ident.tolerances import HUGE, KILONEWTONS, TURNS

SUGGESTION = " `multicontact columns MODEL LOG` writes a mapping to correct; in Python, columns= takes one."
"""Advice for logs whose columns cannot be assigned by name."""

ALIKE = 0.85
"""Similarity from which a name is taken as another one, misspelt."""


def unmapped(columns: Sequence[str]) -> str:
    """A sentence on the unused columns of a log, where no wrench and no torque is known."""
    plain = [" ".join(name.split()) for name in columns]
    there = f"Besides times, joint states and what is empty it has {'the' if columns else 'no'} columns"
    there += f" {listed(plain)}" if columns else ""
    return f"{there}; none is mapped as a wrench or a torque, or has the name of one.{SUGGESTION}"


def misspelt(unused: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Sentences on the unused columns whose names are nearly those of channels that are missing.

    Args:
        unused: Names of the unused columns.
        wanted: Names that the columns of the missing channels would have.
    """
    out = []
    # A column that the mapping leaves out on purpose may have the very name.
    for name in (each for each in unused if each not in wanted):
        alike = [each for each in wanted if re.sub(r"\D", "", each) == re.sub(r"\D", "", name)]
        if close := get_close_matches(name.casefold(), alike, 1, ALIKE):
            out.append(f"Column '{short(name)}' is not used, since its name is not '{close[0]}'; rename or map it.")
    return out


class NoPositionError(LogError):
    """A log has no positions of a joint."""


def with_names(mapping: ColumnMapping, table: Table, joints: Mapping[str, str]) -> ColumnMapping:
    """The mapping completed by the names of the file's columns and the units that the file states.

    Args:
        mapping: The mapping so far.
        table: The file.
        joints: Kind of each joint, `hinge`, `slide` or `ball`, by name.

    Raises:
        LogError: A mapped column, the time or the position of a joint is missing, names are ambiguous, or a column is
            used twice or mapped in another unit than the file's.
    """
    stated = annotations(table.metadata)
    mapping = _with_saved(mapping, stated)
    columns, sensors = dict(mapping.columns), dict(mapping.sensors)
    suggestion = "" if columns else SUGGESTION
    if "time" not in columns:
        columns["time"] = Columns((_named(table, "time", ("time", "t")),), unit="s" * mapping.still)
    for joint, joint_kind in joints.items():
        for kind in KINDS:
            if f"joints.{joint}.{kind}" not in columns:
                columns[f"joints.{joint}.{kind}"] = _of_joint(table, joint, joint_kind, kind)
        if joint_kind != "ball" and (command := COMMAND.format(joint)) in table.cells:
            columns.setdefault(f"joints.{joint}.command", Columns((command,)))
    _check_positions(replace(mapping, columns=columns), table, joints, suggestion)
    if not columns["time"].names[0]:
        raise LogError(
            "a log needs a column of times, named time or t or mapped, or in the mapping its samples per second, as in "
            f"rate = 100; {table.available()}.{POSES}{suggestion}"
        )
    for sensor, place in {GROUND: Sensor(), **stated.get("sensors", {})}.items():
        if sensor not in sensors and (of_sensor := _of_sensor(table, sensor)):
            columns |= of_sensor
            sensors[sensor] = place
    for name in mapping.trackers:
        for kind, ends in (("position", "xyz"), ("orientation", "wxyz")):
            columns.setdefault(f"{TRACKED}{name}.{kind}", Columns(tuple(f"{name}_{kind}.{c}" for c in ends)))
    if f"{BASE}.0" in table.cells and not any(key.startswith("base.") for key in mapping.columns):
        columns["base.pose"] = Columns(tuple(f"{BASE}.{k}" for k in range(16)))
    columns = {key: _with_unit_of_file(key, used, table, joints) for key, used in columns.items()}
    mapped = {joint: kind for joint, kind in joints.items() if f"joints.{joint}.position" in mapping.columns}
    mapping = with_followers(replace(mapping, columns=columns), mapped)
    columns = mapping.columns
    check_no_column_twice(columns)
    for key, used in columns.items():
        for name in used.read:
            if name not in table.cells:
                raise LogError(f"{key} is mapped to column '{short(name)}', but {table.available()}.")
    hinges = [joint for joint in joints if joints[joint] == "hinge"]
    angles = {f"joints.{joint}.{kind}" for joint in hinges for kind in ("position", "command")}
    turns = {name: own for key in columns if key in angles for name, own in turns_of(columns[key]).items()}
    return replace(mapping, columns=columns, sensors=sensors, turns=turns)


def _check_positions(mapping: ColumnMapping, table: Table, joints: Mapping[str, str], suggestion: str) -> None:
    """Raises an error if a joint without positions neither follows another one nor depends on loops."""
    whole, depends = mapping.mechanism, set[str]()
    if whole:
        depends = {*whole.tree.joints} - {*moved(mapping, whole).tree.joints}
    for joint, kind in joints.items():
        if not all(mapping.columns[f"joints.{joint}.position"].names) and joint not in (*mapping.followers, *depends):
            names, ball = ", ".join(p.format(joint) for p in KINDS["position"]), kind == "ball"
            raise NoPositionError(
                f"joint '{joint}' needs {'columns' if ball else 'a column'} of its positions, named {names} "
                f"{'with .w, .x, .y and .z ' if ball else ''}or mapped; {table.available()}. "
                f"Where it does not move, --fix {shlex.quote(joint)} [VALUE] leaves it out (fix= of mc.mechanism)."
                f"{suggestion}"
            )


def _of_sensor(table: Table, sensor: str) -> dict[str, Columns]:
    """Columns of a sensor's force and torque by their names, none if the file has none of them."""
    parts = {
        f"wrenches.{sensor}.{kind}": tuple(
            _named(table, f"the {kind} of '{sensor}'", (f"{sensor}_{kind}.{c}", f"{sensor}_{letter}{c}")) for c in "xyz"
        )
        for kind, letter in (("force", "f"), ("torque", "m"))
    }
    return {key: Columns(names) for key, names in parts.items()} if any(map(any, parts.values())) else {}


def _with_saved(mapping: ColumnMapping, stated: Mapping[str, Any]) -> ColumnMapping:
    """The mapping with what a saved recording states and the mapping does not."""
    own = dict[str, Any]()
    for name, x in ((name, x) for name, x in stated.items() if name in (*STATED, "servos")):
        here = getattr(mapping, name)
        own[name] = {**x, **here} if isinstance(x, Mapping) else x if here == getattr(ColumnMapping, name) else here
    return replace(mapping, **own)


def _of_joint(table: Table, joint: str, joint_kind: str, kind: str) -> Columns:
    """Columns of one quantity of a joint, found by name; "" for missing ones."""
    ends = [f".{component}" for component in BALL[kind]] if joint_kind == "ball" else [""]
    what = f"the {kind} of joint '{joint}'"
    return Columns(tuple(_named(table, what, [f"{p.format(joint)}{end}" for p in KINDS[kind]]) for end in ends))


def _with_unit_of_file(key: str, columns: Columns, table: Table, joints: Mapping[str, str]) -> Columns:
    """Columns in the unit that the file states, if it states one.

    Raises:
        LogError: They are mapped in another one.
    """
    room, _, rest = key.partition(".")
    name, _, kind = rest.rpartition(".")
    if room == "joints":
        quantity = f"{joints[name]} {kind}"
    else:
        quantity = "time" if room == "time" else {"force": "force", "torque": "torque"}.get(kind, "length")
    stated = {table.units.get(column, "") for column in columns.read}
    if not columns.read or "" in stated or len(stated) > 1 or kind in ("quaternion", "pose", "orientation"):
        return columns
    units = list(UNITS[quantity])
    unit = next((u for u in units if stated == {"deg"} and u.startswith("deg")), units[0])
    factor = UNITS[quantity][unit]
    if columns.unit and columns.factor != factor and not columns.sums:
        raise LogError(f"{key} is mapped in another unit than the file's, which says {unit}; leave the unit out.")
    return columns if columns.unit else replace(columns, factor=factor, unit=units[0])


def _named(table: Table, what: str, names: Sequence[str]) -> str:
    present = [name for name in names if name in table.cells]
    if len(present) > 1:
        raise LogError(f"columns {' and '.join(present)} may both be {what}; keep one of them, or map one.")
    return present[0] if present else ""


def read_channels(
    table: Table, mapping: ColumnMapping, notes: list[str], *, gaps: bool = False
) -> dict[str, np.ndarray]:
    """Numbers of all mapped channels but the time.

    Args:
        table: The file.
        mapping: Its complete mapping.
        notes: Sentences on what was detected; more are appended.
        gaps: True if samples may be missing, except those of a moving base.

    Returns:
        Channels by key of the mapping, in SI units, NaN for missing values (N, 1), (N, 3) or (N, 4).

    Raises:
        LogError: A column has no numbers, not all of them, or numbers out of range.
    """
    table, wrapped = with_continuous_angles(table, mapping.turns, notes)
    for key, columns in mapping.columns.items():
        if not wrapped.isdisjoint(columns.read):
            # Its turns show its unit, however far it goes.
            mapping.columns[key] = replace(columns, unit="rad")
    channels = {
        key: _read(table, key, columns, notes, key.startswith(TRACKED) or (gaps and not key.startswith("base.")))
        for key, columns in mapping.columns.items()
        if key != "time"
    }
    others = [n for n in table.cells if n not in mapping.used and re.fullmatch(r".+_(force\.[xyz]|f[xyz])", n)]
    if others:
        notes.append(
            f"Columns {', '.join(others)} look like a wrench; without an entry under [wrenches] it is not used."
        )
    for key, x in channels.items():
        if key.endswith(".orientation") and x.shape[1] == 3:
            x = Rotation.from_rotvec(x).as_quat(scalar_first=True)
        if x.shape[1] == len(BALL["position"]):
            channels[key] = _continuous(table, key, x)
    return about_origins(table, channels, mapping.plates, notes, gaps=gaps)


def _read(table: Table, key: str, columns: Columns, notes: list[str], gaps: bool) -> np.ndarray:
    # Without a force a point is missing or a quotient of noise, so no notes about it.
    x, point = np.full((len(table.rows), len(columns.names)), np.nan), key.endswith(".point")
    for k, name in ((k, name) for k, name in enumerate(columns.names) if name):
        limit = HUGE if point else HUGE / columns.factor
        x[:, k] = table.column(name, limit, gaps=gaps or point, tame=point)
        missing = np.isnan(x[:, k])
        if missing.all() and key.endswith((".position", ".quaternion", ".orientation")):
            raise LogError(f"column '{name}' is empty, but {key} needs it.")
        if missing.any() and not point:
            much = f"in {missing.sum()} of {len(x)} samples. {AS_MEASURED}"
            notes.append(f"Column '{name}' ({key}) is empty {'and taken as missing.' if missing.all() else much}")
    return x * columns.factor


def _continuous(table: Table, key: str, quaternion: np.ndarray) -> np.ndarray:
    """Unit quaternions whose signs do not jump, NaN where a component is missing (N, 4)."""
    norm = np.linalg.norm(quaternion, axis=1)
    if (wrong := np.abs(norm - 1) > 0.01).any():
        i = int(wrong.argmax())
        raise LogError(f"{table.row(i)}, {key} needs a norm of 1, got {norm[i]:g}.")
    return without_jumps(quaternion / norm[:, None])


RANGE = 1.01
"""Largest range of a wrapped angle in turns; the rest is noise at its ends."""

FAST, CLOSE = 0.25, 0.05
"""Largest step beside a jump, and largest difference of a jump without its turn from the steps beside it, in turns. A
joint that goes through less than a quarter of a turn in a sample can be followed; no joint goes through nine tenths of
a turn in one sample and rests before and after it."""


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


def with_continuous_angles(
    table: Table, turns: Mapping[str, Sequence[float]], notes: list[str]
) -> tuple[Table, set[str]]:
    """The table with wrapped columns unwrapped, and the names of these.

    Args:
        table: The file.
        turns: Numbers that may be a whole turn, by column, as from `turns_of`.
        notes: Sentences on what was detected; more are appended.
    """
    cells, wrapped = dict(table.cells), set[str]()
    for name in (name for name in turns if name in table.cells):
        # What cannot be read is refused where it is used.
        with suppress(LogError):
            x, number = unwrapped(table.column(name, gaps=True), turns[name])
            if number:
                notes.append(
                    f"Column '{short(name)}' jumps by a whole turn {number} times, as an angle does where its range "
                    "ends; it was made continuous."
                )
                cells[name] = x
                wrapped.add(name)
    return replace(table, cells=cells), wrapped


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
