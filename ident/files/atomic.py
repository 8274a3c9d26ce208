"""Atomic writing of files and folders, and removal of partial ones that killed runs have left."""

import io
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError

try:
    import fcntl
except ImportError:  # Not on Windows.
    fcntl = None  # type: ignore[assignment]

PARTIAL = ".multicontact-partial-"
"""Prefix of the names of files and folders that are still being written."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`: renamed to `path` when the block succeeds, removed when it fails.

    Args:
        path: File to write; its folder must exist. The temporary name keeps the suffix.

    Raises:
        InputError: Its folder does not exist.
        OSError: The file could not be written, see `unwritten`; an existing file is unchanged.
    """
    if not path.parent.is_dir():
        raise InputError(f"'{path}' cannot be written: the folder '{path.parent}' does not exist; make it first.")

    def made() -> Path:
        if path.exists() and not path.is_file():
            raise OSError("it is no regular file")
        handle, name = tempfile.mkstemp(prefix=PARTIAL, suffix=path.suffix, dir=path.parent)
        os.close(handle)
        return Path(name)

    with unwritten(path), claimed(path.parent, made, Path.unlink) as temporary:
        try:
            yield temporary
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def claimed(folder: Path, make: Callable[[], Path], remove: Callable[[Path], None]) -> Iterator[Path]:
    """Creates a partial file or folder and locks it for the block; first removes partial ones of killed runs.

    The system releases the locks of a process that dies. On systems without file locks nothing is removed.

    Args:
        folder: Folder in which it is created.
        make: Creates it, under a name that begins with `PARTIAL`.
        remove: Removes one that a killed run has left.
    """
    with ExitStack() as stack:
        # The folder is locked until the new file is, so that no other process takes it for a leftover.
        with _locked(folder):
            for path in folder.glob(f"{PARTIAL}*"):
                with _locked(path, wait=False) as left, suppress(OSError):
                    if left:
                        remove(path)
            path = make()
            stack.enter_context(_locked(path, wait=False))
        yield path


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Holds a folder for a block; a killed run does not hold it any more.

    On systems without file locks nothing is held.

    Raises:
        InputError: Another process holds it.
    """
    if fcntl is None:
        yield
        return
    file = folder / f"{PARTIAL}running"
    with ExitStack() as stack:
        # The folder is locked meanwhile, so that no other process removes the file before it is held.
        with _locked(folder):
            file.touch()
            if stack.enter_context(_locked(file, wait=False)) is None:
                raise InputError(
                    f"Another run is writing into '{folder}'; wait until it has ended, or choose another --out."
                )
        try:
            yield
        finally:
            with _locked(folder):
                file.unlink(missing_ok=True)


@contextmanager
def _locked(path: Path, *, wait: bool = True) -> Iterator[bool | None]:
    """Locks a file or folder for a block; yields True if that succeeded, None if another process holds it."""
    if fcntl is None:
        yield False
        return
    with ExitStack() as stack:
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            yield None if isinstance(error, BlockingIOError) else False
        else:
            yield True


@contextmanager
def unwritten(path: Path) -> Iterator[None]:
    """Turns an OSError of a block into one sentence that names the file or folder and the reason.

    The system's own error names no file or a temporary one. Of nested blocks the outermost names its path, with the
    reason of the innermost.

    Raises:
        OSError: The block raised one, of the same number.
    """
    try:
        yield
    except OSError as error:
        reason = error
        while isinstance(reason.__cause__, OSError):
            reason = reason.__cause__
        sentence = OSError(
            f"'{path}' could not be written ({reason.strerror or reason}) and is as it was; "
            "make room or write elsewhere, and run again."
        )
        sentence.errno = reason.errno
        raise sentence from reason


def save_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Writes arrays as an npz file, atomically."""
    # In memory first: older versions of numpy leave an archive open when the disk is full.
    with replacing(path) as temporary, io.BytesIO() as archive:
        np.savez(archive, **arrays)
        temporary.write_bytes(archive.getvalue())
