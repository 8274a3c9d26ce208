"""Downloads over https into a cache, resumable and checked by SHA-256."""

import hashlib
import os
import ssl
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from http.client import HTTPException, HTTPMessage, HTTPResponse
from ipaddress import ip_address
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import IO
from urllib.error import HTTPError, URLError
from urllib.parse import quote, urlsplit
from urllib.request import HTTPRedirectHandler, Request, build_opener

from tqdm import tqdm

from experiments.data.validation import Entry, SourceFile
from ident.errors import InputError
from ident.files.atomic import unwritten
from ident.files.limits import reason

HOST = "https://raw.githubusercontent.com"
"""Server of the files of repositories."""

TIMEOUT = 30.0
"""Time without an answer after which a download ends, s."""

GRACE, SLOWEST = 60.0, 20_000.0
"""Seconds in which a server has to answer, and bytes per second that it has to send afterwards, at least."""

PIECE = 1 << 16
"""Bytes that are read and written at a time."""

LARGEST = 1 << 30
"""Largest file that is downloaded, bytes."""

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
    """Downloads a file, going on from where an earlier attempt broke off, and returns its SHA-256.

    The bytes collect in `TARGET.part`, which is renamed when they are whole and have the right hash.

    Args:
        url: Address, https unless the server is this machine.
        target: Path of the file.
        sha256: Expected hash; empty if it is not known.

    Raises:
        InputError: The address is not https, the server cannot be reached or refuses, the connection breaks, or the
            hash is another one.
        OSError: The file cannot be written.
    """
    _check_address(url)
    part = target.with_name(f"{target.name}.part")
    with unwritten(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        resumed = part.exists()
        _receive(url, part)
        found = digest(part)
        if sha256 and found != sha256 and resumed:
            # What an earlier attempt left may be damaged, or of another file.
            part.unlink()
            _receive(url, part)
            found = digest(part)
        if sha256 and found != sha256:
            part.unlink()
            raise InputError(
                f"'{url}' has the SHA-256 {found}, but the registry expects {sha256}: it is damaged, or another file "
                "than the one that was tried; nothing of it was kept."
            )
        part.replace(target)
    return found


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _receive(url: str, part: Path) -> None:
    """Appends to a partial file what is missing of it."""
    have = part.stat().st_size if part.exists() else 0
    request = Request(url, headers={"Range": f"bytes={have}-"} if have else {})
    with _answered(url, request) as response:
        if response is None:
            return
        resumes = response.status == 206 and str(response.headers["Content-Range"]).startswith(f"bytes {have}-")
        done, missing = (have if resumes else 0), _stated_length(url, response)
        total = done + missing
        if total > LARGEST:
            raise InputError(f"'{url}' has {total / 1e9:.1f} GB, more than the largest size of {LARGEST / 1e9:.1f} GB.")
        with (
            part.open("ab" if resumes else "wb") as file,
            tqdm(total=total or None, initial=done, desc=part.stem, unit="B", unit_scale=True, file=sys.stderr) as bar,
        ):
            begun, before = monotonic(), done
            # One answer of the system at a time: `read` would wait for a whole piece of single bytes.
            while piece := response.read1(PIECE):
                file.write(piece)
                done += len(piece)
                bar.update(len(piece))
                if done > LARGEST:
                    raise InputError(f"'{url}' is larger than the largest size of {LARGEST / 1e9:.1f} GB.")
                if monotonic() - begun > GRACE + (done - before) / SLOWEST:
                    raise TimeoutError(f"it sends less than {SLOWEST / 1e3:g} kB a second")
        if missing and done != total:
            raise InputError(
                f"The download of '{url}' broke off after {done} of {total} bytes; run it again to go on from there."
            )


def _stated_length(url: str, response: HTTPResponse) -> int:
    """Bytes that an answer says it has; zero if it does not say.

    Raises:
        InputError: It says something else than a number.
    """
    stated = response.headers["Content-Length"]
    # `http.client` leaves out what it cannot read as a number.
    if stated and not response.chunked and response.length is None:
        raise InputError(f"'{url}' cannot be downloaded: its Content-Length is {stated!r:.40}, which is no number.")
    return response.length or 0


def _ask(request: Request, answer: "Future[HTTPResponse]") -> None:
    """Answers a request, or fails."""
    try:
        answer.set_result(build_opener(_StaysSafe).open(request, timeout=TIMEOUT))
    except Exception as error:
        answer.set_exception(error)


def _close(late: "Future[HTTPResponse]") -> None:
    """Closes an answer that nobody waits for any more."""
    if late.exception() is None:
        late.result().close()


def _opened(request: Request) -> HTTPResponse:
    """Answer to a request, whose headers have to come in time.

    Raises:
        OSError: There is none; so is any error of `urllib` and `http.client` raised.
    """
    answer = Future[HTTPResponse]()
    # A thread of its own, as headers may come byte by byte; it does not keep the program alive.
    Thread(target=_ask, args=(request, answer), daemon=True).start()
    try:
        return answer.result(GRACE)
    except TimeoutError:
        answer.add_done_callback(_close)
        raise
    finally:
        # An error would keep itself by way of this frame.
        del answer


@contextmanager
def _answered(url: str, request: Request) -> Iterator[HTTPResponse | None]:
    """Answer to a request; None if nothing is missing of what it asks for.

    Raises:
        InputError: There is none, or the connection breaks; the sentence says so.
    """
    try:
        try:
            response = _opened(request)
        except HTTPError as error:
            if error.code != 416:
                raise
            error.close()
            yield None
            return
        with response:
            yield response
    except HTTPError as error:
        error.close()
        raise InputError(f"'{url}' cannot be downloaded: the server says {error.code} {reason(error)}.") from None
    except InputError:
        raise
    # An address to which the server redirects may be none: `urllib` has several errors for that.
    except (URLError, TimeoutError, ConnectionError, ssl.SSLError, HTTPException, ValueError, OverflowError) as error:
        why = reason(getattr(error, "reason", error))
        raise InputError(
            f"'{url}' cannot be downloaded ({why}): is there a network? What has come so far is kept; run it again "
            "to go on, or name a folder that holds the files with --data."
        ) from None


class _StaysSafe(HTTPRedirectHandler):
    """Follows redirections to addresses that could be asked for in the first place, and to no others."""

    def http_error_302(self, req: Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage) -> object:
        """Answer at the new address; the first one is closed also if that is none."""
        try:
            return super().http_error_302(req, fp, code, msg, headers)
        except Exception:
            fp.close()
            raise

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302

    def redirect_request(self, req: Request, fp: object, code: int, msg: str, headers: object, newurl: str) -> Request:
        """The request at the new address."""
        _check_address(newurl)
        made = super().redirect_request(req, fp, code, msg, headers, newurl)  # type: ignore[arg-type]
        if made is None:
            raise InputError(f"'{req.full_url}' is redirected in a way that is not followed ({code}).")
        return made


def _check_address(url: str) -> None:
    """Refuses addresses that are not https, unless the server is this machine.

    Raises:
        InputError: It is one.
    """
    try:
        parts = urlsplit(url)
        if parts.scheme == "https" and parts.hostname:
            return
        here = parts.scheme == "http" and ip_address(parts.hostname or "").is_loopback
    except ValueError:
        here = False
    if not here:
        raise InputError(f"Files are downloaded over https only, got '{url}'.")
