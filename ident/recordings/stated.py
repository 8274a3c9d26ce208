"""Entries of a mapping for one quantity: columns and sums of them, motors, servos, tracked bodies, a person's segments.

Likewise recordings in files, read back exactly.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from dataclasses import fields as data_fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs, NotNegative, Positive, typed
from ident.arguments import OF_BODIES, checked_deviations
from ident.arguments import is_number as a_number
from ident.errors import LogError, about
from ident.files.limits import check_keys, choice, made, table, toml, value_of, vector
from ident.files.readers import read_tables, write_channels
from ident.files.table import (
    BASE,
    CURRENT,
    KINDS,
    METADATA,
    TRUE,
    UNITS,
    Columns,
    Sum,
    combined,
    is_number,
    short,
)
from ident.mechanism.body import Follower, is_rigid
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism
from ident.parameters.person_prior import Placed
from ident.recordings.wrench import Sensor

GAINS = ("kp", "kv")
"""Keys of a joint's entry in a mapping that state the gains of its servo."""

SCALES = {"kp_std": "command", "torque_std": "torque"}
"""Keys that state how uncertain the scale of a joint's torque is, and the channel that each is about."""

Scale = Annotated[float, Needs("a number above 0 and at most 1", lambda x: 0 < x <= 1)]
"""Relative standard deviation of a scale, which is positive."""

Factor = Annotated[float, Needs("a number other than 0", bool)]
Row = Annotated[Mapping[str, Factor], Needs("a number for each joint", bool)]
"""Row of a coupling, by joint, and a number in it."""

TRACKED = "tracked."
"""Start of the keys of poses in a mapping. Samples of them may always be missing: markers are hidden now and then."""


@dataclass(frozen=True)
class Servo:
    """Law of a position-controlled joint, `τ = kp (u - q) - kv q̇`, with the recorded command u.

    A command is held until the next one, so that it acts half a sample later than it is logged on average.

    Attributes:
        kp: Stiffness, N m/rad or N/m.
        kv: Damping, N m s/rad or N s/m.
    """

    kp: Positive
    kv: NotNegative = 0.0


def servo_of(joint: str, entry: Mapping[str, Any]) -> dict[str, Servo]:
    """Servo that a joint's entry in a mapping states, by the joint's name; empty if it states none.

    Raises:
        LogError: A gain is not a number in its range, there is no command, or the torque is mapped as well.
    """
    given = {key: entry[key] for key in GAINS if key in entry}
    if "command" in entry and "torque" in entry:
        raise LogError(f"joints.{joint} maps a torque and a command, from which the torque would follow; map one.")
    if given and "command" not in entry:
        raise LogError(f"joints.{joint} states {', '.join(given)} of a servo; that needs its command as well.")
    return {joint: made(Servo, f"joints.{joint}", given)} if given else {}


def scale_of(joint: str, entry: Mapping[str, Any]) -> dict[str, float]:
    """Relative standard deviation of the scale of a joint's torque that its entry states; empty if it states none.

    Raises:
        LogError: It is no number above 0, or its channel is not mapped.
    """
    stated = [key for key in SCALES if key in entry]
    if without := [key for key in stated if SCALES[key] not in entry]:
        raise LogError(f"joints.{joint} states {without[0]}; that needs its {SCALES[without[0]]} as well.")
    scales = [value_of(f"joints.{joint}.{key}", entry[key], Scale) for key in stated]
    return {joint: scales[-1]} if scales else {}


def model_servo(mechanism: Mechanism, joint: str) -> Servo | None:
    """Servo of a joint by the model's position actuator; None without one, or if it acts through a gear."""
    actuators = [each for each in mechanism.drives.get(joint, NO_DRIVE).actuators if each.kind == "position"]
    alone = len(actuators) == 1 and actuators[0].gear == 1
    return Servo(actuators[0].kp, actuators[0].kv) if alone else None


@typed()
@dataclass(frozen=True, eq=False)
class Tracker:
    """Frames of a tracked body, whose poses a recording has as `NAME_position` and `NAME_orientation`.

    Attributes:
        body: Name of the body.
        markers: Pose of the tracked frame in the body's frame (4, 4); None if it is unknown.
        frame: Pose of the tracker's frame in the base frame, of a moving base in the frame of its poses (4, 4); None if
            it is unknown. All trackers of unknown frames share one.
    """

    body: str
    markers: np.ndarray | None = None
    frame: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, T in (("markers", self.markers), ("frame", self.frame)):
            if T is not None and not (np.shape(T) == (4, 4) and is_rigid(T)):
                raise LogError(f"The tracker of '{self.body}' needs a rigid pose (4, 4) as {name}, got {np.shape(T)}.")


