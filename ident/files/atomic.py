"""Results in files: atomic writing, and data classes of this package as JSON and arrays in one `.npz` archive.

Every object is a number in a list; what occurs twice is written once. Read back, only data classes and enumerations of
the package `ident` are made, and their fields have to be those of this version, of their annotated types. A digest
stands for the rest: shapes of arrays, and numbers that have to be alike.
"""

import hashlib
import io
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ident.annotations import misfit
from ident.arguments import checked_path, checked_target
from ident.errors import InputError
from ident.files.arrays import arrays as arrays_of
from ident.files.limits import LIMIT, parsed_json, reason

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


KEY = "objects"
"""Array of the archive that holds the JSON text."""

PLAIN = (str, int, float, bool, type(None))


def save_object(path: str | Path, kind: str, root: Any) -> None:
    """Writes an object and all that it consists of.

    Args:
        path: File to write.
        kind: Kind of the object, for messages when it is read.
        root: A data class of `ident`, with data classes, sequences, mappings, numbers, texts and arrays in it. What
            belongs to other packages, such as the compiled model of a mechanism, is left out and read as None.

    Raises:
        InputError: The path is none, or its folder does not exist.
    """
    path, writer = checked_target(path), _Writer()
    content = {"kind": kind, "root": writer.number_of(root), "objects": writer.objects}
    text = json.dumps(content | {"sha256": _digest(content, writer.arrays)})
    with replacing(path) as temporary, temporary.open("wb") as file:
        savez: Any = np.savez_compressed
        savez(file, **{KEY: np.array(text)}, **writer.arrays)


def _digest(content: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of objects and arrays."""
    out = hashlib.sha256(json.dumps([content["kind"], content["root"], content["objects"]]).encode())
    for name, x in sorted(arrays.items()):
        out.update(f"{name} {x.dtype.str} {x.shape}".encode() + x.tobytes())
    return out.hexdigest()


def load_object(path: str | Path, kind: str, made: type = object, *, limit: int = LIMIT) -> Any:
    """Reads what `save_object` wrote.

    Args:
        path: The file.
        kind: Kind of the object.
        made: Its type.
        limit: Bytes that it may take in memory, as for `limits.check_size`.

    Raises:
        InputError: The file is missing, is none, holds another kind of object, was changed, or was written by another
            version.
    """
    path = checked_path("path", path)
    try:
        arrays = arrays_of(path, limit)
        content = parsed_json(str(arrays.pop(KEY)))
        saved = str(content["kind"])
        loaded = _loaded(content, arrays, made) if saved == kind else None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}); needed is a saved {kind}.") from None
    # Damaged content has a dozen classes of errors.
    except Exception as error:
        raise InputError(f"{path} is no saved {kind} that this version can read ({reason(error)}).") from None
    if saved != kind:
        raise InputError(f"{path} holds a saved {saved:.40}; needed is a saved {kind}.")
    return loaded


def _loaded(content: Mapping[str, Any], arrays: Mapping[str, np.ndarray], made: type) -> Any:
    """Object of a file's content, which is of a type and as it was saved."""
    loaded = _Reader(content["objects"], arrays).object_of(content["root"])
    if not isinstance(loaded, made):
        raise ValueError(f"it holds an object of type {type(loaded).__name__}")
    if content.get("sha256") != _digest(content, arrays):
        raise ValueError("it was changed after it was saved, or saved by another version")
    return loaded


class _Writer:
    """Numbers of objects, each written once."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self.arrays: dict[str, np.ndarray] = {}
        self._numbers: dict[int, int] = {}
        self._kept: list[Any] = []

    def number_of(self, value: Any) -> int:
        """Number of an object, which is written if it is new."""
        if id(value) not in self._numbers:
            self._kept.append(value)
            at = self._numbers[id(value)] = len(self.objects)
            self.objects.append(None)
            self.objects[at] = self._entry(value)
        return self._numbers[id(value)]

    def _entry(self, value: Any) -> list[Any]:
        """Type of an object and its content, whose parts are numbers."""
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, Enum):
            return ["enum", _name(value), value.name]
        if isinstance(value, PLAIN):
            return ["plain", value]
        if isinstance(value, np.ndarray):
            name = f"array_{len(self.arrays)}"
            self.arrays[name] = value
            return ["array", name]
        if isinstance(value, slice):
            return ["slice", value.start, value.stop, value.step]
        if is_dataclass(value) and _name(value).startswith("ident."):
            return ["data", _name(value), {f.name: self.number_of(getattr(value, f.name)) for f in fields(value)}]
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return ["named", _name(value), {name: self.number_of(getattr(value, name)) for name in value._fields}]
        if isinstance(value, Mapping):
            return ["mapping", [[self.number_of(key), self.number_of(x)] for key, x in value.items()]]
        if isinstance(value, Path):
            return ["plain", str(value)]
        if isinstance(value, Sequence):
            return ["tuple" if isinstance(value, tuple) else "list", [self.number_of(x) for x in value]]
        return ["plain", None]


class _Reader:
    """Objects of a file by their numbers, each made once."""

    def __init__(self, entries: list[Any], arrays: Mapping[str, np.ndarray]) -> None:
        self._entries, self._arrays = entries, arrays
        self._made: dict[int, Any] = {}

    def object_of(self, number: int) -> Any:
        """Object of a number."""
        if number not in self._made:
            self._made[number] = self._object(*self._entries[number])
        return self._made[number]

    def _object(self, kind: str, *content: Any) -> Any:
        if kind == "plain" and isinstance(content[0], PLAIN):
            return content[0]
        if kind == "array":
            return self._arrays[content[0]]
        if kind == "slice" and all(isinstance(x, int | None) for x in content):
            return slice(*content)
        if kind == "enum":
            return _class(content[0])[content[1]]
        if kind == "mapping":
            return {self.object_of(key): self.object_of(value) for key, value in content[0]}
        if kind in ("tuple", "list"):
            parts = [self.object_of(each) for each in content[0]]
            return tuple(parts) if kind == "tuple" else parts
        return self._made_of(*content)

    def _made_of(self, name: str, own: Mapping[str, int]) -> Any:
        """A data class or named tuple with its fields, whose values were checked before they were written."""
        made = _class(name)
        names = made._fields if issubclass(made, tuple) else [each.name for each in fields(made)]
        if {*names} != own.keys():
            raise ValueError(f"{made.__name__} has other fields in this version: make it again and save it")
        values = {key: self.object_of(number) for key, number in own.items()}
        if wrong := misfit(made, values):
            raise ValueError(f"{made.__name__}.{wrong}")
        if issubclass(made, tuple):
            return made(**values)
        out = object.__new__(made)
        for key, value in values.items():
            object.__setattr__(out, key, value)
        return out


def _name(value: Any) -> str:
    """Module and name of an object's class."""
    return f"{type(value).__module__}:{type(value).__qualname__}"


def _class(name: str) -> Any:
    """Data class, named tuple or enumeration of `ident` by its name."""
    module, _, own = name.partition(":")
    if not module.startswith("ident."):
        raise ValueError(f"it holds '{name}'")
    out = getattr(import_module(module), own)
    if not (isinstance(out, type) and (is_dataclass(out) or issubclass(out, Enum) or hasattr(out, "_fields"))):
        raise ValueError(f"it holds '{name}'")
    return out
