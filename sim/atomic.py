"""Files that appear whole or not at all."""

import io
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name when the block ends well, and vanishes when it does not.

    Args:
        path: File to write; its folder must exist. The temporary name keeps the suffix.

    Raises:
        OSError: The file could not be written, see `unwritten`; the one that was there is whole.
    """
    with unwritten(path):
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


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
