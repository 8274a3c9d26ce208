"""Downloads over https into a cache, checked by SHA-256."""

import hashlib
import os
import sys
import time
from http.client import HTTPException
from pathlib import Path
from typing import IO
from urllib.error import HTTPError, URLError
from urllib.parse import quote
from urllib.request import urlopen

from experiments.data.validation import Entry, SourceFile
from ident.errors import InputError
from ident.files.atomic import replacing, unwritten
from ident.files.limits import PIECE, reason

HOST = "https://raw.githubusercontent.com"
"""Server of the files of repositories."""

DEADLINE = 1800.0
"""Time for a whole file, s: one of 30 MB at 20 kB/s; a server that sends byte by byte is left then."""

LARGEST = 1 << 30
"""Largest file that is downloaded, bytes; those of the registry have a few MB."""

MAY_COPY = ("BSD-2-Clause", "BSD-3-Clause", "MIT", "Apache-2.0", "CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "MPL-2.0")
"""Licences that let anybody copy."""


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
    done, end = 0, time.monotonic() + DEADLINE
    try:
        with urlopen(url, timeout=30) as response:
            while piece := response.read1(PIECE):
                if time.monotonic() > end:
                    raise TimeoutError(f"{done} bytes took more than {DEADLINE:g} s")
                file.write(piece)
                done += len(piece)
                if done > LARGEST:
                    raise InputError(f"'{url}' is larger than the largest size of {LARGEST / 1e9:.1f} GB.")
            if response.length:
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
