"""The registry: a TOML file for each public recording, and a columns file where it needs one."""

import re
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, get_type_hints

from experiments.data.registry import Entry, Published, Reference, Source, SourceFile
from experiments.studies.validation.converters import CONVERTERS
from experiments.studies.validation.options import check_columns, check_options
from ident.errors import InputError
from ident.files.limits import toml
from ident.files.table import short

KEYS = (
    *("title", "about", "folder", "tried", "note", "source", "files", "model", "fitted", "judged", "options"),
    *("published", "held_out", "reference", "alike"),
)
"""Entries of a recording's file."""

SHA256, COMMIT = re.compile(r"[0-9a-f]{64}"), re.compile(r"[0-9a-f]{7,40}")
"""Forms of hashes."""

NAME = re.compile(r"\w(?:[\w.+ -]{0,98}[\w+-])?", re.ASCII)
"""Form of the name of a file or folder, which no system takes for a path."""

REPOSITORY = re.compile(r"\w[\w.-]{0,99}/\w[\w.-]{0,99}", re.ASCII)
"""Form of a repository's name."""


def folder() -> Path:
    """Folder of the registry's files."""
    return Path(str(files("experiments.studies.validation").joinpath("recordings")))


def columns_file(name: str) -> Path:
    """Path of an entry's columns file."""
    return Path(str(files("experiments.studies.validation").joinpath("columns"))) / name


def registry(where: Path | None = None) -> dict[str, Entry]:
    """All entries by name, those that have been tried first.

    Args:
        where: Folder of the entries, by default that of this package.

    Raises:
        InputError: An entry is malformed, or has options that a user could not have known beforehand.
    """
    entries = [read_entry(path) for path in sorted((where or folder()).glob("*.toml"))]
    return {entry.name: entry for entry in sorted(entries, key=lambda entry: not entry.tried)}


def chosen(names: Sequence[str], entries: Mapping[str, Entry]) -> list[Entry]:
    """Entries by name, by default all.

    Raises:
        InputError: There is none of a name.
    """
    if unknown := [name for name in names if name not in entries]:
        raise InputError(f"Recordings are {', '.join(entries)}; got '{unknown[0]}'.")
    return [entry for name, entry in entries.items() if not names or name in names]


def read_entry(path: Path) -> Entry:
    """Reads the file of an entry, whose name it has.

    Raises:
        InputError: It is malformed; the message names the file and the entry.
    """
    entry = _entry(path.stem, toml(path, "an entry needs"))
    check_options(entry.name, entry.options)
    _check_hashes(entry)
    _check_logs(entry)
    if "columns" in entry.options:
        check_columns(columns_file(entry.options["columns"]))
    return entry


def _entry(name: str, content: Mapping[str, Any]) -> Entry:
    """Entry of a file's content, whose tables become objects."""
    for key in content:
        if key not in KEYS:
            raise InputError(f"{name}: an entry has no '{short(key)}'; valid are {', '.join(KEYS)}.")
    made: dict[str, Any] = dict(content)
    made["source"] = _of(Source, name, "source", content.get("source"))
    if "reference" in content:
        made["reference"] = _of(Reference, name, "reference", content["reference"])
    for key, kind in (("files", SourceFile), ("published", Published)):
        made[key] = tuple(_of(kind, name, key, each) for each in _list(name, key, content))
    for key in ("fitted", "judged", "alike"):
        made[key] = _names(name, key, content)
    return _of(Entry, name, "file", {"name": name, **made})


def _list(name: str, key: str, content: Mapping[str, Any]) -> list[Any]:
    given = content.get(key, [])
    if not isinstance(given, list) or not all(isinstance(each, dict | list) for each in given):
        raise InputError(f"{name}: '{key}' needs a list of tables or lists, got {short(given)}.")
    return given


