"""The mapping of a log's columns to quantities and units, from a TOML file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs
from ident.arguments import OF_BODIES, by_joint, checked_deviations, checked_rpy
from ident.errors import LogError, about
from ident.files.csv_file import Layout
from ident.files.limits import check_keys, choice, made, pose, table, toml, value_of
from ident.files.table import BALL, COUNT, EPOCH, KINDS, Columns, Sum, Table, short
from ident.mechanism.body import Follower
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings import plates
from ident.recordings.plates import LOADS, Plate, external_loads
from ident.recordings.stated import (
    GAINS,
    SCALES,
    Servo,
    Tracker,
    factor_of,
    joints_of_motors,
    scale_of,
    segments_of,
    servo_of,
    several,
    single,
)
from ident.recordings.wrench import Sensor
from ident.setup import ANGLE, LARGEST, SETUP

DEVIATIONS = {
    f"{kind}{row.unit.suffix}": row.unit.stated
    for kind, row in sorted(SETUP.items(), key=lambda item: item[1].unit.suffix)
    if not row.stated
}
"""Set-up errors whose standard deviation may be stated, those in degrees last; factors to SI and radians."""

FRAMES = ("markers", "frame")
"""Frames of a tracked body that may be stated."""

KNOWN = dict.fromkeys(OF_BODIES, 1.0)
"""Body parameters whose standard deviation may be stated: relative to the model's, m, relative."""

STATED = (
    *("setup", "known", "known_bodies", "held", "base_rpy_deg", "still", "loaded"),
    *("scales", "couplings", "followers", "trackers"),
)
"""Fields of a mapping that are those of its recordings, beside sensors and servos."""


Span = Annotated[tuple[float, float], Needs("two numbers, the first before the last", lambda x: x[0] < x[1])]
"""First and last, both included."""

Rate = Annotated[float, Needs("a number of samples per second, in Hz", lambda x: x >= 1e-3)]
"""Rate of a log without times; a slower one is a unit that is wrong."""


@dataclass(frozen=True)
class Selection:
    """Spans of rows and of times; without any, everything is selected.

    Attributes:
        rows: Spans of rows, numbered as in messages.
        time: Spans of times, s.
    """

    rows: tuple[Span, ...] = ()
    time: tuple[Span, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.rows or self.time)

    def of(self, table: Table, clock: Columns) -> Table:
        """The samples of a table in one of the selected spans of rows, and in one of those of times.

        Args:
            table: The table.
            clock: Its column of times; spans are of times counted from the first one if that is beyond `EPOCH`.

        Raises:
            LogError: There is none.
        """
        if self.rows:
            numbers = np.asarray(table.rows)
            there = f"{table.word}s {numbers[0]} to {numbers[-1]}" if len(numbers) else "none"
            table = _inside(table, "rows", numbers, self.rows, f"the {table.origin} has {there}")
        if self.time and len(table.rows):
            (name,) = clock.names
            seconds = table.column(name) * clock.factor
            seconds -= seconds[0] if abs(seconds[0]) > EPOCH else 0.0
            there = f"its times go from {seconds.min():g} s to {seconds.max():g} s"
            table = _inside(table, "times", seconds, self.time, there)
        return table


def _inside(table: Table, what: str, x: np.ndarray, spans: Sequence[Span], there: str) -> Table:
    """The samples of a table where numbers (N,) are in one of some spans."""
    kept = np.any([(first <= x) & (x <= last) for first, last in spans], axis=0)
    if not kept.any():
        asked = ", ".join(f"{first:g} to {last:g}" for first, last in spans)
        raise LogError(f"[select] needs {what} that the {table.origin} has, got {asked}; {there}.")
    return table.where(kept)


