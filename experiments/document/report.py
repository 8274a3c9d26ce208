"""Tables in four formats, atomically written result folders, and provenance of results."""

import csv
import importlib.metadata
import io
import json
import math
import os
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import product
from numbers import Integral
from pathlib import Path
from typing import Any

from experiments.document import escape, print_table, terminal
from experiments.document.layout import PAPER, Layout, unit_of
from experiments.runs.signals import held_back
from ident.errors import InputError
from ident.files.atomic import PARTIAL, claimed, unwritten
from ident.geometry.inertia import body_of_parameter

Cell = str | float | None


@dataclass(frozen=True)
class Table:
    """A table of results.

    Attributes:
        title: Title, for the screen and for pages.
        columns: Column names of the CSV file; elsewhere `heading`s of them.
        rows: Cells: texts, numbers, or None if empty; empty columns are in the CSV file alone.
        decimals: Decimals of numbers, except in the CSV file, which keeps all digits; counts have none.
        marked: First cells of the rows that get an asterisk, except in the CSV file.
        footnote: Meaning of the asterisk.
        caption: Caption in print, by default the title.
        notes: Further notes in print.
        bodies: Names of the bodies of the parameters in the first column, numbered from 1.
        units: Units of the rows, by default those of the parameters if there are bodies.
        heads: Headings that `heading` would not form.
        names: Texts that replace first cells, except in the CSV file.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    decimals: int = 3
    marked: frozenset[str] = frozenset()
    footnote: str = ""
    caption: str = ""
    notes: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    heads: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)

    def csv(self) -> str:
        """Comma-separated values with full precision; if bodies have names, a column holds each parameter's body.

        Texts that spreadsheets would read as formulas follow an apostrophe.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        owners = [body_of_parameter(str(row[0]), self.bodies) for row in self.rows] if self.bodies else []
        first, *more = self.columns
        writer.writerow(map(escape.cell, [first, *["body"] * bool(owners), *more]))
        for k, row in enumerate(self.rows):
            cells = [row[0], *owners[k : k + 1], *row[1:]]
            writer.writerow([escape.cell(cell) if isinstance(cell, str) else cell for cell in cells])
        return out.getvalue()

    def filled(self) -> "Table":
        """The table without empty columns."""
        kept = [k for k in range(len(self.columns)) if k == 0 or any(row[k] not in (None, "") for row in self.rows)]
        if not self.rows or len(kept) == len(self.columns):
            return self
        columns = tuple(self.columns[k] for k in kept)
        return replace(self, columns=columns, rows=tuple(tuple(row[k] for k in kept) for row in self.rows))

    def markdown(self) -> str:
        """A Markdown table under its title, numbers right-aligned."""
        if (filled := self.filled()) is not self:
            return filled.markdown()
        rule = ["---:" if numeric else "---" for numeric in self.numeric()]
        head = list(map(escape.markdown, self.headings()))
        table = "".join(f"| {' | '.join(row)} |\n" for row in [head, rule, *self.texts(escape.markdown)])
        title = f"**{escape.markdown(self.title)}**\n\n" if self.title else ""
        return title + table + (f"\n\\* {escape.markdown(self.footnote)}\n" if self.footnote else "")

    def tex(self, label: str = "", layout: Layout = PAPER) -> str:
        """A table in a journal's style, with a label for references."""
        return print_table.tex(self.shown(layout).filled(), label, layout)

    def text(self) -> str:
        """Aligned columns for the terminal, without the column of units."""
        if (filled := self.filled()) is not self:
            return filled.text()
        kept = [k for k in range(len(self.headings())) if not (k == 1 and self._units())]
        heads, *rows = ([line[k] for k in kept] for line in (self.headings(), *self.texts()))
        lines = terminal.table(heads, rows, [self.numeric()[k] for k in kept])
        note = [terminal.wrapped(f"* {self.footnote}")] if self.footnote else []
        return "\n".join([terminal.wrapped(self.title), *lines, *note, ""])

    def write(self, folder: Path, name: str, layout: Layout = PAPER) -> None:
        """Writes `name.csv`, `name.md` and `name.tex` into a folder."""
        for suffix, content in (("csv", self.csv()), ("md", self.markdown()), ("tex", self.tex(name, layout))):
            (folder / f"{name}.{suffix}").write_text(content, encoding="utf-8")

    def shown(self, layout: Layout) -> "Table":
        """The table with only the parameters that an author wants."""
        if not self.bodies:
            return self
        kept = [k for k, row in enumerate(self.rows) if layout.shows(str(row[0]), self.bodies)]
        units = tuple(self.units[k] for k in kept) if self.units else ()
        return replace(self, rows=tuple(self.rows[k] for k in kept), units=units)

    def headings(self) -> list[str]:
        """Column names in words, with one for the units of the rows."""
        first, *more = (self.heads.get(name, heading(name)) for name in self.columns)
        return [first, *["unit"] * bool(self._units()), *more]

    def texts(self, escaped: Callable[[str], str] = str) -> list[list[str]]:
        """Rows as text, with cells written by `escaped`."""
        units, rows = self._units(), []
        for k, (first, *more) in enumerate(self.rows):
            cells = [self._text(cell, escaped) for cell in more]
            rows.append([self._name(first, escaped), *map(escaped, units[k : k + 1]), *cells])
        return rows

    def numeric(self) -> list[bool]:
        """True for each column that holds only numbers."""
        first, *more = [not any(isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]
        return [first, *[False] * bool(self._units()), *more]

    def _units(self) -> tuple[str, ...]:
        """Units of the rows; empty if unknown."""
        return self.units or tuple(unit_of(str(row[0])) or "" for row in self.rows if self.bodies)

    def _name(self, cell: Cell, escaped: Callable[[str], str]) -> str:
        """A row's first cell: a parameter with the name of its body."""
        text = escaped(self.names[cell]) if isinstance(cell, str) and cell in self.names else self._text(cell, escaped)
        body = body_of_parameter(cell, self.bodies) if isinstance(cell, str) else None
        # Concatenated, not formatted: in pages the parts are HTML already.
        return text if body is None else text + " of " + escaped(body)

    def _text(self, cell: Cell, escaped: Callable[[str], str]) -> str:
        if cell is None:
            return ""
        if isinstance(cell, str):
            return escaped(cell) + ("*" if cell in self.marked else "")
        return escaped(number(cell, self.decimals))


UNITS = ("deg", "rad", "N", "s", "mm")
"""Units at the end of names of columns, options and other numbers."""

_HEADINGS = {
    rf"_({'|'.join(UNITS)})$": r" (\1)",
    r"_(simplified|full|joint|paper|scene|weighted|ignoring|relative|updated_model)$": r", \1",
    "^paper_": "paper's ",
    r"(?<![^_ ])std(?![^_, ])": "s.d.",
    r"(?<![^_])rms(?![^_, ])": "RMS",
    "_wrench_noise$": " (wrench noise)",
    "_95$": ", 95 %",
    "_": " ",
}


def heading(name: str) -> str:
    """A column's name in words: `paper_error_full` becomes `paper's error, full`."""
    for pattern, words in _HEADINGS.items():
        name = re.sub(pattern, words, name)
    return name


def number(value: float, decimals: int = 3) -> str:
    """A number as text with so many decimals, or as a power of ten from a million on.

    Integers, also numpy's, have no decimals; booleans have.
    """
    if _whole(value):
        return str(value)
    # Adding zero turns a rounded -0.0 into 0.0.
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if abs(value) < 1e6 else f"{value:.2e}"


OUTPUTS = ("table_*", "figure_*", "monte_carlo*", "film.*")
"""Patterns of the files that a study writes, besides `summary.json` and `provenance.json`."""


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Writes indented JSON; bytes in file names that are not text become escapes."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")


