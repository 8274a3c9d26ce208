"""Code shared by the commands on a user's own model and logs: folders, progress, and provenance."""

import argparse
import hashlib
import json
import sys
from collections.abc import Sequence
from dataclasses import fields
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cli.options import as_text
from ident.errors import InputError

if TYPE_CHECKING:
    from ident.estimation.preparation import Part
    from ident.mechanism.mechanism import Mechanism


def folder(args: argparse.Namespace) -> Path:
    """Folder of the results; a folder that holds an input is refused, so that no file of the user's is replaced."""
    name = args.name or f"{args.model.stem if args.model else args.body}-{log_name(args.logs[0])}"
    if not name.isprintable() or Path(name).name != name or name in (".", ".."):
        raise InputError(f"--name is the name of one folder under --out, got {name!r}.")
    out: Path = args.out / name
    for given in inputs(args):
        if Path(realpath(given)).parent == Path(realpath(out)):
            raise InputError(f"The results need a folder without inputs, but '{out}' holds '{given}'; choose another.")
    check_different(args)
    return out


def log_name(log: Path) -> str:
    """Name of a log in the names of folders, that of its first file."""
    # In the address of a page, a name would end at the mark of a dataset's episode.
    return _files(log)[0].stem.replace("#", "-")


def check_different(args: argparse.Namespace) -> None:
    """Refuses a log that is given twice, or to be fitted and to judge by."""
    fitted, judges = ([_resolved(log) for log in several] for several in _logs(args))
    if set(judges) & set(fitted):
        raise InputError("The log to judge by (--held-out) has to be another one than the log that is fitted.")
    if twice := [log for log, own in zip(_logs(args)[0], fitted, strict=True) if fitted.count(own) > 1]:
        raise InputError(f"A log can be fitted once only, but '{twice[-1]}' is given twice.")


def inputs(args: argparse.Namespace) -> list[Path]:
    """All input files."""
    logs = [file for several in _logs(args) for log in several for file in _files(log)]
    return [*filter(None, [args.model]), *logs, *filter(None, [args.columns])]


def _logs(args: argparse.Namespace) -> tuple[list[Path], list[Path]]:
    """Logs that are fitted, and logs to judge by."""
    return [*args.logs, *getattr(args, "loaded", ())], getattr(args, "held_out", [])


def _files(log: Path) -> tuple[Path, ...]:
    from ident.files.readers import files_of

    return files_of(log)


def _resolved(log: Path) -> tuple[str, ...]:
    """Places of a log's files in sorted order, so that logs can be compared; a file has one under all of its names."""
    return tuple(sorted(_place(file) for file in _files(log)))


def _place(file: Path) -> str:
    """Place of a file on its disk; its path if it is none."""
    try:
        place = file.stat()
    except OSError:
        return realpath(file)
    return f"{place.st_dev} {place.st_ino}" if place.st_ino else realpath(file)


def progress(round_: int, step: float) -> None:
    """Prints the progress of the estimate, if stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\rround {round_ + 1}: parameters move by {step:.2g} of their deviations ", end="", file=sys.stderr)


def provenance(args: argparse.Namespace, logs: Sequence["Part[slice]"]) -> dict[str, Any]:
    """Options, versions and commit, and the input files with their SHA-256 sums, so that a log can be recognized.

    Args:
        args: The options.
        logs: The fitted parts of the logs.
    """
    from experiments.document.result_folder import provenance as origin

    fitted = [
        file_entry(path)
        | {"samples": len(log.samples), "rate_hz": log.recording.rate, "fitted": [part.start, part.stop]}
        for path, (log, part) in zip(args.logs, logs, strict=True)
    ]
    judges = [file_entry(path) for path in _logs(args)[1]]
    files = {"model": args.model and file_entry(args.model), "logs": fitted, "held_out": judges}
    given = {key: value for key, value in as_text(args).items() if key != "workers"}
    return origin(given, files | ({"columns": file_entry(args.columns)} if args.columns else {}))


def file_entry(path: Path) -> dict[str, Any]:
    """Name and SHA-256 sum of a file, or of each file of a log in several files or in a folder."""
    from ident.files.readers import files_in

    files = [each for file in _files(path) for each in files_in(file)]
    sums = [{"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()} for file in files]
    return {"files": sums} if path.is_dir() or len(sums) > 1 else sums[0]


def model_sum(mechanism: "Mechanism") -> str:
    """SHA-256 sum of what was read of a model, from whichever files; not of what is only shown, such as meshes."""
    import numpy as np

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        return {each.name: getattr(value, each.name) for each in fields(value) if each.name != "source"}

    return hashlib.sha256(json.dumps(mechanism, default=plain).encode()).hexdigest()
