"""The registry's files, and those of the recordings: where they are, checked and converted."""

import pickle
import sqlite3
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from zipfile import BadZipFile

from experiments.data.validation import Entry, SourceFile
from experiments.studies.validation.converters import CONVERTERS
from experiments.studies.validation.download import HOST, address, cache, digest, download
from ident.display.brief import listed
from ident.errors import InputError
from ident.files.limits import made, toml


def columns_file(name: str, kind: str = "columns") -> Path:
    """Path of an entry's columns file, or of another file of the package."""
    return Path(str(files("experiments.studies.validation").joinpath(kind))) / name


def registry() -> dict[str, Entry]:
    """All entries by name, those that have been tried first."""
    folder = Path(str(files("experiments.studies.validation").joinpath("recordings")))
    entries = [read_entry(path) for path in sorted(folder.glob("*.toml"))]
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
    try:
        return made(Entry, "", content, name=path.stem)
    except InputError as error:
        raise InputError(f"{path.name} is no entry of the registry: {error}") from None


NOT_AS_MEANT = ValueError, LookupError, TypeError, AttributeError
DAMAGED = *NOT_AS_MEANT, sqlite3.Error, struct.error, pickle.PickleError, BadZipFile
"""Errors of converters that damaged files cause."""


@dataclass(frozen=True)
class Places:
    """Folders in which files of entries are looked for.

    Attributes:
        data: Local folders, each with a folder for each entry.
        fetch: True to download what is in none of them.
        host: Server to download from.
    """

    data: tuple[Path, ...] = ()
    fetch: bool = False
    host: str = HOST

    def folder(self, entry: Entry) -> Path:
        """Folder that holds the files of an entry, after a download of those that are missing or damaged in the cache.

        Raises:
            InputError: No folder holds all of them; the message says what would do.
        """
        *given, downloads = (where / entry.folder for where in (*self.data, cache()))
        for place in given:
            if _complete(entry, place):
                return place
        damaged = self.fetch and any(not file.made and not _is_right(file, downloads) for file in entry.files)
        if _complete(entry, downloads) and not damaged:
            return downloads
        if not self.fetch:
            raise InputError(_missing(entry, given))
        return fetched(entry, downloads, self.host)


def _complete(entry: Entry, folder: Path) -> bool:
    return bool(entry.files) and all((folder / file.name).is_file() for file in entry.files)


def _is_right(file: SourceFile, folder: Path) -> bool:
    """True if a file is there with the registry's hash, or with any if that holds none."""
    path = folder / file.name
    return path.is_file() and (not file.sha256 or digest(path) == file.sha256)


def _missing(entry: Entry, places: Iterable[Path]) -> str:
    """Sentence on files that are not there."""
    for place in places:
        if lost := [file.name for file in entry.files if not (place / file.name).is_file()]:
            return f"'{place}' has no {listed(lost, 3)}; --fetch downloads what its licence lets."
    return (
        f"Its files are not here: --fetch downloads them, or --data FOLDER (or MULTICONTACT_DATA) names a folder with "
        f"a folder '{entry.folder}'."
    )


def fetched(entry: Entry, folder: Path, host: str = HOST) -> Path:
    """Downloads the files of an entry into a folder and returns it.

    Raises:
        InputError: One may not be copied, cannot be downloaded, or has another hash.
    """
    addresses = {file: address(entry, file, host) for file in entry.files}
    for file, url in addresses.items():
        target, original = folder / file.name, folder / f"{file.name}.original"
        if _is_right(file, folder):
            continue
        expected = file.original or ("" if file.made else file.sha256)
        sha256 = download(url, original if file.made else target, expected)
        if not expected:
            print(f"Unchecked, as the registry holds no hash of it: {url}, SHA-256 {sha256}.", file=sys.stderr)
        if file.made:
            convert(file.made, original, target)
            original.unlink()
    return folder


def checked(entry: Entry, folder: Path) -> tuple[str, ...]:
    """Checks the files of an entry by their hashes.

    A file made of a downloaded one may be written otherwise than the one that was tried; it is not refused.

    Returns:
        Names of the files that no hash vouches for.

    Raises:
        InputError: A file has another hash.
    """
    right = {file.name: _is_right(file, folder) for file in entry.files}
    for file in entry.files:
        if not right[file.name] and not file.made:
            raise InputError(
                f"'{folder / file.name}' is another file than the one that was tried, whose SHA-256 is {file.sha256}: "
                "it is damaged, or of another version."
            )
    return tuple(file.name for file in entry.files if not (file.sha256 and right[file.name]))


def converted(entry: Entry, folder: Path, scratch: Path) -> Mapping[str, Path]:
    """Paths of the files to read by name, converted ones in a scratch folder.

    Raises:
        InputError: A file cannot be converted.
    """
    out = {}
    for file in entry.files:
        path = folder / file.name
        if file.converter:
            # A bag becomes a table.
            target = scratch / (f"{Path(file.name).stem}.csv" if file.converter == "joint_states" else file.name)
            convert(file.converter, path, target)
            path = target
        out[file.name] = path
    return {entry.model: columns_file(entry.model, "models"), **out}


def convert(name: str, source: Path, target: Path) -> None:
    """Converts a file by the converter of a name.

    Raises:
        InputError: The file is damaged.
        OSError: The converted one cannot be written.
    """
    try:
        CONVERTERS[name](source, target)
    except InputError as error:
        raise InputError(f"'{source}' cannot be converted: {error}") from None
    except DAMAGED as error:
        raise InputError(f"'{source}' cannot be converted by '{name}': it is damaged ({error}).") from None
