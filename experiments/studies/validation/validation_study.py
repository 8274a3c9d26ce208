"""The study of all recordings: what is run, by which workers, and its results."""

import sys
from collections.abc import Mapping, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from experiments.data.validation import Entry, Study, Truth, Validation, Values, from_json
from experiments.runs.workers import Checkpoint, Workers
from experiments.studies.validation.files import Places
from experiments.studies.validation.run import Log, estimates, trial_name, trials_of
from ident.errors import InputError

FILE = "validation.npz"
"""File with the results of the recordings of a run, by which it can be resumed."""
SOURCES = "ident", "sim", "experiments.studies"
"""Packages whose sources make the results: those that others made are not resumed."""


class Task(NamedTuple):
    """Task of one worker at a time: a recording, or one of its trials alone.

    Attributes:
        entry: The recording.
        folder: Folder of its files.
        trial: Logs of the trial to identify alone; None for the recording.
        peers: True to compare with other software.
    """

    entry: Entry
    folder: Path
    trial: tuple[Log, ...] | None = None
    peers: bool = False


def work(task: Task) -> dict[str, Any]:
    """Results of a task, or the sentence with which it is refused."""
    try:
        return estimates(*task)
    except InputError as error:
        return {"refused": str(error)}


def study(entries: Sequence[Entry], places: Places, folder: Path, workers: Workers, *, peers: bool = False) -> Study:
    """Results of recordings.

    Args:
        entries: The recordings.
        places: Where their files are.
        folder: Folder of the file by which the run can be resumed.
        workers: Workers that share the tasks.
        peers: True to compare with other software.

    Raises:
        InputError: No recording has results; the message says why.
    """
    folders, refused = dict[str, Path](), dict[str, str]()
    for entry in entries:
        try:
            if not entry.tried:
                raise InputError(
                    f"{entry.name} is untried and is not run: the registry holds no hash, so that nothing says which "
                    f"files are meant. {entry.note}"
                )
            folders[entry.name] = places.folder(entry)
        except InputError as error:
            refused[entry.name] = str(error)
            if places.fetch:
                print(error, file=sys.stderr)
    tasks = tasks_of([entry for entry in entries if entry.name in folders], folders, peers=peers)
    code = b"".join(file.read_bytes() for name in SOURCES for file in sorted(Path(str(files(name))).rglob("*.py")))
    meaning = {"code": sha256(code).hexdigest(), "tasks": [[str(task.entry), task.trial, task.peers] for task in tasks]}
    kept = Checkpoint("recordings", folder / FILE, meaning)
    answers = workers.collected(work, tasks, kept) if tasks else []
    return collected(entries, tasks, answers, refused)


def tasks_of(entries: Sequence[Entry], folders: Mapping[str, Path], *, peers: bool = False) -> list[Task]:
    """Tasks of recordings, and then of each trial alone for those with several logs, which are shorter."""
    whole = [Task(entry, folders[entry.name], peers=peers) for entry in entries]
    alone = [Task(entry, folders[entry.name], trial) for entry in entries for trial in trials_of(entry)]
    return [*whole, *alone]


def collected(
    entries: Sequence[Entry],
    tasks: Sequence[Task],
    answers: Sequence[Mapping[str, Any]],
    refused: Mapping[str, str] | None = None,
) -> Study:
    """Study of the answers to tasks, of which those of whole recordings come first.

    Raises:
        InputError: There are none; the message says why.
    """
    sentences, made, truths = dict(refused or {}), dict[str, dict[str, Any]](), dict[str, dict[str, Any]]()
    trials: dict[str, dict[str, Any]] = {entry.name: {} for entry in entries}
    for task, answer in zip(tasks, answers, strict=True):
        name = task.entry.name
        if "refused" in answer:
            of_trial = "" if task.trial is None else f"{trial_name(task.trial)}: "
            sentences[name] = f"{sentences.get(name, '')} {of_trial}{answer['refused']}".strip()
        elif task.trial is not None:
            trials[name][trial_name(task.trial)] = answer["values"]
        else:
            for level, known in answer.get("truths", {}).items():
                truths[f"{name} {level}".strip()] = {**known, "entry": name, "level": level}
            if not task.entry.sensor:
                made[name] = {**answer, "trials": trials[name]}
    if not made and not truths:
        raise InputError(next(iter(sentences.values()), "No recording was chosen."))
    return study_of(
        {"recordings": made, "truths": truths, "not_run": sentences}, {entry.name: entry for entry in entries}
    )


def study_of(numbers: Mapping[str, Any], entries: Mapping[str, Entry]) -> Study:
    """Study from its key numbers, of recordings that the registry still has.

    Args:
        numbers: Contents of `summary.json`.
        entries: The registry.
    """
    made = {
        name: from_json(
            Validation,
            answer,
            entry=entries[name],
            trials={trial: from_json(Values, each) for trial, each in answer["trials"].items()},
        )
        for name, answer in numbers["recordings"].items()
    }
    truths = {name: from_json(Truth, each, entry=entries[each["entry"]]) for name, each in numbers["truths"].items()}
    untried = tuple(entry for entry in entries.values() if not entry.tried and entry.name not in made)
    left = {entry.name for entry in untried}
    return Study(made, {name: text for name, text in numbers["not_run"].items() if name not in left}, untried, truths)