@contextmanager
def results_folder(out: Path, stale: Sequence[str] = (), inputs: Sequence[Path] = ()) -> Iterator[Path]:
    """Yields a temporary folder whose files move to `out` together if the block succeeds; else `out` stays unchanged.

    Args:
        out: Folder for the results, made if missing; other files in it stay.
        stale: Patterns of files of an earlier run to remove.
        inputs: Input files, which are never replaced.

    Raises:
        InputError: `out` is a file, cannot be written, or a folder or an input stands where a file has to go.
        OSError: The results could not be written, e.g. on a full disk; the sentence names `out`.
    """
    with unused_vanish(out), unwritten(out), _scratch(out) as (new, old):
        yield new
        with held_back():
            _exchange(new, old, out, stale, inputs)


@contextmanager
def writable(out: Path) -> Iterator[None]:
    """Checks before the block's work that a folder can be written.

    Raises:
        InputError: As for `results_folder`.
    """
    with unused_vanish(out):
        with results_folder(out):
            pass
        yield


@contextmanager
def unused_vanish(out: Path) -> Iterator[None]:
    """Removes the folders that a failed block has made, `out` and its parents, if they are empty."""
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        yield
    except BaseException:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise


def check_inputs(written: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Checks that no input is overwritten, under any name.

    Raises:
        InputError: One of the files to write is an input.
    """
    for path, given in product(written, inputs):
        if path.exists() and given.exists() and path.samefile(given):
            raise InputError(f"The results would replace '{path}', which is the input '{given}'; choose another --out.")


@contextmanager
def _scratch(out: Path) -> Iterator[tuple[Path, Path]]:
    """Yields folders in `out` for the new files and for the replaced ones; both are removed when the block ends."""
    with ExitStack() as stack:
        try:
            out.mkdir(parents=True, exist_ok=True)
            scratch = stack.enter_context(
                claimed(out, lambda: Path(tempfile.mkdtemp(prefix=PARTIAL, dir=out)), _cleared)
            )
        except OSError as error:
            raise InputError(
                f"The output path needs to be a writable folder, got '{out}' ({error.strerror})."
            ) from error
        new, old = scratch / "new", scratch / "old"
        try:
            new.mkdir()
            old.mkdir()
            yield new, old
        except BaseException:
            # Files that could not be put back stay in `old`.
            shutil.rmtree(new, ignore_errors=True)
            for folder in (old, scratch):
                with suppress(OSError):
                    folder.rmdir()
            raise
        shutil.rmtree(scratch, ignore_errors=True)


def _cleared(left: Path) -> None:
    """Removes the remains of a killed run, after putting back the files that it was replacing."""
    if not left.is_dir():
        left.unlink()
        return
    for file in (left / "old").glob("*"):
        file.replace(left.parent / file.name)
    shutil.rmtree(left)


def _exchange(new: Path, old: Path, out: Path, stale: Sequence[str], inputs: Sequence[Path]) -> None:
    """Moves all files of `new` to `out`, and the files that they replace to `old`; all of them or none."""
    names = {file.name for file in new.iterdir()}
    gone = {file.name for pattern in stale for file in out.glob(pattern)} | {n for n in names if (out / n).exists()}
    check_inputs((out / name for name in gone), inputs)
    for name in gone:
        if (out / name).is_dir():
            raise InputError(f"The output path needs room for a file '{name}', but '{out / name}' is a folder.")
    moved: list[tuple[Path, Path]] = []
    try:
        for name, source, target in [(n, out, old) for n in gone] + [(n, new, out) for n in names]:
            (source / name).replace(target / name)
            moved.append((source / name, target / name))
        # A folder `old` would mark these moves as unfinished.
        old.replace(old.with_name("replaced"))
    except OSError as error:
        for source, target in reversed(moved):
            with suppress(OSError):
                target.replace(source)
        left = f"; earlier files are in '{old}'" if any(old.iterdir()) else ""
        raise InputError(
            f"The results could not be moved to '{out}' ({error.strerror}: '{error.filename}'){left}."
        ) from error


def provenance(options: Mapping[str, Any], recording: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Everything needed to repeat a study: options, scene, versions and commit."""
    packages = ("multicontact", "mujoco", "numpy", "scipy", "matplotlib")
    return {
        "options": dict(options),
        "recording": dict(recording or {}),
        "versions": {"python": platform.python_version()} | {name: version(name) for name in packages},
        "git_commit": _git_commit(),
    }


def version(package: str) -> str | None:
    """Version of an installed package; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git_commit() -> str | None:
    """Commit of the checkout that this code runs from, `-dirty` if files differ; None for an installed copy."""
    here = Path(__file__).resolve()
    # A git hook's environment points to another repository.
    environment = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}

    def git(*arguments: str) -> str:
        # A lock on the checkout would remain if this process's group was killed, or the disk was full.
        command = ["git", "--no-optional-locks", "-C", str(here.parents[2]), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", str(here))
        # `git describe --dirty` would lock nevertheless.
        differs = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "HEAD") + ("-dirty" if differs else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def columns(**named: Iterable[Cell]) -> tuple[tuple[str, ...], tuple[tuple[Cell, ...], ...]]:
    """Column names and rows of a `Table` from its columns; NaN becomes an empty cell, and counts remain counts."""
    return tuple(named), tuple(zip(*(map(_cell, _alike(list(column))) for column in named.values()), strict=True))


def _alike(column: list[Cell]) -> list[Cell]:
    """A column whose numbers are all integers, or all floats."""
    numbers = [cell for cell in column if cell is not None and not isinstance(cell, str)]
    if all(map(_whole, numbers)):
        return column
    return [cell if cell is None or isinstance(cell, str) else float(cell) for cell in column]


def _whole(value: float) -> bool:
    """True for a count, by its type."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def _cell(value: Cell) -> Cell:
    return None if isinstance(value, float) and math.isnan(value) else value
