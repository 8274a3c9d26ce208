"""The study of all recordings, each identified with the command's defaults by one of several workers."""

import json
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from experiments.data import validation
from experiments.data.validation import ESTIMATE, LEAST_SQUARES, MODEL, Entry, StatedValue, Study
from experiments.runs.workers import Checkpoint, Workers
from experiments.studies.user_files import prepare, read_mechanism
from experiments.studies.validation.files import Places, checked, columns_file, convert, converted
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.noise import channel_unit
from ident.estimation.preparation import Prepared
from ident.geometry.inertia import parameters_from_com
from ident.identification import identified
from ident.judgement.residuals import differences
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import KNOWN, drive_precision, known_covariance
from ident.payload import QUANTITIES, UNITS, RigidBody, described
from ident.payload.beyond_sensor import identify_payload
from ident.payload.load import identify_load
from ident.recordings.log import read_log
from ident.setup import PRIORS
from ident.tolerances import HOLDOUT, INTERVAL
from sim.models.notes import ModelNote

FILE = "validation.npz"
"""File with the results of the recordings of a run, by which it can be resumed."""
SOURCES = "ident", "sim", "experiments.studies"
"""Packages whose sources make the results: those that others made are not resumed."""


BODY = "tool"
"""Name of a body alone in the columns files."""


def of_estimate(entry: Entry, folder: Path, estimate: Estimate, results: Mapping[str, Any]) -> dict[str, Any]:
    """Known base parameters and drives of an entry, empty without any.

    The set-up of a simulation is exact, so that its intervals are those from the noise.

    Args:
        entry: The recording.
        folder: Folder of its files.
        estimate: Its estimate.
        results: Results of that in JSON types.
    """
    own, known = results["values"], dict[str, StatedValue]()
    if entry.true_files:
        model = read_mechanism(folder / entry.true_files[0], base=entry.options.get("base"))
        true = replace(estimate.fit.equations, mechanism=model).from_model
        known |= {name: StatedValue(name, float(x), 0.0) for name, x in zip(own["names"], true, strict=False)}
    known |= {each.name: each for each in entry.truth if not entry.body}
    if not known:
        return {}
    at = [own["names"].index(name) for name in known]
    std = "std" if entry.true_files else "std_setup"
    names, units, x, half = ([own[key][k] for k in at] for key in ("names", "units", "values", std))
    ends = np.array(x)[:, None] + INTERVAL * np.outer(half, [-1, 1])
    rivals = {name: [x[k] for k in at] for name, x in results["rivals"].items()}
    return _beside(list(known.values()), names, units, x, ends, rivals=rivals)


def _beside(
    known: Sequence[StatedValue],
    names: Sequence[str],
    units: Sequence[str],
    values: ArrayLike,
    ends: np.ndarray,
    **more: Any,
) -> dict[str, Any]:
    """Known parameters in JSON types, with estimates and the ends of their 95 % intervals (p, 2)."""
    true, tolerance = [each.value for each in known], np.nan_to_num([each.std for each in known])
    numbers = {"values": values, "lower": ends[:, 0], "upper": ends[:, 1], "true": true, "tolerance": tolerance}
    lists = {key: np.asarray(x, float).tolist() for key, x in numbers.items()}
    return {"names": list(names), "units": list(units), **lists, "rivals": {}, **more}


def of_load(entry: Entry, paths: Mapping[str, Path]) -> dict[str, Any]:
    """Known quantities of a load that a body carries in some logs of an entry.

    Args:
        entry: The recording.
        paths: Paths of its files by name.
    """
    start, robot = time.process_time(), read_mechanism(paths[entry.model], base=entry.options.get("base"))
    columns = columns_file(entry.options["columns"])
    logs = ([read_log(paths[name], robot, columns) for (name,) in several] for several in (entry.empty, entry.loaded))
    body = identify_load(robot, *logs, body=entry.body).in_frame()
    at = [QUANTITIES.index(each.name) for each in entry.truth]
    names, units = ([each[k] for k in at] for each in (QUANTITIES, UNITS))
    values, ends, seconds = body.values[at], body.intervals[at], time.process_time() - start
    return _beside(entry.truth, names, units, values, ends, seconds=seconds)


