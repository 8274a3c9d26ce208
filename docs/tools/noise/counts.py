"""Fits of many recordings, and tables of how often their intervals contain the truth."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from docs.tools.noise.conditions import CONDITIONS
from docs.tools.noise.estimators import ESTIMATORS, LABELS, SERVOS, Case
from experiments.data.fitting import Errors
from experiments.document import tabular
from ident.errors import InputError

Answers = Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]
"""`Answer.to_dict` of all recordings, or refusals, by condition and estimator."""

ALL = "all"
"""Kind of the rows of all parameters."""


def fits(seed: int, task: tuple[int, str]) -> dict[str, Any]:
    """`Answer.to_dict` of each estimator, or its error, for a recording's number and a condition."""
    number, name = task
    case, condition, outcome = Case.drawn(CONDITIONS[name], seed, number), CONDITIONS[name], {}
    for key in ESTIMATORS[condition.subject] if condition.compared else ("trajectory",):
        try:
            outcome[key] = ESTIMATORS[condition.subject][key](case).to_dict()
        except InputError as error:
            outcome[key] = {"refused": str(error)}
    return outcome


def tasks(recordings: int, conditions: Sequence[str]) -> list[tuple[int, str]]:
    """Pairs of recording number and condition, grouped by number."""
    return [(number, name) for number in range(recordings) for name in conditions]


def by_estimator(todo: Sequence[tuple[int, str]], outcomes: Sequence[Mapping[str, Any]]) -> Answers:
    """Answers of all tasks; one with other parameters than the first is a refusal."""
    gathered: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for (_, name), outcome in zip(todo, outcomes, strict=True):
        for key, answer in outcome.items():
            before = gathered.setdefault((name, key), [])
            first = next((each for each in before if "names" in each), answer)
            alike = "refused" in answer or answer["names"] == first["names"]
            before.append(answer if alike else {"refused": "It identifies other parameters than the first recording."})
    return gathered


def answered(answers: Answers) -> Iterator[tuple[str, str, list[Mapping[str, Any]], int]]:
    """Condition, estimator, answers and number of refusals, where there are two answers or more."""
    for (name, key), every in answers.items():
        given = [each for each in every if "refused" not in each]
        if len(given) > 1:
            yield name, key, given, len(every) - len(given)


def errors_of(given: Sequence[Mapping[str, Any]]) -> tuple[Errors, Errors | None]:
    """Errors beside standard deviations from noise alone, and beside those with the set-up if there are any."""
    names, error = tuple(given[0]["names"]), np.array([each["error"] for each in given])
    wide = None if given[0]["std_setup"] is None else np.array([each["std_setup"] for each in given])
    noise = Errors(names, error, np.array([each["std"] for each in given]))
    return noise, None if wide is None else Errors(names, error, wide)


def table_coverage(answers: Answers) -> tabular.Table:
    """Coverage of 95 % intervals, normalized errors, biases and reported set-up, of all parameters and by kind."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, key, given, refused in answered(answers):
        errors, wide = errors_of(given)
        bias, reported = errors.mean / errors.std, float(np.mean([bool(each["setup"]) for each in given]))
        kinds = np.array([_kind(each) for each in errors.names])
        for kind in (ALL, *(dict.fromkeys(kinds.tolist()) if len({*kinds}) > 1 else ())):
            of = (kinds == kind) | (kind == ALL)
            coverage = errors.coverage[of]
            cells: list[tabular.Cell] = [CONDITIONS[name].subject, CONDITIONS[name].label, LABELS[key], kind]
            cells += [float(coverage.mean()), float(coverage.min())]
            cells += [None if wide is None else float(wide.coverage[of].mean())]
            cells += [_rms(errors.errors[:, of], errors.predicted[:, of])]
            cells += [_rms(errors.errors[:, of], errors.predicted_std[of]), reported]
            rows.append(
                (*cells, float(np.sqrt((bias[of] ** 2).mean())), float(abs(bias[of]).max()), len(given), refused)
            )
    columns = (
        *("subject", "noise", "estimator", "kind", "coverage_95", "lowest_coverage_95", "setup_coverage_95", "rms_z"),
        *("error_over_std", "setup_reported", "bias_rms", "largest_bias", "recordings", "refused"),
    )
    return tabular.Table("Coverage of 95 % intervals, by noise alone and with the set-up", columns, tuple(rows))


def _rms(errors: np.ndarray, std: np.ndarray) -> float | None:
    """RMS of errors over standard deviations; None if one of these is zero."""
    return float(np.sqrt(np.mean((errors / std) ** 2))) if std.all() else None


def _kind(name: str) -> str:
    """Kind of a parameter: that of a drive, of a servo or of a payload, or `base parameter`."""
    kind, bracket, _ = name.partition("(")
    return kind if bracket or kind in (*SERVOS, "mass") else "base parameter"


def table_parameters(answers: Answers) -> tabular.Table:
    """Bias, RMS error, spread, predicted standard deviation and coverage of every parameter."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, key, given, _ in answered(answers):
        errors, _ = errors_of(given)
        true = np.mean([each["true"] for each in given], axis=0)
        rms = np.sqrt((errors.errors**2).mean(axis=0))
        numbers = np.stack([true, errors.mean, rms, errors.std, errors.predicted_std, errors.coverage])
        labels = CONDITIONS[name].label, LABELS[key]
        rows += [(*labels, each, *numbers[:, k].tolist()) for k, each in enumerate(errors.names)]
    columns = ("noise", "estimator", "parameter", "true", "bias", "rms_error", "spread", "predicted", "coverage_95")
    return tabular.Table("Errors of all parameters, SI units", columns, tuple(rows), decimals=5)


def reported(answers: Answers) -> dict[str, dict[str, int]]:
    """Number of recordings in which each set-up error is reported, by condition."""
    return {
        name: dict(Counter(each for answer in given for each in answer["setup"]))
        for name, key, given, _ in answered(answers)
        if key == "trajectory"
    }