@dataclass(frozen=True)
class Stated:
    """Metadata `stated`: fields of a recording that are no mappings."""

    held: bool | None = None
    base_rpy_deg: tuple[float, ...] | None = None
    still: bool = False
    loaded: str = ""


TYPES: Mapping[str, Any] = {
    "sensors": Mapping[str, Sensor],
    "servos": Mapping[str, Servo],
    "scales": Mapping[str, Scale],
    "couplings": Mapping[str, Row],
    "followers": Mapping[str, Follower],
    "trackers": Mapping[str, Tracker],
    "stated": Stated,
}
"""Types of metadata that are more than JSON, by name."""


def save(path: Path, fields: Mapping[str, Any]) -> None:
    """Writes a `.npz` or `.csv` file.

    Args:
        path: File to write.
        fields: Fields of the recording, by name.

    Raises:
        LogError: A channel has a name that a file cannot hold.
    """
    measured, base = fields["measured"], fields["base"]
    for name in measured:
        if is_number(name) or not re.fullmatch(r"(?!true:|base:|time$|#)[^\s,.]([^,.\r\n]*[^\s,.])?", name):
            raise LogError(f"A channel's name cannot be {name!r}: in a file it is a word without commas and dots.")
    channels = {"time": fields["time"], **measured} | {f"{TRUE}{name}": x for name, x in fields["true"].items()}
    if base is not None:
        channels[BASE] = base.reshape(-1, 16)
    always = {name: fields[name] for name in ("units", "noise", "provenance")}
    others = {name: plain(fields[name]) for name in METADATA if name in fields and name not in always}
    stated = {name: fields[name] for name in ("held", "base_rpy_deg")} | {
        name: fields[name] or None for name in ("still", "loaded")
    }
    others["stated"] = {name: x for name, x in stated.items() if x is not None}
    write_channels(path, channels, always | {name: content for name, content in others.items() if content})


def plain(value: Any) -> Any:
    """Data classes, arrays and sequences in JSON's types, without entries that are None."""
    if is_dataclass(value):
        return {each.name: plain(x) for each in data_fields(value) if (x := getattr(value, each.name)) is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(x) for key, x in value.items()}
    return list(map(plain, value)) if isinstance(value, list | tuple) else value


def load(path: Path, samples: int, *, limit: int) -> Iterator[dict[str, Any]]:
    """Reads a file piece by piece and yields the fields of a recording, by name.

    Args:
        path: A `.csv`, `.tsv`, `.txt` or `.npz` file.
        samples: Samples of each piece; the last one may have fewer.
        limit: Bytes that an archive may take in memory, as for `limits.check_size`.

    Raises:
        LogError: The file is missing or not a recording; raised when the faulty piece is read.
    """
    last = -np.inf
    for piece in read_tables(path, samples, truth=True, limit=limit):
        if "time" not in piece.cells:
            raise LogError(f"a recording needs a column 'time'; {piece.available()}.")
        channels = piece.channels()
        if not (increases := np.diff(channels["time"], prepend=last) > 0).all():
            raise LogError(f"{piece.row(int(np.argmin(increases)))}, column 'time' needs to increase.")
        last = channels["time"][-1]
        yield _fields(channels, piece.metadata)
    if last == -np.inf:
        raise LogError("a recording needs samples, it has none.")