def _names(name: str, key: str, content: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    """Lists of names."""
    given = _list(name, key, content)
    for each in given:
        if not isinstance(each, list) or not all(isinstance(x, str) for x in each):
            raise InputError(f"{name}: '{key}' needs lists of names, got {short(each)}.")
    return tuple(map(tuple, given))


KINDS: Mapping[Any, tuple[Any, str]] = {
    str: (str, "a text"),
    bool: (bool, "true or false"),
    int: (int, "a whole number"),
    float: (int | float, "a number"),
    Mapping[str, float]: (dict, "a table of numbers"),
    Mapping[str, Any]: (dict, "a table"),
}
"""Types of a value in TOML, and their name, by the type that an entry needs."""


def _of(kind: Callable[..., Any], name: str, key: str, given: Any) -> Any:
    """Object of a table, whose keys are the arguments of its class."""
    if not isinstance(given, dict):
        raise InputError(f"{name}: '{key}' needs a table, got {short(given)}.")
    hints = get_type_hints(kind)
    for each, value in given.items():
        types, needed = KINDS.get(hints.get(each), (object, ""))
        numbers = value.values() if hints.get(each) == Mapping[str, float] and isinstance(value, dict) else ()
        wrong = [x for x in numbers if not isinstance(x, int | float) or isinstance(x, bool)]
        if not isinstance(value, types) or (isinstance(value, bool) and types is not bool and needed) or wrong:
            raise InputError(
                f"{name}: '{each}' of its {key} needs {needed}, got {short(wrong[0] if wrong else value)}."
            )
    try:
        return kind(**given)
    except TypeError as error:
        raise InputError(f"{name}: '{key}' is incomplete or has unknown entries ({error}).") from None


def _check_hashes(entry: Entry) -> None:
    """Refuses malformed hashes, and hashes or published numbers of an untried recording."""
    name, source = entry.name, entry.source
    names = [entry.folder, *(file.name for file in entry.files), *filter(None, [entry.options.get("columns")])]
    paths = [part for file in entry.files if file.path for part in file.path.split("/")]
    if wrong := [each for each in (*names, *(part.replace(":", "_") for part in paths)) if not NAME.fullmatch(each)]:
        raise InputError(
            f"{name}: names and paths of files and folders stay in their folder and have at most 100 letters, digits, "
            f"'.', '+', '-', '_' and spaces, got {short(repr(wrong[0]))}."
        )
    if not REPOSITORY.fullmatch(source.repository):
        raise InputError(f"{name}: a repository is 'owner/name', got {short(source.repository)}.")
    if source.commit and not COMMIT.fullmatch(source.commit):
        raise InputError(f"{name} needs a commit of at least 7 hex digits, at most 40, got {short(source.commit)}.")
    for file in entry.files:
        for given in (file.sha256, file.original):
            if given and not SHA256.fullmatch(given):
                raise InputError(f"{name}: the SHA-256 of {file.name} has 64 hexadecimal digits, got {short(given)}.")
        if entry.tried != bool(file.sha256):
            state = "was tried and" if entry.tried else "is untried, and"
            raise InputError(f"{name} {state} {file.name} has {'' if file.sha256 else 'no '}hash.")
        for converter in filter(None, (file.made, file.converter)):
            if converter not in CONVERTERS:
                raise InputError(f"{name}: converters are {', '.join(CONVERTERS)}; got {short(converter)}.")


def _check_logs(entry: Entry) -> None:
    """Refuses logs and models of files that the entry does not list, and numbers of an untried recording."""
    names = [file.name for file in entry.files]
    if entry.tried and not entry.fitted:
        raise InputError(f"{entry.name} was tried, and says nothing of what is fitted.")
    if not entry.tried and (entry.published or entry.held_out or entry.reference):
        raise InputError(f"{entry.name} is untried, and has numbers to compare with.")
    used = [*([entry.model] if entry.tried else []), *(name for log in entry.logs for name in log)]
    if missing := [name for name in used if name not in names]:
        raise InputError(f"{entry.name} uses '{missing[0]}', which is not among its files.")
