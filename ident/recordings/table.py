"""The table of a log: a CSV or npz file as named columns, parsed when they are asked for."""

import codecs
import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.recordings import npz
from ident.recordings.csv_file import COMPONENTS, TRUE

SAMPLES = 10
"""Fewest samples that a log needs."""


@dataclass
class Table:
    """Columns of a file by name, as text or numbers.

    Text is parsed column by column, so that a column of remarks does no harm.

    Attributes:
        cells: Columns by name (N,), without true values that a recording of this project holds.
        rows: Where each sample stands in the file.
        word: What the file calls that, a row or a sample.
        decimal_comma: Whether numbers may have decimal commas.
        separators: A column by each decimal separator found so far.
    """

    cells: Mapping[str, Sequence[str] | np.ndarray]
    rows: Sequence[int]
    word: str
    decimal_comma: bool
    separators: dict[str, str] = field(default_factory=dict)

    def row(self, i: int) -> str:
        """Where sample i stands in the file."""
        return f"{self.word} {self.rows[i]}"

    def available(self) -> str:
        """What the file has, for messages."""
        names = list(map(short, self.cells))
        return f"the file has {', '.join(names[:40])}{', ...' if len(names) > 40 else ''}"

    def column(self, name: str, key: str, limit: float) -> np.ndarray:
        """Numbers of a column, NaN in all of them or in none (N,).

        Args:
            name: Name of the column.
            key: What it is mapped to, for messages.
            limit: No number is larger.
        """
        if name not in self.cells:
            raise LogError(f"{key} is mapped to column '{short(name)}', but {self.available()}.")
        cells = self.cells[name]
        x = cells if isinstance(cells, np.ndarray) else self._parsed(name, cells)
        infinite, missing, large = np.isinf(x), np.isnan(x), np.abs(x) > limit
        if infinite.any():
            raise LogError(f"{self.row(int(infinite.argmax()))}, column '{name}' needs a finite number, got an inf.")
        if missing.any() and not missing.all():
            raise LogError(
                f"{self.row(int(missing.argmax()))}, column '{name}' is empty or NaN, as are {int(missing.sum())} of "
                f"{len(x)} samples of it; a filter needs all of them: cut the log, or fill the gap."
            )
        if large.any():
            i = int(large.argmax())
            raise LogError(f"{self.row(i)}, column '{name}' needs numbers below {limit:g}, got {x[i]:g}.")
        return x

    def _parsed(self, name: str, cells: Sequence[str]) -> np.ndarray:
        for separator in ",." if self.decimal_comma else "":
            if any(separator in cell for cell in cells):
                self.separators.setdefault(separator, name)
        if len(self.separators) == 2:
            raise LogError(
                f"decimal commas (column '{self.separators[',']}') and decimal points (column "
                f"'{self.separators['.']}') in one file are ambiguous; use one of them."
            )
        return np.array([self._number(name, i, cell) for i, cell in enumerate(cells)])

    def _number(self, name: str, i: int, cell: str) -> float:
        try:
            if "_" in cell:
                raise ValueError
            return float((cell.replace(",", ".") if self.decimal_comma else cell) or "nan")
        except ValueError:
            raise LogError(f"{self.row(i)}, column '{name}' needs a number, got '{short(cell)}'.") from None


def read_table(path: Path, limit: int = npz.LIMIT) -> Table:
    """Reads a file into named columns.

    Args:
        path: A CSV or npz file.
        limit: Bytes that an archive may take in memory, as for `npz.check_size`.

    Raises:
        LogError: The file is missing, malformed, too short or too large.
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".txt", ".tsv", ".npz") or not path.is_file():
        raise LogError("a log is a .csv, .tsv, .txt or .npz file that exists.")
    table = _read_npz(path, limit) if suffix == ".npz" else _read_csv(path)
    if len(table.rows) < SAMPLES:
        raise LogError(f"a log needs at least {SAMPLES} samples, it has {len(table.rows)}.")
    return table


def _read_csv(path: Path) -> Table:
    lines = _text(path.read_bytes()).splitlines(keepends=True)
    skipped = 0
    while skipped < len(lines) and (not lines[skipped].strip() or lines[skipped].startswith("#")):
        skipped += 1
    if skipped == len(lines):
        raise LogError("the file is empty; a log is a header row of names and rows of numbers.")
    delimiter = next((d for d in ";\t," if d in lines[skipped]), ",")
    (first, header), *numbered = _cells(lines, skipped, delimiter) or [(skipped + 1, [])]
    _check_header(header, first)
    for number, row in numbered:
        if len(row) < len(header) or any(row[len(header) :]):
            raise LogError(f"row {number} has {len(row)} cells where the header has {len(header)}.")
    cells = {
        name: [row[k] for _, row in numbered] for k, name in enumerate(header) if name and not name.startswith(TRUE)
    }
    return Table(cells, [number for number, _ in numbered], "row", decimal_comma=delimiter != ",")


def _cells(lines: Sequence[str], skipped: int, delimiter: str) -> list[tuple[int, list[str]]]:
    """Rows with anything in them, each with the number of its line in the file."""
    reader = csv.reader(lines[skipped:], delimiter=delimiter)
    numbered: list[tuple[int, list[str]]] = []
    number = skipped + 1
    try:
        for row in reader:
            if skipped + reader.line_num > number:
                raise LogError(f"row {number} opens a quotation mark that it does not close.")
            if any(row):
                numbered.append((number, [cell.strip() for cell in row]))
            number += 1
    except csv.Error as error:
        raise LogError(f"row {number} is no row of a CSV file ({error}).") from None
    return numbered


def _text(data: bytes) -> str:
    utf16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if utf16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise LogError(f"the file needs to be text in UTF-8, byte {error.start} is not.") from None


def _check_header(header: Sequence[str], row: int) -> None:
    names = [name for name in header if name]
    if not names or any(map(_is_number, names)):
        raise LogError(f"a log needs a header row of names, row {row} holds numbers or nothing.")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise LogError(f"the header names column '{short(twice[0])}' more than once.")


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _read_npz(path: Path, limit: int) -> Table:
    arrays = npz.arrays(path, without="true/", limit=limit)
    cells: dict[str, np.ndarray] = {}
    for key, array in arrays.items():
        if np.issubdtype(array.dtype, np.number) and not np.iscomplexobj(array) and array.ndim in (1, 2):
            cells |= _columns(key.removeprefix("measured/"), array.astype(float))
    lengths = {name: len(x) for name, x in cells.items()}
    if len(set(lengths.values())) > 1:
        shortest, longest = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
        raise LogError(
            f"arrays need the same number of samples, '{shortest}' has {lengths[shortest]} and '{longest}' has "
            f"{lengths[longest]}."
        )
    return Table(cells, range(max(lengths.values(), default=0)), "sample", decimal_comma=False)


def _columns(name: str, x: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of one array by name, those of vectors and quaternions by component."""
    if x.ndim == 1:
        return {name: x}
    suffixes = COMPONENTS.get(x.shape[1], range(x.shape[1]))
    return {f"{name}.{suffix}": column for suffix, column in zip(suffixes, x.T, strict=True)}


def short(value: Any) -> str:
    """What somebody wrote, cut to fit a message."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
