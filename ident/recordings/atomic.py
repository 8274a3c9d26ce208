"""Files that appear whole or not at all, and what runs that were killed have left of them."""

import io
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

try:
    import fcntl
except ImportError:  # Not on Windows.
    fcntl = None  # type: ignore[assignment]

PARTIAL = ".multicontact-partial-"
"""How names of files and folders begin that are not whole yet."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name when the block ends well, and vanishes when it does not.

    Args:
        path: File to write; its folder must exist. The temporary name keeps the suffix.

    Raises:
        OSError: The file could not be written, see `unwritten`; the one that was there is whole.
    """

    def made() -> Path:
        handle, name = tempfile.mkstemp(prefix=PARTIAL, suffix=path.suffix, dir=path.parent)
        os.close(handle)
        return Path(name)

    with unwritten(path), _no_device(path), claimed(path.parent, made, Path.unlink) as temporary:
        try:
            yield temporary
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def _no_device(path: Path) -> Iterator[None]:
    """Refuses what a file would take the place of for everybody: a device, a pipe or a folder.

    Raises:
        OSError: The path is one.
    """
    if path.exists() and not path.is_file():
        raise OSError("it is no regular file")
    yield


@contextmanager
def claimed(folder: Path, make: Callable[[], Path], remove: Callable[[Path], None]) -> Iterator[Path]:
    """A new file or folder that is not whole yet, after those that killed runs have left there are gone.

    As long as the block lasts it is locked, and the system gives locks back when a process dies. Where there are no
    locks, nothing is removed.

    Args:
        folder: Where it is made.
        make: Makes it, under a name that begins with `PARTIAL`.
        remove: Removes one that was left.
    """
    with ExitStack() as stack:
        # Nobody looks for what was left while there is something without a lock.
        with _locked(folder):
            for path in folder.glob(f"{PARTIAL}*"):
                with _locked(path, wait=False) as left, suppress(OSError):
                    if left:
                        remove(path)
            path = make()
            stack.enter_context(_locked(path, wait=False))
        yield path


@contextmanager
def _locked(path: Path, *, wait: bool = True) -> Iterator[bool]:
    """Whether a file or folder could be locked for the duration of a block."""
    if fcntl is None:
        yield False
        return
    with ExitStack() as stack:
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:
            yield False
        else:
            yield True


@contextmanager
def unwritten(path: Path) -> Iterator[None]:
    """Says in one sentence which file or folder a block could not write, and why, as when the disk is full.

    Systems name no file then, or a temporary one. Of blocks in each other the outermost names what it writes, with the
    reason of the innermost.

    Raises:
        OSError: The block raised one.
    """
    try:
        yield
    except OSError as error:
        reason = error
        while isinstance(reason.__cause__, OSError):
            reason = reason.__cause__
        raise OSError(
            f"'{path}' could not be written ({reason.strerror or reason}) and is as it was; "
            "make room or write elsewhere, and run again."
        ) from reason


def save_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Writes arrays as an npz file, whole or not at all."""
    # In memory first: older versions of numpy leave an archive open when the disk is full.
    with replacing(path) as temporary, io.BytesIO() as archive:
        np.savez(archive, **arrays)
        temporary.write_bytes(archive.getvalue())
