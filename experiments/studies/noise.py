"""Estimators of base parameters, and what noise on the joint sensors does to each: errors over many recordings."""

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.runs.checkpoint import Checkpoint
from experiments.runs.workers import worker_pool
from experiments.studies import competitors
from experiments.studies.errors import Errors
from experiments.studies.noisy_recordings import CONDITIONS, SUBJECTS, Subject, noisy_recording
from ident.errors import InputError
from ident.estimation.in_order import in_order
from ident.identification import identify
from ident.mechanism.motion import Motion
from ident.recordings.recording import Recording

FILE = "fits.npz"
"""File in the output folder that keeps what every recording gave."""

Found = tuple[np.ndarray, np.ndarray]
"""Base parameters, and the standard deviations that the estimator says they have, each (r,)."""


def identified(who: Subject, recording: Recording, estimator: str, cutoff: str | None = None) -> Found:
    """By `ident.identify`, from all samples and without offsets."""
    found = identify(who.mechanism, recording, estimator=estimator, cutoff=cutoff, offsets=False, holdout=0)
    return found.psi, found.std


def commanded_instruments(who: Subject, recording: Recording) -> Found:
    """Instrumental variables: the regressor at measured states, the instruments at those the servos follow."""
    motion = Motion(*recording.joint_states(who.mechanism.tree.joints))
    return competitors.instrumental(who.mechanism, who.parameters.kept, recording, motion, who.commanded)


def usual_filter(who: Subject, recording: Recording) -> Found:
    """Least squares at states that a filter with the usual cut-off gives."""
    motion, edge = competitors.low_passed(who.mechanism, recording, competitors.USUAL)
    return competitors.instrumental(who.mechanism, who.parameters.kept, recording, motion, edge=edge)


def filtered_instruments(who: Subject, recording: Recording) -> Found:
    """Instrumental variables: the regressor at those states, the instruments at states that are filtered more.

    Nobody knows what a person's motion was meant to be, from which instruments without noise could be simulated.
    """
    motion, _ = competitors.low_passed(who.mechanism, recording, competitors.USUAL)
    instruments, edge = competitors.low_passed(who.mechanism, recording)
    return competitors.instrumental(who.mechanism, who.parameters.kept, recording, motion, instruments, edge)


def cross_validated(who: Subject, recording: Recording) -> Found:
    """Least squares at the states of splines by cross-validation."""
    motion, edge = competitors.splined(who.mechanism, recording)
    return competitors.instrumental(who.mechanism, who.parameters.kept, recording, motion, edge=edge)


ESTIMATORS: Mapping[str, Mapping[str, Callable[[Subject, Recording], Found]]] = {
    "pendulum": {
        "ordinary": partial(identified, estimator="ordinary"),
        "weighted": partial(identified, estimator="weighted"),
        "instruments": commanded_instruments,
        "joint": partial(identified, estimator="joint"),
    },
    "person": {
        "usual_filter": usual_filter,
        "instruments": filtered_instruments,
        "spline": cross_validated,
        "chosen_filter": partial(identified, estimator="weighted", cutoff="auto"),
        "joint": partial(identified, estimator="joint"),
    },
}
"""What is compared for each subject."""

LABELS = {
    "ordinary": "ordinary least squares",
    "weighted": "weighted by channel",
    "usual_filter": "cut-off at 6 Hz",
    "chosen_filter": "cut-off from the data",
    "spline": "cross-validated spline",
    "instruments": "instrumental variables",
    "joint": "joint estimate",
}
"""What readers call the estimators."""


@dataclass(frozen=True, eq=False)
class Study:
    """What the study found.

    Attributes:
        errors: Errors of every condition's estimators.
        refused: Sentences of the fits that were refused, by condition and estimator.
        recordings: Number of recordings of each condition.
    """

    errors: Mapping[tuple[str, str], Errors]
    refused: Mapping[tuple[str, str], Sequence[str]]
    recordings: int


def fits(seed: int, task: tuple[int, str]) -> list[str]:
    """What a worker makes of a recording's number and a condition: a batch of one outcome, as JSON.

    The outcome has for every estimator the errors and the standard deviations it said, or why it refused.
    """
    number, name = task
    condition = CONDITIONS[name]
    who, recording = SUBJECTS[condition.subject], noisy_recording(condition, seed, number)
    outcome: dict[str, Any] = {}
    for key in estimators(name):
        try:
            psi, std = ESTIMATORS[condition.subject][key](who, recording)
            outcome[key] = {"error": (psi - who.true).tolist(), "std": std.tolist()}
        except InputError as error:
            outcome[key] = {"refused": str(error)}
    return [json.dumps(outcome)]


def estimators(condition: str) -> tuple[str, ...]:
    """Estimators that a condition compares."""
    looked_at = CONDITIONS[condition]
    return tuple(ESTIMATORS[looked_at.subject]) if looked_at.compared else ("joint",)


def outcomes(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Outcomes of all tasks in their order, the same however many workers share them."""
    todo = tasks(args.recordings)
    identity = {"seed": args.seed, "conditions": {name: asdict(each) for name, each in CONDITIONS.items()}}
    kept = Checkpoint("fits", args.out / FILE, identity)
    done = kept.done()[: len(todo)] if args.resume else []
    with worker_pool(max(1, min(args.workers, len(todo) - len(done))), args.scheduler, args.tls) as pool:
        work = partial(fits, args.seed)
        with closing(in_order(pool.executor, work, todo[len(done) :], ahead=pool.ahead)) as batches:
            found = kept.collect(batches, len(todo), done)
    return [json.loads(str(each)) for each in found]


def tasks(recordings: int) -> list[tuple[int, str]]:
    """Numbers and conditions, all conditions of a recording's number one after the other."""
    return [(number, name) for number in range(recordings) for name in CONDITIONS]


def study(found: Iterable[Mapping[str, Any]], recordings: int) -> Study:
    """Errors from the outcomes of all tasks; of estimators that refuse all recordings but one there are none.

    Raises:
        InputError: The joint estimate is one of them in every condition.
    """
    gathered: dict[tuple[str, str], list[Found]] = {}
    refused: dict[tuple[str, str], list[str]] = {}
    for (_, name), outcome in zip(tasks(recordings), found, strict=True):
        for key, one in outcome.items():
            if "refused" in one:
                refused.setdefault((name, key), []).append(one["refused"])
            else:
                gathered.setdefault((name, key), []).append((np.array(one["error"]), np.array(one["std"])))
    for (name, key), sentences in refused.items():
        print(f"Refused {len(sentences)} times: {name}, {LABELS[key]}: {sentences[0]}", file=sys.stderr)
    errors = {}
    for (name, key), pairs in gathered.items():
        error, std = (np.array(each) for each in zip(*pairs, strict=True))
        if len(pairs) > 1:
            errors[name, key] = Errors(SUBJECTS[CONDITIONS[name].subject].parameters.names, error, std)
    if not any(key == "joint" for _, key in errors):
        raise InputError("The joint estimate refuses nearly every recording.")
    return Study(errors, refused, recordings)
