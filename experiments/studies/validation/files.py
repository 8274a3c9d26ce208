"""The registry's files, and those of the recordings: where they are, downloaded, checked and converted."""

import hashlib
import os
import pickle
import sqlite3
import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http.client import HTTPException
from importlib.resources import files
from pathlib import Path
from shutil import copyfileobj
from typing import IO
from urllib.error import HTTPError, URLError
from urllib.parse import quote
from urllib.request import urlopen
from zipfile import BadZipFile

from experiments.data.validation import Entry, SourceFile
from experiments.studies.validation.converters import CONVERTERS
from ident.display.brief import listed
from ident.errors import InputError
from ident.files.atomic import replacing, unwritten
from ident.files.limits import made, reason, toml

HOST = "https://raw.githubusercontent.com"
"""Server of the files of repositories."""

MAY_COPY = ("BSD-2-Clause", "BSD-3-Clause", "MIT", "Apache-2.0", "CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "MPL-2.0")
"""Licences that let anybody copy."""


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
        data: Local folder with a folder for each entry; None for none.
        fetch: True to download what is not there.
        host: Server to download from.
    """

    data: Path | None = None
    fetch: bool = False
    host: str = HOST

    def folder(self, entry: Entry) -> Path:
        """Folder that holds the files of an entry, after a download of those that are missing or damaged in the cache.

        Raises:
            InputError: No folder holds all of them; the message says what would do.
        """
        given = None if self.data is None else self.data / entry.folder
        lost = [file.name for file in entry.files if given is not None and not (given / file.name).is_file()]
        if given is not None and entry.files and not lost:
            return given
        downloads = cache() / entry.folder
        right = (_is_right(file, downloads) for file in entry.files if self.fetch and not file.made)
        if all((downloads / file.name).is_file() for file in entry.files) and entry.files and all(right):
            return downloads
        if self.fetch:
            return fetched(entry, downloads, self.host)
        if lost:
            raise InputError(f"'{given}' has no {listed(lost, 3)}; --fetch downloads what its licence allows.")
        raise InputError(
            "Its files are not here: --fetch downloads them, or --data FOLDER (or MULTICONTACT_DATA) names a folder "
            f"with a folder '{entry.folder}'."
        )


def _is_right(file: SourceFile, folder: Path) -> bool:
    """True if a file is there with the registry's hash, or with any if that holds none."""
    path = folder / file.name
    return path.is_file() and (not file.sha256 or digest(path) == file.sha256)


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


def cache() -> Path:
    """Folder of downloads, in the user's cache."""
    if given := os.environ.get("XDG_CACHE_HOME"):
        base = Path(given)
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    else:
        base = Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    return base / "multicontact" / "recordings"


def address(entry: Entry, file: SourceFile, host: str = HOST) -> str:
    """Address of a published file.

    Raises:
        InputError: The licence does not let it be copied, or its commit or path is not known.
    """
    source = entry.source
    if source.licence not in MAY_COPY:
        licence = f"is '{source.licence}'" if source.licence else "is not known"
        raise InputError(
            f"{entry.name} is not downloaded: the licence of {source.repository} {licence}, which lets nobody copy it "
            "without asking. Get the files yourself and name their folder with --data."
        )
    if not source.commit or not file.path:
        raise InputError(
            f"{entry.name} cannot be downloaded: where '{file.name}' is published is not known. {entry.note} "
            "A folder that holds it can be named with --data."
        )
    return f"{host}/{source.repository}/{source.commit}/{quote(file.path)}"


def download(url: str, target: Path, sha256: str = "") -> str:
    """Downloads a file, and returns its SHA-256; what is not whole or not right is not kept.

    Args:
        url: Its address.
        target: Path of the file.
        sha256: Expected hash; empty if it is not known.

    Raises:
        InputError: The server cannot be reached or refuses, the connection breaks, or the hash is another one.
        OSError: The file cannot be written.
    """
    with unwritten(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as temporary:
            with temporary.open("wb") as file:
                _receive(url, file)
            got = digest(temporary)
            if sha256 and got != sha256:
                raise InputError(
                    f"'{url}' has the SHA-256 {got}, but the registry expects {sha256}: it is damaged, or another file "
                    "than the one that was tried; nothing of it was kept."
                )
    return got


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _receive(url: str, file: IO[bytes]) -> None:
    """Writes what a server sends.

    Raises:
        InputError: It does not send all of it; the sentence says why.
    """
    try:
        with urlopen(url, timeout=30) as response:
            copyfileobj(response, file)
            if response.length:
                done = file.tell()
                raise ConnectionError(f"it broke off after {done} of {done + response.length} bytes")
    except HTTPError as error:
        error.close()
        raise InputError(f"'{url}' cannot be downloaded: the server says {error.code} {reason(error)}.") from None
    except (URLError, TimeoutError, ConnectionError, HTTPException, ValueError, OverflowError) as error:
        why = reason(getattr(error, "reason", error))
        raise InputError(
            f"'{url}' cannot be downloaded ({why}): is there a network? Run it again, or name a folder that holds the "
            "files with --data."
        ) from None
