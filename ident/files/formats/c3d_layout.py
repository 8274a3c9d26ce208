"""Check of the layout of C3D files, before a C++ library reads them that crashes on damaged ones.

The header holds the starts of parameters and data and the number of frames. Parameters are consecutive records, groups
with a negative and their entries with a positive number, each with the offset of the next.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.errors import LogError
from ident.files.limits import NUMBER, check_size

BLOCK = 512
"""Bytes of a block, the unit of positions in the file."""

KEY = 0x50
"""Second byte of every C3D file."""

INTEL, DEC, MIPS = 84, 85, 86
"""Kinds of processors: the last one's integers are big-endian."""

TYPES = (-1, 1, 2, 4)
"""Types of entries: characters, bytes, integers and floats; the absolute value is their size in bytes."""


def check_layout(path: Path, limit: int) -> None:
    """Refuses a file whose sections are not where its header says, or that is truncated.

    Args:
        path: The file.
        limit: Bytes that it may take in memory, as for `check_size`.

    Raises:
        LogError: It is damaged or no C3D file.
    """
    content = path.read_bytes()
    start = BLOCK * (content[0] - 1) if content else 0
    if len(content) < BLOCK or content[1] != KEY or start < BLOCK or len(content) < start + 4:
        raise _damaged("it has no header of one, or ends before its parameters")
    if content[start + 3] not in (INTEL, DEC, MIPS):
        raise _damaged(f"its processor is of no known kind, {content[start + 3]}")
    order = ">" if content[start + 3] == MIPS else "<"
    end = start + BLOCK * content[start + 2]
    if not start + 4 < end <= len(content):
        raise _damaged("it ends before its parameters do")
    _check_parameters(_Parameters(content[:end], order, start + 4))
    _check_data(path, content, order, limit)


@dataclass
class _Parameters:
    """The section of parameters, read from its beginning to its end."""

    content: bytes
    order: str
    place: int

    def take(self, kind: str, count: int = 1) -> list[int]:
        """The next integers of a numpy type."""
        size = np.dtype(kind).itemsize * count
        if self.place + size > len(self.content):
            raise _damaged("its parameters go beyond their section")
        numbers = np.frombuffer(self.content, f"{self.order}{kind}", count, self.place)
        self.place += size
        return [int(x) for x in numbers]


def _check_parameters(section: _Parameters) -> None:
    """Checks all records of the section."""
    groups, owners = set(), set()
    while section.place + 2 <= len(section.content):
        (length,), (number,) = section.take("i1"), section.take("i1")
        if length == 0 or number == 0:
            break
        name = bytes(section.take("u1", abs(length)))
        if not all(32 < character < 127 for character in name):
            raise _damaged(f"its parameters have the name {name!r}")
        way_from = section.place
        (way,) = section.take("u2")
        if number < 0:
            groups.add(-number)
        else:
            owners.add(number)
            (kind,) = section.take("i1")
            dimensions = section.take("u1", section.take("u1")[0])
            if kind not in TYPES or len(dimensions) > 7:
                raise _damaged(f"its parameter {name.decode()} is of no known type")
            section.take("u1", abs(kind) * math.prod(dimensions))
        section.take("u1", section.take("u1")[0])
        if way == 0:
            break
        if section.place > way_from + way:
            raise _damaged(f"its parameter {name.decode()} goes into the next one")
        section.place = way_from + way
    if not groups or not owners <= groups:
        raise _damaged("its parameters lack the groups they are in")


def _check_data(path: Path, content: bytes, order: str, limit: int) -> None:
    """Refuses a file with fewer frames than its header states."""
    points, analog, first, last = (int(x) for x in np.frombuffer(content, f"{order}u2", 4, 2))
    (start,) = np.frombuffer(content, f"{order}u2", 1, 16)
    # The sign of the scale factor says if data are integers; all processors have it in the same bit.
    is_float = content[15 if order == "<" else 12] & 0x80
    frames, width = max(0, last - first + 1), (4 if is_float else 2) * (4 * points + analog)
    if not start > 1 or BLOCK * (int(start) - 1) + frames * width > len(content):
        raise _damaged(f"it ends before the {frames} frames that its header promises")
    check_size(path, NUMBER * frames * (4 * points + analog), limit)


def _damaged(what: str) -> LogError:
    return LogError(f"the file needs to be a whole C3D file, but {what}.")
