"""Folders of results: their provenance, and files that are replaced together."""

import importlib.metadata
import json
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import Any

from experiments.runs import held_back
from ident.errors import InputError
from ident.files.atomic import PARTIAL, claimed, unwritten


def provenance(options: Mapping[str, Any], recording: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Everything needed to repeat a study: options, scene, versions and commit."""
    versions = {name: version(name) for name in ("multicontact", "mujoco", "numpy", "scipy", "matplotlib")}
    return {
        "options": dict(options),
        "recording": dict(recording or {}),
        "versions": {"python": platform.python_version()} | versions,
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


OUTPUTS = ("table_*", "figure_*", "monte_carlo*")
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