def _fields(channels: dict[str, np.ndarray], metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a recording from the channels and the metadata of a file."""
    time, base = channels.pop("time"), channels.pop(BASE, None)
    true = {name.removeprefix(TRUE): x for name, x in channels.items() if name.startswith(TRUE)}
    measured = {name: x for name, x in channels.items() if not name.startswith(TRUE)}
    if base is not None and base.shape[1:] == (16,):
        base = base.reshape(-1, 4, 4)
    return {"time": time, "measured": measured, "true": true, "base": base} | annotations(metadata)


def annotations(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a recording other than channels from the metadata of a file."""
    out = {name: value_of(name, metadata[name], TYPES.get(name, Any)) for name in METADATA if name in metadata}
    for body, known in out.get("known_bodies", {}).items():
        checked_deviations(f"known.{short(body)}", known, OF_BODIES, LogError)
    return out | vars(out.pop("stated", Stated()))


TERM = ("column", "columns", "weights", "gain", "constant")
"""Keys of the entry of a computed column, except for its unit."""

OWNERS = ("motors", "joints")
"""Owners that friction and rotors of coupled motors may have; the first is the default."""


def single(where: str, entry: Any, quantity: str) -> Columns:
    """One column, `"NAME"` or `{ column = "NAME", unit = "UNIT" }`, perhaps with a gain, or a sum, or a constant."""
    if isinstance(entry, str):
        return Columns((entry.strip(),))
    entry = {"constant": entry} if a_number(entry) and quantity.endswith(" position") else entry
    check_keys(where, table(where, entry), (*TERM, "unit"))
    current = CURRENT.get(str(entry.get("unit"))) if quantity.endswith(" torque") else None
    if current is not None and "gain" not in entry:
        raise LogError(f"{where} in {entry['unit']} needs a gain, in the joint's N m (of a slide N) for each ampere.")
    name, sums = _term(where, entry, current or 1.0)
    unit = factor_of(where, entry, "unit", quantity) if current is None else (1.0, next(iter(UNITS[quantity])))
    return Columns((name,), *unit, sums)


def _term(where: str, entry: Mapping[str, Any], factor: float = 1.0) -> tuple[str, tuple[Sum, ...]]:
    """Name of a column and, if it is computed, its sum: factor · gain · Σ weight · column + constant."""
    if entry.keys() & set(TERM) == {"constant"}:
        alone = Sum((), (), factor * value_of(f"{where}.constant", entry["constant"], float))
        return alone.name, (alone,)
    given: Any = entry["columns"] if "columns" in entry else [entry.get("column")]
    if "column" in entry and "columns" in entry:
        raise LogError(f"{where} needs a column or several columns, got both.")
    if "weights" in entry and "columns" not in entry:
        raise LogError(f"{where} has weights, which are for several columns; one has a gain.")
    if not isinstance(given, list) or not given or not all(isinstance(name, str) for name in given):
        raise LogError(f"{where} needs the name of a column, got {short(entry.get('columns', entry.get('column')))}.")
    names = [name.strip() for name in given]
    gain, constant = (
        value_of(f"{where}.{key}", entry.get(key, usual), float) for key, usual in (("gain", 1), ("constant", 0))
    )
    if len(names) == 1 and factor * gain == 1 and constant == 0 and "weights" not in entry:
        return names[0], ()
    if not all(names) or len(set(names)) < len(names) or not gain:
        raise LogError(f"{where} needs names of different columns and a gain other than zero, got {short(entry)}.")
    weights = factor * gain * vector(f"{where}.weights", entry.get("weights", [1] * len(names)), len(names))
    if not weights.all():
        raise LogError(f"{where}.weights needs numbers other than zero, got {short(entry['weights'])}.")
    computed = Sum(tuple(names), tuple(weights.tolist()), constant)
    return computed.name, (computed,)


def several(where: str, names: Any, size: int, factor: float = 1.0, unit: str = "", *, gaps: bool = False) -> Columns:
    """Columns of a vector, each a name or an entry for `_term`; with gaps, "" stands for a missing one.

    Positions and quaternions may be constant numbers.
    """
    given = names if isinstance(names, list) else []
    if where.endswith((".position", ".quaternion")):
        given = [{"constant": each} if a_number(each) else each for each in given]
    if len(given) != size or not all(isinstance(name, str | dict) for name in given):
        raise LogError(f"{where} needs a list of {size} columns, got {short(names)}.")
    names = given
    for entry in names:
        check_keys(where, entry if isinstance(entry, dict) else {}, TERM)
    terms = [_term(where, entry) if isinstance(entry, dict) else (entry.strip(), ()) for entry in names]
    if not gaps and not all(name for name, _ in terms):
        raise LogError(f"{where} needs {size} columns, none of them may be missing; got {short(names)}.")
    return Columns(tuple(name for name, _ in terms), factor, unit, tuple(each for _, sums in terms for each in sums))


def factor_of(where: str, entry: Mapping[str, Any], key: str, quantity: str) -> tuple[float, str]:
    """Factor from the unit that an entry states to the SI unit, and the SI unit; 1 and "" if none is stated."""
    choices = UNITS[quantity]
    if key not in entry:
        return 1.0, ""
    if not isinstance(entry[key], str) or entry[key] not in choices:
        raise LogError(f"{where}.{key} needs one of {', '.join(choices)}; got {short(entry[key])}.")
    return choices[entry[key]], next(iter(choices))


def joints_of_motors(
    where: str, entry: Mapping[str, Any], joints: Mapping[str, str]
) -> tuple[dict[str, Columns], dict[str, dict[str, float]]]:
    """Columns of joints driven by motors, whose angles are `matrix` times joint coordinates, and the couplings."""
    check_keys(f"[{where}]", entry, ("joints", "matrix", "friction", *KINDS))
    moved = entry.get("joints")
    if not isinstance(moved, list) or not moved or any(joint not in joints for joint in moved):
        raise LogError(f"{where}.joints needs a list of joints, of {', '.join(joints)}; got {short(moved)}.")
    rows = entry.get("matrix")
    if not isinstance(rows, list) or len(rows) != len(moved):
        raise LogError(f"{where}.matrix needs a row for each of {len(moved)} motors, got {short(rows)}.")
    matrix = np.array([vector(f"{where}.matrix", row, len(moved)) for row in rows])
    columns = {}
    for kind in (kind for kind in KINDS if kind in entry):
        key, named = f"{where}.{kind}", entry[kind]
        if not isinstance(named, list) or len(named) != len(moved):
            raise LogError(f"{key} needs a list of {len(moved)} columns, got {short(named)}.")
        motors = [single(key, each, f"hinge {kind}") for each in named]
        if not all(motor.read for motor in motors):
            raise LogError(f"{key} needs {len(moved)} columns, none of them may be missing; got {short(named)}.")
        try:
            of_joints = joints_behind_motors(matrix, kind, motors)
        except LogError as error:
            raise LogError(f"[{where}] {error}") from None
        for joint, column in zip(moved, of_joints, strict=True):
            unit = next(iter(UNITS[f"{joints[joint]} {kind}"])) if all(motor.unit for motor in motors) else ""
            columns[f"joints.{joint}.{kind}"] = replace(column, unit=unit)
    return columns, couplings(where, entry, moved, matrix, joints)


def joints_behind_motors(matrix: np.ndarray, kind: str, motors: Sequence[Columns]) -> list[Columns]:
    """Columns of joints driven by coupled motors: q_motor = R q, so q = R⁻¹ q_motor and τ = Rᵀ τ_motor.

    Args:
        matrix: R, of motors by joints (n, n).
        kind: Quantity of the columns, `position`, `velocity`, `acceleration` or `torque`.
        motors: A column of each motor.

    Returns:
        A column of each joint, in SI units; the caller sets `unit`.

    Raises:
        LogError: R has no inverse.
    """
    if np.linalg.matrix_rank(matrix) < len(matrix):
        raise LogError(f"needs a matrix that can be inverted, got {matrix.tolist()}.")
    weights = matrix.T if kind == "torque" else np.linalg.inv(matrix)
    weights[np.abs(weights) < np.finfo(float).eps * np.abs(weights).max() * len(weights)] = 0
    return [combined(row, motors) for row in weights]


def couplings(
    where: str, entry: Mapping[str, Any], joints: Sequence[str], matrix: np.ndarray, taken: Iterable[str]
) -> dict[str, dict[str, float]]:
    """Rows of coupled motors by their names, `NAME 1`, `NAME 2`; empty where rotors and friction belong to the joints.

    They do where the mapping says so, and where every motor moves one joint.

    Args:
        where: Name of the motors' entry, `motors.NAME`.
        entry: The entry.
        joints: The joints.
        matrix: R of `q_motor = R q` (n, n).
        taken: Names that a motor must not have, those of all joints.

    Raises:
        LogError: `friction` is none of `OWNERS`, or a motor has the name of a joint.
    """
    owner = choice(f"{where}.friction", entry.get("friction", OWNERS[0]), OWNERS)
    if owner != OWNERS[0] or (np.count_nonzero(matrix, axis=1) < 2).all():
        return {}
    names = [f"{where.partition('.')[2]} {number}" for number in range(1, len(matrix) + 1)]
    if twice := [name for name in names if name in taken]:
        raise LogError(f"[{where}] has a motor '{twice[0]}', and a joint is named so too; rename the motors.")
    rows = ({joint: float(x) for joint, x in zip(joints, row, strict=True) if x} for row in matrix)
    return dict(zip(names, rows, strict=True))


def read_segments(path: Path) -> dict[str, Placed] | None:
    """Segments of a person by body, from `[segments]` of a mapping file; None if it has no such table.

    Raises:
        LogError: The file is missing or malformed.
    """
    if path.suffix.lower() == ".xml":
        return None
    entries = toml(path, "a mapping of columns needs")
    with about(path):
        return segments_of(entries["segments"]) if "segments" in entries else None


def segments_of(entries: Any) -> dict[str, Placed]:
    """Segments by body, from entries `BODY = "SEGMENT"` or tables with the segment and its ends."""
    given = {body: {"segment": x} if isinstance(x, str) else x for body, x in table("segments", entries).items()}
    return {body: made(Placed, f"segments.{body}", entry) for body, entry in given.items()}