def of_bodies(entry: Entry, folder: Path, scratch: Path) -> dict[str, Any]:
    """Known mass, centre and inertia of bodies, each alone on a wrench sensor in a log, by level of added noise.

    Args:
        entry: The recording.
        folder: Folder of its files.
        scratch: Folder for files with noise.
    """
    out, alone = dict[str, Any](), Mechanism.lone_body(BODY)
    fitting: dict[str, Any] = {"body": BODY, "sensor": entry.sensor, "offsets": entry.options.get("offsets", True)}
    # The set-up of a simulation is exact.
    fitting |= {"holdout": 0.0, "setup": dict.fromkeys(PRIORS, 0.0)}
    names = [f"{Path(log).stem} {name}" for (log,) in entry.fitted for name in QUANTITIES]
    true = np.concatenate([_body(folder / file) for file in entry.true_files])
    known = [StatedValue(name, x, 0.0) for name, x in zip(names, true.tolist(), strict=True)]
    for level, converter in entry.options["noise"].items():
        start, bodies = time.process_time(), list[RigidBody]()
        for (log,) in entry.fitted:
            convert(converter, folder / log, scratch / log)
            recording = read_log(scratch / log, alone, columns_file(entry.options["columns"]))
            bodies.append(identify_payload(alone, recording, **fitting).in_frame())
        values, ends = (np.concatenate([getattr(body, key) for body in bodies]) for key in ("values", "intervals"))
        seconds = time.process_time() - start
        out[level] = _beside(known, names, UNITS * len(bodies), values, ends, seconds=seconds)
    return out


def _body(path: Path) -> np.ndarray:
    """Quantities of a body (10,) in a JSON file, with `mass`, `centre` and `inertia_about_centre`."""
    known = json.loads(path.read_text(encoding="utf-8"))
    centre, inertia = (np.array(known[key], float) for key in ("centre", "inertia_about_centre"))
    return described(parameters_from_com(known["mass"], centre, inertia))


Log = tuple[str, ...]
"""Names of the files of a log."""


def trial_name(trial: Sequence[Log]) -> str:
    """Name of a trial by the first file of each of its logs."""
    return ", ".join(Path(log[0]).stem for log in trial)


def trials_of(entry: Entry) -> list[tuple[Log, ...]]:
    """Trials of a recording that are compared: its logs, or, of more than three, which are short, every other one."""
    logs = entry.logs
    if len(logs) < 2 or entry.sensor:
        return []
    return [(log,) for log in logs] if len(logs) <= 3 else [logs[::2], logs[1::2]]


class Task(NamedTuple):
    """Task of one worker at a time: a recording, or one of its trials alone.

    Attributes:
        entry: The recording.
        folder: Folder of its files.
        trial: Logs of the trial, which is fitted whole; None for the fitted logs, with those to judge by.
        peers: True to compare with other software.
    """

    entry: Entry
    folder: Path
    trial: tuple[Log, ...] | None = None
    peers: bool = False


def work(task: Task) -> dict[str, Any]:
    """Results of a task, or the sentence with which it is refused."""
    try:
        return _estimates(*task)
    except InputError as error:
        return {"refused": str(error)}


def _estimates(entry: Entry, folder: Path, trial: tuple[Log, ...] | None, peers: bool) -> dict[str, Any]:
    """Results of an entry, or the values of one of its trials identified alone.

    Raises:
        InputError: A file is another one than that tried, or the recording cannot be identified.
    """
    unchecked = checked(entry, folder)
    with TemporaryDirectory() as scratch, warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelNote)
        if entry.sensor:
            return {"truths": of_bodies(entry, folder, Path(scratch))}
        paths = converted(entry, folder, Path(scratch))
        if trial is not None:
            return {"values": values(_identified(entry, paths, trial, [], holdout=0.0)[0])}
        estimate, seconds = _identified(entry, paths, entry.fitted, entry.judged)
        made = results(estimate)
        if peers:
            from experiments.studies.validation.peers import compared

            judges = [_prepared(entry, paths, log) for log in entry.judged]
            logs = [[paths[name] for name in log] for log in entry.fitted]
            made["peers"] = compared(paths[entry.model], estimate, judges, logs)
        known = of_estimate(entry, folder, estimate, made)
        truths = {"": known | {"seconds": seconds}} if known else {}
        if entry.body:
            truths["load"] = of_load(entry, paths)
        return {**made, "seconds": seconds, "unchecked": list(unchecked), "truths": truths}


