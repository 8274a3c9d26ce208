"""Checks of files: their size, the libraries that read them, their text as JSON or TOML, and entries of settings."""

import json
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import Point, as_array, fits, in_words, one_of
from ident.errors import InputError, LogError, not_installed
from ident.files.table import UNITS, short
from ident.tolerances import HUGE

LIMIT = 500_000_000
"""Default of the bytes that arrays may take in memory: a million samples of sixty channels."""

NUMBER = 8
"""Bytes of a number in memory; in the file it may be one byte."""

PIECE = 1 << 16
"""Bytes that are unpacked or received at a time, and that an empty array may claim by its other dimensions."""

LONGEST = 4_000_000
"""Characters of the longest line of a log, enough for a hundred thousand columns or for metadata in JSON."""

TOML = 1_000_000
"""Largest file of settings in bytes, whose entries take a hundred times as much."""

TOML_LINE = 20_000
"""Longest line of such a file: `tomllib` takes 100 bytes for every digit of a number."""

TOML_DEPTH = 32
"""Most names with dots between them in a key, of which `tomllib` keeps every beginning."""

_NAME = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_TOO_DEEP = re.compile(rf"(?<![\w-]){_NAME}(?:[ \t]*+\.[ \t]*+{_NAME}){{{TOML_DEPTH}}}")

SI = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
"""All known units, as factors to SI."""


def check_size(path: Path, size: int, limit: int) -> None:
    """Refuses a size in memory above a limit, unless the file itself is as large.

    Raises:
        LogError: The size exceeds the limit and `NUMBER` times the size of the file.
    """
    if size > max(limit, NUMBER * path.stat().st_size):
        raise LogError(
            f"the file takes {size / 1e6:.0f} MB in memory where at most {limit / 1e6:.0f} MB are expected of it; if "
            "it may be so large, say so (--max-size)."
        )


def parsed_json(text: str) -> Any:
    """Content of a JSON text from an archive or a file.

    Raises:
        ValueError: It is malformed, or so long that what it holds could take gigabytes.
        RecursionError: It is nested too deeply.
    """
    if len(text) > LONGEST:
        raise ValueError(f"JSON of {len(text) / 1e6:.0f} MB where at most {LONGEST / 1e6:g} MB are expected")
    return json.loads(text)


def toml(path: Path, needs: str) -> dict[str, Any]:
    """Entries of a TOML file.

    Args:
        path: The file.
        needs: What needs to be TOML, for messages, as "a study needs".

    Raises:
        LogError: It cannot be read, is malformed or beyond the limits.
    """
    try:
        with path.open("rb") as file:
            content = file.read(TOML + 1)
        if len(content) > TOML:
            raise ValueError(f"it has more than {TOML / 1e6:g} MB")
        text = content.decode("utf-8-sig")
        for number, line in enumerate(text.split("\n"), start=1):
            if len(line) > TOML_LINE or _TOO_DEEP.search(line):
                raise ValueError(
                    f"row {number} has more than {TOML_LINE} characters, or {TOML_DEPTH} names with dots between them"
                )
        return tomllib.loads(text)
    # Not all errors are the parser's own: Python refuses numbers of thousands of digits, and deep nesting.
    except (OSError, ValueError, RecursionError) as wrong:
        raise LogError(f"{path}: {needs} to be TOML in UTF-8 ({reason(wrong)}).") from None


def reason(error: object) -> str:
    """An error or its text as one line, short enough for a message."""
    if "allow_pickle" in str(error):
        return "pickled objects are not read"
    text = str(getattr(error, "strerror", None) or error).removesuffix(".")
    line = " ".join(text.split()) or type(error).__name__
    return line if len(line) <= 200 else f"{line[:197]}..."


@contextmanager
def library(extra: str, what: str = "This log") -> Iterator[None]:
    """Turns a failed import in a block into a sentence that names the extra to install.

    Args:
        extra: The extra.
        what: What needs it, for the message.

    Raises:
        InputError: The import failed.
    """
    try:
        yield
    except ImportError as error:
        raise InputError(f"{not_installed(what, error.name or str(error), extra)}.") from None


@contextmanager
def undamaged(what: str) -> Iterator[None]:
    """Turns any error that a library raises in a block into one sentence on the damaged file.

    Args:
        what: Kind of file that is needed, for the message.

    Raises:
        LogError: The block failed.
    """
    try:
        yield
    except LogError:
        raise
    # Each library has a dozen classes of errors for damage, and a damaged size may ask for any amount of memory.
    except Exception as error:
        raise LogError(f"the file needs to be {what} ({reason(error)}).") from error


def checked_rate(rate: float, what: str) -> float:
    """The rate in Hz, checked to be positive and finite.

    Raises:
        LogError: It is not.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise LogError(f"{what} needs to be positive, the file says {rate:g} Hz.")
    return float(rate)


WORDS: Mapping[Any, str] = {bool: "true or false", float: "a number", Point: "a list of 3 numbers"}
"""Types in words for readers of files, as far as they differ from Python's."""


