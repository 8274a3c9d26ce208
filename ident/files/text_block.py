"""Rows of a text parsed into numbers, or kept as text, in as little memory as possible."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ident.files.limits import NUMBER
from ident.files.table import Memory, number_of

TEXT = 64
"""Bytes that a string takes in addition to its characters."""

Cells = Sequence[str] | np.ndarray


@dataclass(frozen=True, eq=False)
class Block:
    """Some rows of a text.

    Attributes:
        rows: Number of each in the file (N,).
        cells: Columns by name, numbers or text (N,) each.
        size: Bytes that they take.
    """

    rows: np.ndarray
    cells: Mapping[str, Cells]
    size: int

    @classmethod
    def of(cls, rows: Sequence[int], cells: Mapping[str, Cells], memory: Memory, decimal_comma: bool) -> "Block":
        """Parses columns into numbers where possible, and records their decimal separators in `memory`."""
        numbers = {name: _numbers(name, column, memory, decimal_comma) for name, column in cells.items()}
        size = NUMBER * len(rows) * (1 + len(cells))
        size += sum(sum(TEXT + len(text) for text in {*x}) for x in numbers.values() if not isinstance(x, np.ndarray))
        return cls(np.asarray(rows), numbers, size)

    @classmethod
    def joined(cls, blocks: Sequence["Block"]) -> "Block":
        """Rows of several blocks in one; columns that are text in any of them become text."""
        cells = {name: _joined([block.cells[name] for block in blocks]) for name in blocks[0].cells}
        return cls(np.concatenate([block.rows for block in blocks]), cells, sum(block.size for block in blocks))

    def last(self, number: int) -> "Block":
        """The last rows."""
        first = max(0, len(self.rows) - number)
        return Block(self.rows[first:], {name: x[first:] for name, x in self.cells.items()}, 0)


def _numbers(name: str, cells: Cells, memory: Memory, decimal_comma: bool) -> Cells:
    """A column as numbers if all of its cells are numbers or empty, else as text with equal strings stored once."""
    if isinstance(cells, np.ndarray):
        if decimal_comma and (np.abs(np.modf(cells)[0]) > 0).any():
            memory.marks.setdefault(name, set()).add(".")
        return cells.copy()
    if decimal_comma:
        memory.marks.setdefault(name, set()).update(mark for mark in ",." if any(mark in cell for cell in cells))
    with suppress(ValueError):
        return np.array([number_of(cell, decimal_comma) for cell in cells])
    known: dict[str, str] = {}
    return [known.setdefault(cell, cell) for cell in cells]


def _joined(parts: Sequence[Cells]) -> Cells:
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate(parts)
    known: dict[str, str] = {}
    texts = (_texts(part) if isinstance(part, np.ndarray) else part for part in parts)
    return [known.setdefault(text, text) for part in texts for text in part]


def _texts(numbers: np.ndarray) -> list[str]:
    return ["" if np.isnan(x) else repr(x) for x in numbers.tolist()]
