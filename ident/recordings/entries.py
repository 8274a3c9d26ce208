"""Entries of a mapping file: rows and times, layouts of files, columns, joints behind motors, segments of a person."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs
from ident.arguments import is_number
from ident.errors import LogError, about
from ident.files.column import CURRENT, KINDS, UNITS, Columns, Sum, joints_behind_motors
from ident.files.csv_file import Layout
from ident.files.limits import check_keys, choice, made, table, toml, value_of, vector
from ident.files.table import Table, short
from ident.parameters.person_prior import Placed
from ident.recordings.plates import LOADS

EPOCH = 1e6
"""First time above which a clock counts from an epoch, s; such times are counted from the first sample instead."""

Span = Annotated[tuple[float, float], Needs("two numbers, the first before the last", lambda x: x[0] < x[1])]
"""First and last, both included."""

COUNT = "(number of the sample)"
"""Name of the column of sample counts from zero; no file has it."""

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


def selected(table: Table, selection: Selection, clock: Columns) -> Table:
    """The samples of a table in one of the selected spans of rows, and in one of those of times.

    Args:
        table: The table.
        selection: The spans; of times counted from the first one if that is beyond `EPOCH`.
        clock: Its column of times.

    Raises:
        LogError: There is none.
    """
    if selection.rows:
        numbers = np.asarray(table.rows)
        there = f"{table.word}s {numbers[0]} to {numbers[-1]}" if len(numbers) else "none"
        table = _inside(table, "rows", numbers, selection.rows, f"the {table.origin} has {there}")
    if selection.time and len(table.rows):
        (name,) = clock.names
        seconds = table.column(name) * clock.factor
        seconds -= seconds[0] if abs(seconds[0]) > EPOCH else 0.0
        there = f"its times go from {seconds.min():g} s to {seconds.max():g} s"
        table = _inside(table, "times", seconds, selection.time, there)
    return table


def _inside(table: Table, what: str, x: np.ndarray, spans: Sequence[Span], there: str) -> Table:
    """The samples of a table where numbers (N,) are in one of some spans."""
    kept = np.any([(first <= x) & (x <= last) for first, last in spans], axis=0)
    if not kept.any():
        asked = ", ".join(f"{first:g} to {last:g}" for first, last in spans)
        raise LogError(f"[select] needs {what} that the {table.origin} has, got {asked}; {there}.")
    return taken(table, kept)


def taken(table: Table, kept: np.ndarray) -> Table:
    """The samples of a table where a mask is true (N,)."""
    samples = np.flatnonzero(kept).tolist()
    cells = {
        name: cells[samples] if isinstance(cells, np.ndarray) else [cells[i] for i in samples]
        for name, cells in table.cells.items()
    }
    return replace(table, cells=cells, rows=[table.rows[i] for i in samples])


def clock_of_rate(where: str, rate: Any) -> Columns:
    """The column of times of a file that has a rate instead.

    Args:
        where: Entry of the mapping, for the message.
        rate: Samples per second, Hz.

    Raises:
        LogError: The rate is no number or out of range.
    """
    return Columns((COUNT,), 1 / value_of(where, rate, Rate), "s")


def counted(tables: Iterable[Table], clock: Columns | None, overlap: int = 0) -> Iterator[Table]:
    """Pieces of a file, with a column of sample counts if the clock is a rate.

    Args:
        tables: The pieces, in order.
        clock: The mapping's column of times, None if it has none.
        overlap: Samples that each piece repeats from the end of the one before.
    """
    if clock is None or clock.names != (COUNT,):
        yield from tables
        return
    done = 0
    for piece in tables:
        first = max(0, done - overlap)
        done = first + len(piece.rows)
        yield replace(piece, cells={**piece.cells, COUNT: np.arange(first, done, dtype=float)})


TERM = ("column", "columns", "weights", "gain", "constant")
"""Keys of the entry of a computed column, except for its unit."""

OWNERS = ("motors", "joints")
"""Owners that friction and rotors of coupled motors may have; the first is the default."""

Factor = Annotated[float, Needs("a number other than 0", bool)]
Row = Annotated[Mapping[str, Factor], Needs("a number for each joint", bool)]
"""Row of a coupling, by joint, and a number in it."""


def single(where: str, entry: Any, quantity: str) -> Columns:
    """One column, `"NAME"` or `{ column = "NAME", unit = "UNIT" }`, perhaps with a gain, or a sum, or a constant."""
    if isinstance(entry, str):
        return Columns((entry.strip(),))
    entry = {"constant": entry} if is_number(entry) and quantity.endswith(" position") else entry
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
        given = [{"constant": each} if is_number(each) else each for each in given]
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


def couplings(
    where: str, entry: Mapping[str, Any], joints: Sequence[str], matrix: np.ndarray, taken: Collection[str] = ()
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
    if path.suffix.lower() == LOADS:
        return None
    entries = toml(path, "a mapping of columns needs")
    with about(path):
        return segments_of(entries["segments"]) if "segments" in entries else None


def segments_of(entries: Any) -> dict[str, Placed]:
    """Segments by body, from entries `BODY = "SEGMENT"` or tables with the segment and its ends."""
    given = {body: {"segment": x} if isinstance(x, str) else x for body, x in table("segments", entries).items()}
    return {body: made(Placed, f"segments.{body}", entry) for body, entry in given.items()}
