"""The channels of a log in SI units: columns by the mapping, or else by their names, as those of wrenches."""

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import LogError
from ident.files.column import BALL, COMMAND, KINDS, UNITS, Columns
from ident.files.table import BASE, Table, listed, short
from ident.geometry.se3 import without_jumps
from ident.recordings.faults import turns_of, with_continuous_angles
from ident.recordings.followers import moved, with_followers
from ident.recordings.mapping import STATED, ColumnMapping, check_no_column_twice
from ident.recordings.standing import about_origins
from ident.recordings.stated import TRACKED, annotations
from ident.recordings.times import AS_MEASURED, POSES
from ident.recordings.wrench import GROUND, Sensor
from ident.tolerances import HUGE

_WHOSE = r"([\W_\d]*|(?:[\W_]+[a-z\d]+)+?[\W_]+)"
_NUMBER, _AXIS = r"([\W_\d]*)", r"[\W_]*([xyz])(?![a-z])"

WORDS = (
    ("torque", rf"(?:force|grf){_WHOSE}m{_AXIS}"),
    ("point", rf"(?:force|grf){_WHOSE}p{_AXIS}"),
    ("force", rf"(?:force|grf|kraft){_WHOSE}v?{_AXIS}"),
    ("torque", rf"(?<![a-z])(?:ft[\W_]*r|[mt]t){_NUMBER}{_AXIS}"),
    ("force", rf"(?<![a-z])ft{_NUMBER}{_AXIS}"),
    ("force", rf"(?<![a-z])f{_NUMBER}v?{_AXIS}"),
    ("torque", rf"(?:torque|drehmoment|moment|grm){_WHOSE}m?{_AXIS}"),
    ("torque", rf"(?<![a-z])[mt]{_NUMBER}{_AXIS}"),
    ("point", rf"(?:cop|point){_WHOSE}p?{_AXIS}"),
    ("point", rf"(?<![a-z])(?=p){_NUMBER}p?{_AXIS}"),
)
"""Patterns of the names of components in lower case: a word, perhaps a number or an owner, and an axis. OpenSim calls
the components of a force vx, vy and vz, those of its point of application px, py and pz; AddBiomechanics calls those of
a moment mx, my and mz. Drivers of force-torque sensors write FTx and MTx, or FT_X and FT_RX."""

SIX = re.compile(r"(?<![a-z])f[\W_]?t(?![a-z])|wrench|force[\W_]*torque|tcp[\W_]*force|f[\W_]?t[\W_]*sens")
THREE = {"force": re.compile(r"(?<![a-z])(?:forces?|kraft|f)(?![a-z])"), "torque": re.compile(r"torques?|moments?")}
"""Words of series of numbers: three forces and three moments in one, as `FT0` to `FT5`, or in two."""

Component = tuple[str, str]
"""Quantity, a kind of `WORDS`, and axis."""


SIX_KEYS: tuple[Component, ...] = tuple((kind, axis) for kind in ("force", "torque") for axis in "xyz")
"""Components in the order of their numbers."""

PARTS = ("force", "torque")
"""Quantities of a wrench; moments are about the origin."""

JOINT_TORQUE = r"torque|moment|effort|(?<![a-z])(tau|trq|t)(?![a-z])"
"""Pattern of the names of joint torques, in lower case."""

ALIKE = 0.85
"""Similarity from which a name is taken as another one, misspelt."""

PLACE = "in a file for --columns or by columns= in Python"
"""Place of a mapping, for messages."""


def wrench_groups(names: Sequence[str]) -> dict[str, dict[Component, str]]:
    """Columns by the common part of the names of one wrench, and by component."""
    groups: dict[str, dict[Component, str]] = {}
    for name in names:
        for kind, pattern in WORDS:
            if match := re.search(pattern, name.lower()):
                whose = "_".join(re.findall(r"[a-z\d]+", match[1]))
                rest = f"{name[: match.start()]}|{whose}|{name[match.end() :]}"
                groups.setdefault(rest, {}).setdefault((kind, match[2]), name)
                break
    return {**groups, **_numbered([name for name in names if not any(name in own.values() for own in groups.values())])}


def _numbered(names: Sequence[str]) -> dict[str, dict[Component, str]]:
    """Wrenches whose components are numbered: six of one series, or three forces and three moments of two."""
    series: dict[tuple[str, str], dict[int, str]] = {}
    for name in names:
        if match := re.fullmatch(r"(.*?)(\d{1,6})(\D*)", name.lower()):
            series.setdefault((match[1], match[3]), {})[int(match[2])] = name
    groups: dict[str, dict[Component, str]] = {}
    for (stem, end), own in series.items():
        columns = [own[k] for k in sorted(own)]
        if max(own) - min(own) + 1 != len(own):
            continue
        if len(own) == 6 and SIX.search(stem):
            groups[stem.strip("[_. /") + end.strip("])_. /")] = dict(zip(SIX_KEYS, columns, strict=True))
        for kind, pattern in THREE.items() if len(own) == 3 else ():
            if match := pattern.search(stem):
                rest = f"{stem[: match.start()]}|{stem[match.end() :]}{end}"
                groups.setdefault(rest, {}).update({(kind, x): c for x, c in zip("xyz", columns, strict=True)})
    return {rest: own for rest, own in groups.items() if len(own) == 6}


