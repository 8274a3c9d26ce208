"""The registry: a TOML file for each public recording, and a columns file where it needs one."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from experiments.data.registry import Entry, Published, Reference, Source, SourceFile
from ident.errors import InputError
from ident.files.limits import toml


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
        InputError: It is malformed; the message names the file. `tests/validation/test_registry.py` has further rules.
    """
    content = toml(path, "an entry needs")
    made: dict[str, Any] = {"name": path.stem}
    try:
        made["source"] = Source(**content["source"])
        if "reference" in content:
            made["reference"] = Reference(**content["reference"])
        made |= {key: tuple(map(tuple, content[key])) for key in ("fitted", "judged", "alike") if key in content}
        for key, kind in (("files", SourceFile), ("published", Published)):
            made[key] = tuple(kind(**each) for each in content.get(key, ()))
        return Entry(**{**content, **made})
    except (KeyError, TypeError) as error:
        raise InputError(f"{path.name} is no entry of the registry: {error}.") from None