def made(kind: Any, where: str, entry: Any, **known: Any) -> Any:
    """Data class of the entries of a table, each of them of its annotated type.

    Args:
        kind: The data class.
        where: Name of the table in messages, "" for a whole file.
        entry: The table.
        known: Fields that have no entry.

    Raises:
        LogError: It is no table, an entry is unknown, missing or of another type, or the class refuses it.
    """
    title, hints = f"[{where}]" if where else "the file", get_type_hints(kind, include_extras=True)
    own = [each for each in fields(kind) if each.name not in known]
    check_keys(title, table(where or title, entry), [each.name for each in own])
    needed = [each.name for each in own if each.default is MISSING and each.default_factory is MISSING]
    if missing := [name for name in needed if name not in entry]:
        raise LogError(f"{title} needs {', '.join(missing)}; it has {', '.join(map(short, entry)) or 'none'}.")
    values = {key: value_of(f"{where}.{key}".lstrip("."), x, hints[key]) for key, x in entry.items()}
    try:
        return kind(**known, **values)
    except InputError as error:
        raise LogError(f"{title} {error}") from None


def value_of(where: str, value: Any, hint: Any, words: str = "") -> Any:
    """Value of an annotated type: lists as tuples or arrays, tables as mappings or data classes.

    Args:
        where: Name of the entry in messages.
        value: The entry.
        hint: The annotation.
        words: What is needed, for messages; by default the type.

    Raises:
        LogError: The entry is of another type, no number below `HUGE`, or a condition does not hold.
    """
    origin, args = get_origin(hint) or hint, get_args(hint)
    if origin is Annotated:
        out = value_of(where, value, args[0], words or args[1].words)
        if args[1].holds(out):
            return out
    elif origin in (Union, UnionType) and NoneType in args:
        return None if value is None else value_of(where, value, args[0], words)
    elif is_dataclass(origin):
        return made(origin, where, value)
    elif origin is Mapping and isinstance(value, Mapping):
        return {key: value_of(f"{where}.{short(key)}", x, args[1], words) for key, x in value.items()}
    elif origin is tuple and isinstance(value, list) and (args[-1] is Ellipsis or len(args) == len(value)):
        kinds = args[:1] * len(value) if args[-1] is Ellipsis else args
        tables = [f" {k}" if is_dataclass(kind) else "" for k, kind in enumerate(kinds, start=1)]
        return tuple(value_of(where + at, x, kind, words) for at, x, kind in zip(tables, value, kinds, strict=True))
    elif origin is np.ndarray and isinstance(value, list) and (array := as_array(value)) is not None:
        if (np.abs(array) < HUGE).all():
            return array.astype(float)
    elif isinstance(origin, type) and origin not in (tuple, np.ndarray) and fits(value, hint):
        if origin is not float:
            return value
        if abs(value) < HUGE:
            return float(value)
    if origin is Mapping:
        words = words or ("a table of tables" if is_dataclass(args[1]) else "a table of entries")
    elif args and (is_dataclass(args[0]) or get_origin(args[0]) is Mapping):
        words = words or "a list of tables"
    needed = words or WORDS.get(hint) or in_words(hint)
    raise LogError(f"{where} needs {needed}{';' if ', ' in needed else ','} got {short(value)}{too_large(value)}.")


def too_large(value: Any) -> str:
    """End of a sentence on an entry if numbers of it are not below `HUGE`, else empty."""
    array = as_array([value])
    # Dates of a TOML file are objects of an array, as integers of many digits are.
    numbers = [] if array is None else [x for x in array.ravel().tolist() if isinstance(x, int | float)]
    return f"; numbers have to be below {HUGE:g}" if any(abs(x) >= HUGE for x in numbers) else ""


def choice(where: str, value: Any, choices: Collection[str]) -> str:
    """The value, checked to be one of the choices; raises as `value_of`."""
    return str(value_of(where, value, Annotated[str, one_of(choices)]))


def table(where: str, value: Any) -> Mapping[str, Any]:
    """The value, checked to be a table of entries.

    Raises:
        LogError: It is none; likewise for all functions here.
    """
    if not isinstance(value, dict):
        raise LogError(f"{where} needs a table of entries, got {short(value)}.")
    return value


def check_keys(where: str, entry: Mapping[str, Any], choices: Sequence[str]) -> None:
    """Refuses unknown keys."""
    for key in entry:
        if key not in choices:
            raise LogError(f"{where} has no entry '{short(key)}'; valid are {', '.join(choices) or 'none'}.")


def vector(where: str, value: Any, size: int) -> np.ndarray:
    """A list of `size` numbers as an array (size,)."""
    numbers = isinstance(value, list) and all(type(x) in (int, float) and abs(x) < HUGE for x in value)
    if not numbers or len(value) != size:
        raise LogError(f"{where} needs a list of {size} numbers, got {short(value)}{too_large(value)}.")
    return np.array(value, float)


def pose(where: str, entry: Mapping[str, Any]) -> np.ndarray:
    """Pose from an entry's `position` and its `quaternion` or `rpy_deg` (4, 4)."""
    if "quaternion" in entry and "rpy_deg" in entry:
        raise LogError(f"[{where}] needs a quaternion or rpy_deg, got both.")
    T = np.eye(4)
    T[:3, 3] = vector(f"{where}.position", entry.get("position", [0, 0, 0]), 3)
    if "rpy_deg" in entry:
        T[:3, :3] = Rotation.from_euler("xyz", vector(f"{where}.rpy_deg", entry["rpy_deg"], 3), True).as_matrix()
        return T
    quaternion = vector(f"{where}.quaternion", entry.get("quaternion", [1, 0, 0, 0]), 4)
    if not 0.99 < np.linalg.norm(quaternion) < 1.01:
        raise LogError(f"{where}.quaternion needs four numbers w, x, y, z of norm 1, got {quaternion.tolist()}.")
    T[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return T
