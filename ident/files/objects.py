"""Results in files: data classes of this package as JSON and arrays in one `.npz` archive, without any code.

Every object is a number in a list; what occurs twice is written once. Read back, only data classes and enumerations of
the package `ident` are made, and their fields have to be those of this version.
"""

import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ident.arguments import checked_path
from ident.errors import InputError
from ident.files.atomic import replacing
from ident.files.npz import LIMIT, check_size, reason

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
    path, writer = checked_path("path", path), _Writer()
    text = json.dumps({"kind": kind, "root": writer.number_of(root), "objects": writer.objects})
    with replacing(path) as temporary, temporary.open("wb") as file:
        savez: Any = np.savez_compressed
        savez(file, **{KEY: np.array(text)}, **writer.arrays)


def load_object(path: str | Path, kind: str, *, limit: int = LIMIT) -> Any:
    """Reads what `save_object` wrote.

    Args:
        path: The file.
        kind: Kind of the object.
        limit: Bytes that it may take in memory, as for `npz.check_size`.

    Raises:
        InputError: The file is missing, is none, holds another kind of object, or was written by another version.
    """
    path = checked_path("path", path)
    try:
        with zipfile.ZipFile(path) as members:
            check_size(path, sum(each.file_size for each in members.infolist()), limit)
        with np.load(path, allow_pickle=False) as archive:
            content = json.loads(str(archive[KEY]))
            arrays = {name: archive[name] for name in archive.files if name != KEY}
        if content["kind"] != kind:
            raise InputError(f"{path} holds a saved {content['kind']}; needed is a saved {kind}.")
        return _Reader(content["objects"], arrays).object_of(content["root"])
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}); needed is a saved {kind}.") from None
    # Zip, numpy and damaged content have a dozen classes of errors.
    except Exception as error:
        raise InputError(f"{path} is no saved {kind} that this version can read ({reason(error)}).") from None


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
            return ["named", _name(value), [self.number_of(x) for x in value]]
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
        if kind == "plain":
            return content[0]
        if kind == "array":
            return self._arrays[content[0]]
        if kind == "slice":
            return slice(*content)
        if kind == "enum":
            return _class(content[0])[content[1]]
        if kind == "mapping":
            return {self.object_of(key): self.object_of(value) for key, value in content[0]}
        if kind in ("tuple", "list"):
            parts = [self.object_of(each) for each in content[0]]
            return tuple(parts) if kind == "tuple" else parts
        if kind == "named":
            return _class(content[0])(*(self.object_of(each) for each in content[1]))
        return self._data(*content)

    def _data(self, name: str, own: Mapping[str, int]) -> Any:
        """A data class with its fields, which were checked before they were written."""
        made = _class(name)
        if {each.name for each in fields(made)} != own.keys():
            raise ValueError(f"{name} has other fields in this version")
        out = object.__new__(made)
        for key, number in own.items():
            object.__setattr__(out, key, self.object_of(number))
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
