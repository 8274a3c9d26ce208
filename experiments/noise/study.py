"""Errors of estimators of base parameters and drives over many recordings with bad motions and sensors."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.errors import Errors
from experiments.noise.conditions import CONDITIONS
from experiments.noise.estimators import ESTIMATORS, LABELS, Case
from experiments.runs.checkpoint import Checkpoint
from experiments.runs.workers import Workers
from ident.errors import InputError

FILE = "fits.npz"
"""File in the output folder with the fits of each recording."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Estimates of one estimator from the recordings of one condition.

    Attributes:
        errors: Errors of base parameters and drives, beside standard deviations from noise alone.
        with_setup: The same errors, beside standard deviations including the set-up; None for estimators without a
            set-up.
        true: True values, or their means if bodies are drawn (p,).
        setup: Names of the set-up errors that each answer reports.
    """

    errors: Errors
    with_setup: Errors | None
    true: np.ndarray
    setup: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, answers: Sequence[Mapping[str, Any]]) -> "Outcome":
        """Outcome of several answers, all with the same parameters."""
        names = tuple(answers[0]["names"])
        error, std, true = (np.array([each[key] for each in answers]) for key in ("error", "std", "true"))
        wide = [each["std_setup"] for each in answers]
        with_setup = None if None in wide else Errors(names, error, np.array(wide))
        setup = tuple(tuple(each["setup"]) for each in answers)
        return cls(Errors(names, error, std), with_setup, true.mean(axis=0), setup)

    @property
    def reporting(self) -> float:
        """Share of the answers that report a set-up error."""
        return float(np.mean([bool(names) for names in self.setup]))


@dataclass(frozen=True, eq=False)
class Study:
    """Results of the study, by condition and estimator.

    Attributes:
        outcomes: Outcomes by condition and estimator.
        refused: Sentences of the fits that were refused.
        recordings: Number of recordings of each condition.
        conditions: Names of the conditions.
    """

    outcomes: Mapping[tuple[str, str], Outcome]
    refused: Mapping[tuple[str, str], Sequence[str]]
    recordings: int
    conditions: tuple[str, ...]

    @property
    def trajectory(self) -> dict[str, Outcome]:
        """Outcomes of the trajectory estimate, by condition."""
        return {
            name: self.outcomes[name, "trajectory"] for name in self.conditions if (name, "trajectory") in self.outcomes
        }


def fits(seed: int, task: tuple[int, str]) -> list[str]:
    """Outcome of a recording's number and a condition as JSON, in a batch of one; run by workers.

    The outcome has `Answer.to_dict` of each estimator, or its error.
    """
    number, name = task
    case = Case.drawn(CONDITIONS[name], seed, number)
    outcome: dict[str, Any] = {}
    for key in estimators(name):
        try:
            outcome[key] = ESTIMATORS[case.condition.subject][key](case).to_dict()
        except InputError as error:
            outcome[key] = {"refused": str(error)}
    return [json.dumps(outcome)]


def estimators(condition: str) -> tuple[str, ...]:
    """Estimators that a condition compares."""
    looked_at = CONDITIONS[condition]
    return tuple(ESTIMATORS[looked_at.subject]) if looked_at.compared else ("trajectory",)


def chosen(names: Sequence[str] | None) -> tuple[str, ...]:
    """Names of conditions in the order of `CONDITIONS`; all if none are named.

    Raises:
        InputError: A condition does not exist.
    """
    if unknown := [name for name in names or () if name not in CONDITIONS]:
        raise InputError(f"Conditions are {', '.join(CONDITIONS)}; got '{unknown[0]}'.")
    return tuple(name for name in CONDITIONS if names is None or name in names)


def outcomes(
    conditions: Sequence[str], recordings: int, *, seed: int, folder: Path, workers: Workers
) -> list[dict[str, Any]]:
    """Outcomes of all tasks in order, independent of the number of workers.

    Args:
        conditions: Names of the conditions.
        recordings: Number of recordings of each.
        seed: Seed of all noise.
        folder: Folder of the file of the fits.
        workers: Workers that share the tasks.
    """
    identity = {"seed": seed, "conditions": {name: asdict(CONDITIONS[name]) for name in conditions}}
    kept = Checkpoint("fits", folder / FILE, identity)
    return workers.collected(partial(fits, seed), tasks(recordings, conditions), kept)


def tasks(recordings: int, conditions: Sequence[str]) -> list[tuple[int, str]]:
    """Pairs of recording number and condition, grouped by number."""
    return [(number, name) for number in range(recordings) for name in conditions]


def study(collected: Iterable[Mapping[str, Any]], recordings: int, conditions: Sequence[str]) -> Study:
    """Errors from the outcomes of all tasks; estimators with fewer than two estimates have none.

    Raises:
        InputError: The trajectory estimate has none in any condition.
    """
    gathered: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    refused: dict[tuple[str, str], list[str]] = {}
    for (_, name), outcome in zip(tasks(recordings, conditions), collected, strict=True):
        for key, answer in outcome.items():
            before = gathered.setdefault((name, key), [])
            if "refused" in answer:
                refused.setdefault((name, key), []).append(answer["refused"])
            elif before and before[0]["names"] != answer["names"]:
                refused.setdefault((name, key), []).append("It identifies other parameters than the first recording.")
            else:
                before.append(answer)
    for (name, key), sentences in refused.items():
        print(f"Refused {len(sentences)} times: {name}, {LABELS[key]}: {sentences[0]}", file=sys.stderr)
    answered = {key: Outcome.of(answers) for key, answers in gathered.items() if len(answers) > 1}
    if not any(key == "trajectory" for _, key in answered):
        raise InputError("The trajectory estimate refuses nearly every recording.")
    return Study(answered, refused, recordings, tuple(conditions))
