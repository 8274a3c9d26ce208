"""Identifies base parameters from many logs one by one: a folder for each, one table of all, and what failed."""

import argparse
import contextlib
import errno
import gc
import io
import time
import traceback
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import identify
from experiments.cli import options, running
from ident.display.brief import listed
from ident.errors import InputError

if TYPE_CHECKING:
    from experiments.data.comparison import LogOutcome
    from ident.mechanism.mechanism import Mechanism

PROGRESS = "batch_outcomes.npz"
"""File with the outcomes so far, by which an interrupted run is resumed."""

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
"""Errors of the disk rather than of a log: they end the batch, which can be resumed once there is room."""

MODEL = ("base", "ignore", "fix", "packages", "base_rpy_deg", "person", "columns")
"""Options that say how the model is read."""


def run(args: argparse.Namespace) -> None:
    """Identifies every log, and writes and prints a table of all.

    Raises:
        InputError: Logs failed, a worker died at the log that is named, or results are damaged or cannot be written.
    """
    from experiments.data.comparison import LogOutcome, agreement, covariance_of
    from experiments.document.result_folder import check_inputs, provenance, writable
    from experiments.document.writer import write
    from experiments.reports import batch_report
    from experiments.runs.workers import Checkpoint, DeadWorkerError
    from ident.files.atomic import alone

    tasks = tasks_of(args)
    arm = check_shared(args)
    out = options.output_of(args)
    check_inputs([out.folder / PROGRESS], options.inputs(args))
    with writable(out.folder), alone(out.folder):
        kept = Checkpoint("logs", out.folder / PROGRESS, _identity(args, arm), check_outcomes)
        try:
            made = options.workers_of(args).collected(outcome_in_json, tasks, kept, is_lost)
        except DeadWorkerError as error:
            raise InputError(f"{error.task.logs[0]}: {error}") from None
        outcomes = [LogOutcome(**each) for each in made]
        fitted = [(task, each.values) for task, each in zip(tasks, outcomes, strict=True) if not each.error]
        covariances = [covariance_of(options.folder(task), tuple(values)) for task, values in fitted]
        agreed = agreement([values for _, values in fitted], covariances)
        document = batch_report.document(args.model, outcomes, agreed, arm, provenance(kept.identity))
        write(document, out, stale=batch_report.OUTPUTS)
    if failed := [each.log for each in outcomes if each.error]:
        raise InputError(f"{len(failed)} of {len(outcomes)} logs failed: {listed(failed, 3)}.")


def tasks_of(args: argparse.Namespace) -> list[argparse.Namespace]:
    """The options of each log's identification, which writes into a folder of its own.

    Raises:
        InputError: A log is given twice, an input is in a folder of the results, or a log's folder would have the name
            of a file of the batch's own.
    """
    from experiments.document.writer import PAGE
    from experiments.reports.batch_report import OUTPUTS

    names = [options.log_name(log) for log in args.logs]
    # With a number for all if two names are the same, so that no numbered name is another log's own.
    alike = len(set(names)) < len(names)
    unique = [f"{name}_{k}" if alike else name for k, name in enumerate(names, start=1)]
    tasks = [
        argparse.Namespace(**{**vars(args), "workers": 1, "logs": [log], "name": name})
        for log, name in zip(args.logs, unique, strict=True)
    ]
    options.check_different(args)
    own = (*OUTPUTS, PAGE, "provenance.json", PROGRESS, f"{Path(PROGRESS).stem}_before.npz")
    for task in tasks:
        # Not all systems tell capital letters in names.
        if any(fnmatchcase(task.name.lower(), pattern) for pattern in own):
            raise InputError(
                f"The folder of the log '{task.logs[0]}' would be '{task.name}', but that is kept for the batch's own "
                f"files ({', '.join(own)}); rename the log."
            )
        options.folder(task)
    return tasks


class FullDiskError(InputError):
    """Results of no log can be written."""


def is_lost(task: argparse.Namespace, outcome: Mapping[str, Any]) -> bool:
    """True if the results of a log that did not fail are not as they were written."""
    folder = options.folder(task)
    return not outcome["error"] and not (outcome["files"] and sums_of(folder, outcome["files"]) == outcome["files"])


def sums_of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """SHA-256 sums of those files of a folder that exist, by name."""
    files = [folder / name for name in names if (folder / name).is_file()]
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in files}