def suggested_mapping(columns: Sequence[str], joints: Sequence[str]) -> str:
    """Message on the unused columns of a log, with a mapping for those that look like a wrench or joint torques.

    Args:
        columns: Names of the unused columns.
        joints: Names of the mechanism's joints.

    Returns:
        A sentence, followed by lines of TOML if there is something to suggest.
    """
    names = [name for name in columns if name == name.strip() and name.isprintable()]
    lines = _ground(names) or _torques(names, [joint for joint in joints if joint.isprintable()])
    plain = [" ".join(name.split()) for name in columns]
    there = f"Besides times, joint states and what is empty it has {'the' if columns else 'no'} columns"
    there += f" {listed(plain)}" if columns else ""
    if not lines:
        return f"{there}; none is named like a wrench or a torque: map what is one, {PLACE}."
    wrist = " (`multicontact columns` tells if a sensor at a wrist measures them)" if "wrenches" in lines[0] else ""
    return "\n".join([f"{there}; these lines, {PLACE}, would use those that look like it{wrist}:", *lines])


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


def _ground(names: Sequence[str]) -> list[str]:
    """Lines for the most complete wrench among the columns."""
    groups = wrench_groups(names).values()
    wrenches = ({key: name for key, name in group.items() if key[0] in PARTS} for group in groups)
    if not (best := max(wrenches, key=len, default={})):
        return []
    listed = {kind: ", ".join(_quoted(best.get((kind, axis), "")) for axis in "xyz") for kind in PARTS}
    return ["[wrenches.ground]", *(f"{kind} = [{columns}]" for kind, columns in listed.items())]


def _torques(names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Lines for the joints' torques: by the joints' names, or in order if there are as many."""
    torques = [name for name in names if re.search(JOINT_TORQUE, name.lower().replace("_", " "))]
    columns: dict[str, str] = {}
    for joint in sorted(joints, key=len, reverse=True):
        if own := [name for name in torques if joint.lower() in name.lower() and name not in columns.values()]:
            columns[joint] = own[0]
    if not columns and len(torques) == len(joints):
        columns = dict(zip(joints, torques, strict=True))
    return [line for joint in joints if joint in columns for line in _torque_lines(joint, columns[joint])]


def _torque_lines(joint: str, column: str) -> tuple[str, str]:
    key = joint if re.fullmatch(r"[A-Za-z0-9_-]+", joint) else _quoted(joint)
    return f"[joints.{key}]", f"torque = {_quoted(column)}"


def _quoted(text: str) -> str:
    """The text as a TOML string; for names of columns JSON writes the same."""
    return json.dumps(text, ensure_ascii=False)


SUGGESTION = " `multicontact columns MODEL LOG` writes a mapping to correct; in Python, columns= takes one."
"""Advice for logs whose columns cannot be assigned by name."""


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
    whole, depends = mapping.mechanism, set[str]()
    if whole:
        depends = {*whole.tree.joints} - {*moved(replace(mapping, columns=columns), whole).tree.joints}
    for joint, joint_kind in joints.items():
        if not all(columns[f"joints.{joint}.position"].names) and joint not in (*mapping.followers, *depends):
            names, ball = ", ".join(p.format(joint) for p in KINDS["position"]), joint_kind == "ball"
            raise NoPositionError(
                f"joint '{joint}' needs {'columns' if ball else 'a column'} of its positions, named {names} "
                f"{'with .w, .x, .y and .z ' if ball else ''}or mapped; {table.available()}. "
                f"Where it does not move, --fix {shlex.quote(joint)} [VALUE] leaves it out (fix= of mc.mechanism)."
                f"{suggestion}"
            )
    if not columns["time"].names[0]:
        raise LogError(
            "a log needs a column of times, named time or t or mapped, or in the mapping its samples per second, as in "
            f"rate = 100; {table.available()}.{POSES}{suggestion}"
        )
    for sensor, place in {GROUND: Sensor(), **stated.get("sensors", {})}.items():
        parts = {
            f"wrenches.{sensor}.{kind}": tuple(
                _named(table, f"the {kind} of '{sensor}'", (f"{sensor}_{kind}.{c}", f"{sensor}_{letter}{c}"))
                for c in "xyz"
            )
            for kind, letter in (("force", "f"), ("torque", "m"))
        }
        if sensor not in sensors and any(map(any, parts.values())):
            columns |= {key: Columns(names) for key, names in parts.items()}
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
    table = with_continuous_angles(table, mapping.turns, notes)
    for key, columns in mapping.columns.items():
        if not table.memory.turned.keys().isdisjoint(columns.read):
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