@dataclass
class ColumnMapping:
    """Columns of each quantity of a log, and what the mapping file states of sensors, set-up and files.

    Attributes:
        columns: Columns by `time`, `joints.NAME.KIND`, `wrenches.NAME.force`, `wrenches.NAME.torque`, and
            `base.position` and `base.quaternion`, or `base.pose`; `tracked.NAME.position`, `tracked.NAME.orientation`.
        sensors: Sensors of the wrenches by name; `trackers` those of tracked bodies.
        plates: Those of them that rest in the world, by name.
        held: True if something holds the base, as for `Recording`; likewise `base_rpy_deg`.
        servos: Servos of commanded joints, as for `Recording`.
        scales: Uncertainties of the scales of torques, as for `Recording`.
        couplings: Motors that move several joints together, as for `Recording`.
        setup: Standard deviations of set-up errors, as for `Recording`.
        known: Standard deviations of the model's φ, as for `Recording`; `known_bodies` those of single bodies.
        still: True if rows are poses at rest, as for `Recording`; likewise `loaded`.
        followers: Joints that follow another one; until columns are complete, those that do if they have none.
        mechanism: The mechanism, whose loops may determine joints without columns.
        clocks: Columns of times, one for each file, if they are stated one by one.
        layouts: Layouts of text files, one for all or one for each.
        selection: Rows and times that are selected.
        of_fixed: Columns of joints that are fixed, which are not read.
        turns: Numbers that may be a whole turn, by columns of angles, as for `with_continuous_angles`.
    """

    columns: dict[str, Columns] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)
    trackers: dict[str, Tracker] = field(default_factory=dict)
    setup: dict[str, float] = field(default_factory=dict)
    known: dict[str, float] = field(default_factory=dict)
    known_bodies: dict[str, dict[str, float]] = field(default_factory=dict)
    plates: dict[str, Plate] = field(default_factory=dict)
    held: bool | None = None
    base_rpy_deg: tuple[float, ...] | None = None
    servos: dict[str, Servo] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    couplings: dict[str, dict[str, float]] = field(default_factory=dict)
    still: bool = False
    loaded: str = ""
    followers: Mapping[str, Follower] = field(default_factory=dict)
    mechanism: Mechanism | None = None
    clocks: tuple[Columns, ...] = ()
    layouts: tuple[Layout, ...] = (Layout(),)
    selection: Selection = field(default_factory=Selection)
    of_fixed: tuple[str, ...] = ()
    turns: dict[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def used(self) -> set[str]:
        """Names of all columns that are mapped."""
        return {name for columns in self.columns.values() for name in columns.read}

    @property
    def sums(self) -> dict[str, Sum]:
        """All columns that are computed from others, by name."""
        return {each.name: each for columns in self.columns.values() for each in columns.sums}


def joint_kinds(tree: Tree) -> dict[str, str]:
    """Kind of each joint, `hinge`, `slide` or `ball`, by name."""
    bodies = [tree.bodies[i] for i in tree.moving]
    return {body.joint: "ball" if body.is_ball else "hinge" if body.turns else "slide" for body in bodies}


def read_mapping(path: Path, tree: Tree) -> ColumnMapping:
    """Reads a mapping file, or OpenSim's ExternalLoads if its name ends in `.xml`.

    Raises:
        LogError: The file is missing or malformed, or names joints or bodies that the mechanism does not have.
    """
    loads = path.suffix.lower() == LOADS
    entries = external_loads(path, tree.names) if loads else toml(path, "a mapping of columns needs")
    with about(path):
        return stated_mapping(entries, tree)


def stated_mapping(entries: Mapping[str, Any], tree: Tree) -> ColumnMapping:
    """Mapping of columns that the content of a mapping file states.

    Raises:
        LogError: It is malformed, or names joints or bodies that the mechanism does not have.
    """
    bodies, of_rows = tree.names, ("time", "rate", "poses")
    tables = (*of_rows, "joints", "motors", "wrenches", "base", "load", "setup", "known", "file", "select", "segments")
    check_keys("the mapping", entries, (*tables, "tracked"))
    segments_of(entries.get("segments", {}))
    known, known_bodies = _known(entries, bodies)
    setup = _deviations("setup", entries, DEVIATIONS | {f"centre({joint})": 1.0 for joint in tree.compounds})
    mapping = ColumnMapping(setup=setup, known=known, known_bodies=known_bodies)
    mapping.layouts, mapping.selection = layouts(entries), selection(entries)
    times, poses = clocks(entries), entries.get("poses", False)
    mapping.still = value_of("poses", poses, bool, "true, if each row is a pose at rest, or false")
    # Of poses rows need an order alone, whatever is stated of times.
    times = (clock_of_rate("poses", 1.0),) if mapping.still else times
    mapping.columns |= {"time": times[0]} if len(times) == 1 else {}
    mapping.clocks = times if len(times) > 1 else ()
    if "load" in entries:
        check_keys("[load]", table("load", entries["load"]), ("body",))
        mapping.loaded = choice("load.body", entries["load"].get("body"), bodies)
    _add_joints(mapping, entries, tree)
    for name, entry in table("wrenches", entries.get("wrenches", {})).items():
        mapping.columns |= plates.columns_of(f"wrenches.{name}", table(f"wrenches.{name}", entry))
        if plate := plates.plate(name, entry, bodies):
            mapping.plates[name] = plate
        mapping.sensors[name] = plates.sensor(name, entry, bodies, plate)
    for name, entry in table("tracked", entries.get("tracked", {})).items():
        _add_tracked(mapping, name, table(f"tracked.{name}", entry))
    if "base" in entries:
        _add_base(mapping, table("base", entries["base"]))
    # Joints that share a column of positions follow each other, which shows when all columns are known.
    check_no_column_twice({k: used for k, used in mapping.columns.items() if not k.startswith("joints.")})
    return _without_still(mapping, tree.still)


def layouts(entries: Mapping[str, Any]) -> tuple[Layout, ...]:
    """Layouts of text files: one for all from `[file]`, or one for each file from `[[file]]`.

    Raises:
        LogError: An entry is malformed; likewise for all functions here.
    """
    entry = entries.get("file", {})
    if not isinstance(entry, list):
        return (made(Layout, "file", entry),)
    return tuple(made(Layout, f"file {k}", each) for k, each in enumerate(entry, start=1)) or (Layout(),)


def clocks(entries: Mapping[str, Any]) -> tuple[Columns, ...]:
    """Columns of times: one for all files, or one for each; empty if the mapping has none."""
    if "rate" in entries:
        if "time" in entries:
            raise LogError("the mapping has time and rate; rate is for a log without times, keep one of them.")
        return (clock_of_rate("rate", entries["rate"]),)
    entry = entries.get("time", [])
    if not isinstance(entry, list):
        return (_clock("time", entry),)
    if "time" in entries and not entry:
        raise LogError("time needs the column of times of each file, got an empty list.")
    return tuple(_clock(f"time {k}", each) for k, each in enumerate(entry, start=1))


def _clock(where: str, entry: Any) -> Columns:
    """A column of times, or of sample counts for `{ rate = HZ }`."""
    if isinstance(entry, dict) and "rate" in entry:
        check_keys(where, entry, ("rate",))
        return clock_of_rate(f"{where}.rate", entry["rate"])
    return single(where, entry, "time")


def selection(entries: Mapping[str, Any]) -> Any:
    """Rows and times that are selected."""
    entry = table("select", entries.get("select", {}))
    # One span `[FIRST, LAST]`, or a list of them.
    several = {key: isinstance(x, list) and all(isinstance(each, list) for each in x) for key, x in entry.items()}
    return made(Selection, "select", {key: x if several[key] else [x] for key, x in entry.items()})


def clock_of_rate(where: str, rate: Any) -> Columns:
    """The column of times of a file that has a rate instead.

    Args:
        where: Entry of the mapping, for the message.
        rate: Samples per second, Hz.

    Raises:
        LogError: The rate is no number or out of range.
    """
    return Columns((COUNT,), 1 / value_of(where, rate, Rate), "s")


def check_no_column_twice(columns: Mapping[str, Columns]) -> None:
    """Refuses a column that is mapped to two quantities; in sums with others it may occur any number of times."""
    users: dict[str, str] = {}
    for user, used in columns.items():
        for name in used.alone:
            if name in users:
                shared = all(each.startswith("joints.") and each.endswith(".position") for each in (user, users[name]))
                hint = " Joints that share it, as coupled fingers, need it under [joints] each." * shared
                raise LogError(f"column '{name}' is mapped to {users[name]} and to {user}; it can be one only.{hint}")
            users[name] = user


def _without_still(mapping: ColumnMapping, still: Sequence[str]) -> ColumnMapping:
    """The mapping without what motors state of joints that are fixed."""
    columns = {key: used for key, used in mapping.columns.items() if key[7:].rpartition(".")[0] not in still}
    rows = {motor: {j: x for j, x in row.items() if j not in still} for motor, row in mapping.couplings.items()}
    return replace(mapping, columns=columns, couplings={motor: row for motor, row in rows.items() if row})


def _columns_in(entry: Any) -> list[Any]:
    """Names of columns, and numbers, in an entry of a joint, which is not checked."""
    if isinstance(entry, dict):
        entry = [value for key, value in entry.items() if key not in ("unit", "weights")]
    return [name for each in entry for name in _columns_in(each)] if isinstance(entry, list) else [entry]


def _deviations(name: str, entries: Mapping[str, Any], factors: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations by kind, of centres by joint, too; zero or false for what is exactly as stated."""
    entry = by_joint(table(name, entries.get(name, {})), "centre")
    check_keys(f"[{name}]", entry, tuple(factors))
    kinds = {key: key.partition("(")[0].removesuffix(ANGLE.suffix) for key in factors}
    most = {key: LARGEST[kind] / factors[key] for key, kind in kinds.items() if kind in LARGEST}
    deviations = checked_deviations(name, entry, factors, LogError, most)
    return {key.removesuffix(ANGLE.suffix): value * factors[key] for key, value in deviations.items()}


def _known(entries: Mapping[str, Any], bodies: Sequence[str]) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Standard deviations of all bodies, and of those that have a table of their own."""
    entry = table("known", entries.get("known", {}))
    own = {name: each for name, each in entry.items() if isinstance(each, dict)}
    if absent := [name for name in own if name not in bodies]:
        raise LogError(f"[known.{short(absent[0])}] needs the name of a body, one of {', '.join(bodies)}.")
    known = _deviations("known", {"known": {key: x for key, x in entry.items() if key not in own}}, KNOWN)
    return known, {name: _deviations(f"known.{name}", {f"known.{name}": each}, KNOWN) for name, each in own.items()}


def _add_joints(mapping: ColumnMapping, entries: Mapping[str, Any], tree: Tree) -> None:
    """Adds columns, gains and scales of joints, and of motors that move several, to a mapping."""
    joints, of_joints = joint_kinds(tree), table("joints", entries.get("joints", {}))
    still = (name for joint in tree.still for name in _columns_in(of_joints.get(joint, {})))
    mapping.of_fixed = tuple(name for name in still if isinstance(name, str))
    check_keys("[joints]", of_joints, (*joints, *tree.still))
    for joint, quantities in ((joint, of_joints[joint]) for joint in of_joints if joint in joints):
        ball = joints[joint] == "ball"
        keys = KINDS if ball else (*KINDS, "command", *GAINS, *SCALES)
        check_keys(f"[joints.{joint}]", table(f"joints.{joint}", quantities), tuple(keys))
        mapping.servos |= servo_of(joint, quantities)
        mapping.scales |= scale_of(joint, quantities)
        for kind, entry in ((key, x) for key, x in quantities.items() if key not in (*GAINS, *SCALES)):
            key, quantity = f"joints.{joint}.{kind}", f"{joints[joint]} {kind}"
            columns = several(key, entry, len(BALL[kind])) if ball else single(key, entry, quantity)
            mapping.columns[key] = columns
    with_axes = dict.fromkeys(tree.still, "hinge") | {joint: kind for joint, kind in joints.items() if kind != "ball"}
    for name, entry in table("motors", entries.get("motors", {})).items():
        of_motors, couplings = joints_of_motors(f"motors.{name}", table(f"motors.{name}", entry), with_axes)
        mapping.couplings |= couplings
        for key, columns in of_motors.items():
            if key in mapping.columns:
                raise LogError(f"{key} is mapped twice, under [joints] and by motors; it can be one only.")
            mapping.columns[key] = columns


def _add_base(mapping: ColumnMapping, entry: Mapping[str, Any]) -> None:
    """Adds orientation and columns of the base to a mapping."""
    check_keys("[base]", entry, ("position", "quaternion", "unit", "held", "rpy_deg"))
    if "rpy_deg" in entry:
        mapping.base_rpy_deg = checked_rpy("base.rpy_deg", entry["rpy_deg"], LogError)
    mapping.held = value_of("base.held", entry.get("held"), bool | None)
    if entry.keys() - {"held", "rpy_deg"}:
        length = factor_of("base", entry, "unit", "length")
        mapping.columns["base.position"] = several("base.position", entry.get("position"), 3, *length)
        mapping.columns["base.quaternion"] = several("base.quaternion", entry.get("quaternion"), 4)


def _add_tracked(mapping: ColumnMapping, name: str, entry: Mapping[str, Any]) -> None:
    """Adds a tracked body with the frames that are stated, and its columns of position and orientation."""
    where, length = f"tracked.{name}", factor_of(f"tracked.{name}", entry, "unit", "length")
    keys = ("body", "position", "unit", "quaternion", "rotation_vector", "rotation_unit", *FRAMES)
    check_keys(f"[{where}]", entry, keys)
    if ("quaternion" in entry) == ("rotation_vector" in entry):
        raise LogError(f"[{where}] needs columns of either a quaternion or a rotation_vector, beside the position.")
    kind, size = ("quaternion", 4) if "quaternion" in entry else ("rotation_vector", 3)
    unit = factor_of(where, entry, "rotation_unit", "hinge position") if size == 3 else (1.0, "")
    mapping.columns[f"{where}.position"] = several(f"{where}.position", entry.get("position"), 3, *length)
    mapping.columns[f"{where}.orientation"] = several(f"{where}.{kind}", entry[kind], size, *unit)
    frames = {key: pose(f"{where}.{key}", table(f"{where}.{key}", entry[key])) for key in FRAMES if key in entry}
    mapping.trackers[name] = Tracker(value_of(f"{where}.body", entry.get("body", name), str), **frames)