def _identified(
    entry: Entry, paths: Mapping[str, Path], fitted: Sequence[Log], judged: Sequence[Log], holdout: float = HOLDOUT
) -> tuple[Estimate, float]:
    """Estimate from logs, and its CPU time in s, reading included."""
    start = time.process_time()
    logs, judges = ([_prepared(entry, paths, log) for log in several] for several in (fitted, judged))
    known = entry.options.get("prior")
    return identified(logs, holdout=holdout, judges=judges, known=known), time.process_time() - start


def _prepared(entry: Entry, paths: Mapping[str, Path], log: Log) -> Prepared:
    """A log with the options of its entry."""
    options: dict[str, Any] = {key: x for key, x in entry.options.items() if key not in ("columns", "prior")}
    if "columns" in entry.options:
        options["columns"] = columns_file(entry.options["columns"])
    path = paths[log[0]] if len(log) == 1 else Path("+".join(str(paths[name]) for name in log))
    return prepare(paths[entry.model], path, filters=False, **options)


def values(estimate: Estimate) -> dict[str, Any]:
    """Base parameters and drives of an estimate, with their standard deviations and the prior's."""
    count = estimate.base.rank + len(estimate.fit.equations.drives)
    return {
        "names": list(estimate.fit.names[:count]),
        "values": estimate.fit.values[:count].tolist(),
        "std": estimate.fit.std[:count].tolist(),
        "std_setup": np.sqrt(np.diag(estimate.covariance_setup))[:count].tolist(),
        "prior": [x if np.isfinite(x) else None for x in prior_std(estimate).tolist()],
        "units": [each.unit for each in estimate.parameters[:count]],
    }


def prior_std(estimate: Estimate) -> np.ndarray:
    """Standard deviations of the prior of base parameters and drives, infinite where there is none (p,)."""
    equations, mechanism = estimate.fit.equations, estimate.prepared.mechanism
    out = np.full(estimate.base.rank + len(equations.drives), np.inf)
    if estimate.trajectory is None or not estimate.trajectory.known:
        return out
    known = {**KNOWN, **estimate.prepared.recording.known}
    out[: estimate.base.rank] = np.sqrt(np.diag(known_covariance(mechanism, estimate.base, known, equations.absorbed)))
    precision = drive_precision(mechanism, equations.drives, equations.scaled)
    out[estimate.base.rank :] = np.where(precision > 0, 1 / np.sqrt(np.where(precision > 0, precision, 1)), np.inf)
    return out


def results(estimate: Estimate) -> dict[str, Any]:
    """Values, predictions, agreement of halves and verdict of an estimate."""
    verdict, trajectory, held = estimate.verdict(), estimate.trajectory, estimate.held_out
    halves = None if trajectory is None else differences(trajectory)
    count = estimate.base.rank + len(estimate.fit.equations.drives)
    rivals = {MODEL: estimate.fit.equations.from_model, LEAST_SQUARES: estimate.filtered_values}
    return {
        "values": values(estimate),
        "rivals": {name: x[:count].tolist() for name, x in rivals.items() if x is not None},
        "channels": list(estimate.channels),
        "units": [channel_unit(channel, estimate.prepared.mechanism.tree) for channel in estimate.channels],
        "ratios": {
            **{name: np.asarray(estimate.rivals[name]).tolist() for name in (MODEL, LEAST_SQUARES)},
            ESTIMATE: held.ratio.tolist(),
        },
        "at_rest": {
            name: [r if np.isfinite(r) else None for r in held.ratio_at_rest(x).tolist()]
            for name, x in {**held.rivals, ESTIMATE: held.residual}.items()
        },
        "halves": [] if halves is None else halves.tolist(),
        "widening": estimate.widening,
        "outcome": verdict.outcome.value,
        "verdict": str(verdict),
        "doubts": list(verdict.doubts),
        "samples": [sum(len(each.indices) for each in estimate.logs), len(held.time)],
        "cutoff": estimate.filtered_at,
    }


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
        name: validation.from_json(
            validation.Validation,
            answer,
            entry=entries[name],
            trials={trial: validation.from_json(validation.Values, each) for trial, each in answer["trials"].items()},
        )
        for name, answer in numbers["recordings"].items()
    }
    truths = {
        name: validation.from_json(validation.Truth, each, entry=entries[each["entry"]])
        for name, each in numbers["truths"].items()
    }
    untried = tuple(entry for entry in entries.values() if not entry.tried and entry.name not in made)
    left = {entry.name for entry in untried}
    return Study(made, {name: text for name, text in numbers["not_run"].items() if name not in left}, untried, truths)