def check_outcomes(outcomes: Sequence[Any]) -> None:
    """Checks that outcomes of an earlier run are whole.

    Raises:
        InputError: One is damaged.
        TypeError: One has other fields.
    """
    from experiments.data.comparison import LogOutcome
    from ident.annotations import misfit

    for given in (each for each in outcomes if each is not None):
        if wrong := misfit(LogOutcome, vars(LogOutcome(**given))):
            raise InputError(f"an outcome is damaged: {wrong}")


def check_shared(args: argparse.Namespace) -> "Mechanism":
    """The model, read as what all logs share is: the model, the mapping of columns and the logs to judge by.

    A fault of these would fail every log, and replace the tables of an earlier batch by one of failures.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    from experiments.studies.user_files import prepare, read_mechanism
    from ident.recordings.mapping import read_mapping

    read = identify.reading(args)
    arm = read_mechanism(args.model, **{key: read[key] for key in MODEL})
    if args.columns is not None:
        read_mapping(args.columns, arm.tree)
    for log in args.held_out:
        prepare(args.model, log, **read)
    return arm


def outcome_in_json(task: argparse.Namespace) -> dict[str, Any]:
    """Outcome of one log, whose results are written, in JSON types."""
    outcome = outcome_of(task).to_dict()
    # Estimates and figures hold cycles, 24 MB of a log of three joints, which wait for a rare collection otherwise.
    gc.collect()
    return outcome


def outcome_of(task: argparse.Namespace) -> "LogOutcome":
    """Outcome of one log, whose results are written; a failure is an outcome as well.

    Raises:
        FullDiskError: Results of no log can be written.
    """
    from experiments.data.comparison import LogOutcome
    from experiments.document.writer import written
    from experiments.reports import identify_report

    begun, name = time.process_time(), str(task.logs[0])
    try:
        folder = options.folder(task)
        with contextlib.redirect_stderr(io.StringIO()):
            result, document, out = identify.identified_from(task, folder)
            written(document, out, stale=identify_report.OUTPUTS, inputs=options.inputs(task))
    except (InputError, OSError, MemoryError) as error:
        if {getattr(each, "errno", None) for each in (error, error.__cause__)} & FULL:
            raise FullDiskError(f"{name}: {error}") from None
        return LogOutcome(name, error=str(error) or type(error).__name__, seconds=time.process_time() - begun)
    except Exception as error:
        # One log must not end the others; what is printed is for a report of the fault.
        traceback.print_exc()
        sentence = f"This is a fault of multicontact: {type(error).__name__}: {error}"
        return LogOutcome(name, error=sentence, seconds=time.process_time() - begun)
    known = [each for each in result.parameters if each.kind in ("base", "drive")]
    verdict = result.verdict()
    return LogOutcome(
        log=name,
        folder=folder.name,
        verdict=verdict.outcome.value,
        doubts=list(verdict.doubts),
        predicted=list(verdict.predicted),
        missed=list(verdict.missed),
        ratios=dict(zip(result.channels, result.held_out.ratio.tolist(), strict=True)),
        values={each.name: each.estimate for each in known},
        std={each.name: each.std_setup for each in known},
        units={each.name: each.unit for each in known},
        seconds=time.process_time() - begun,
        files=sums_of(folder, (file.name for file in folder.iterdir())),
    )


def _identity(args: argparse.Namespace, arm: "Mechanism") -> dict[str, Any]:
    """Options that all outcomes share, and the SHA-256 sums of the files and of the model, which may include others."""
    left_out = ("out", "workers", "resume", "logs", "held_out", "model", "columns")
    given = {key: value for key, value in options.as_text(args).items() if key not in left_out}
    model = _file_entry(args.model) | {"as_read": options.model_sum(arm)}
    files = [_file_entry(file) for file in [*([args.columns] if args.columns else []), *args.logs, *args.held_out]]
    return {"options": given, "logs": list(map(str, args.logs)), "files": [model, *files]}


def _file_entry(file: Path) -> dict[str, Any]:
    """Sums of a file's contents; its name alone if it cannot be read."""
    try:
        return options.file_entry(file)
    except OSError:
        return {"file": str(file)}


OPTIONS: options.Options = {
    **options.output("results/batch", "svg"),
    **options.MODEL,
    **options.logs("each by itself"),
    **identify.IDENTIFICATION,
    **options.WORKERS,
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.batch", __doc__, run, OPTIONS)
