"""Report on the study of noise: tables, a figure, key numbers, and the terminal's text."""

from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.data.errors import Errors
from experiments.document import tabular
from experiments.document.document import Document
from experiments.noise.conditions import CONDITIONS, SUBJECTS
from experiments.noise.estimators import ESTIMATORS, LABELS, SERVOS
from experiments.noise.figure import PANELS, PARAMETER, compared, figure
from experiments.noise.study import Outcome, Study
from ident.geometry.inertia import with_bodies
from ident.tolerances import DRIVE

ABOUT = (
    "Recordings of a pendulum, of a person who bows and of an arm whose joints rub are simulated many times with bad "
    "motions and sensors, and identified by several estimators: how far off each is, how far it says to be, how often "
    "its intervals hold the truth, and how often it reports a set-up deviation where there is none."
)
"""The page's text on the study."""

DRIVES = tuple(f"{column}(" for column in DRIVE.values())
"""Prefixes of the names of drive parameters."""


def table_estimators(study: Study, subject: str) -> tabular.Table:
    """Bias, spread, predicted standard deviation and coverage of one parameter, by noise and estimator."""
    who = SUBJECTS[subject]
    k = who.parameters.names.index(PARAMETER)
    true = float(who.true[k])
    rows: list[tuple[tabular.Cell, ...]] = []
    for name in compared(study, subject):
        for key in ESTIMATORS[subject]:
            if (outcome := study.outcomes.get((name, key))) is not None:
                errors = outcome.errors
                percent = [100 * float(x[k]) / true for x in (errors.mean, errors.std, errors.predicted_std)]
                labels = [CONDITIONS[name].label, LABELS[key]]
                rows.append((*labels, *percent, float(errors.coverage[k]), len(errors.errors)))
    columns = ("noise", "estimator", "bias", "spread", "predicted", "coverage_95", "recordings")
    title = f"Errors of {_named(PARAMETER, subject)} of the {subject}, % of {true:.2f} kg m², over many recordings"
    return tabular.Table(title, columns, tuple(rows), decimals=2)


def _named(parameter: str, subject: str) -> str:
    """A parameter with the name of its body."""
    return with_bodies([parameter], SUBJECTS[subject].mechanism.bodies)


def table_coverage(study: Study) -> tabular.Table:
    """Coverage of the trajectory estimate's intervals, normalized errors, biases and reported set-up, by condition."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, outcome in study.trajectory.items():
        errors, wide, condition = outcome.errors, outcome.with_setup, CONDITIONS[name]
        ratio, coverage = errors.mean / errors.std, errors.coverage
        k = int(np.argmax(abs(ratio)))
        cells: list[tabular.Cell] = [condition.subject, condition.label, float(coverage.mean()), float(coverage.min())]
        cells += [None if wide is None else float(wide.coverage.mean()), _rms_z(errors), _rms_ratio(errors)]
        cells += [outcome.reporting, float(np.sqrt((ratio**2).mean())), float(abs(ratio[k]))]
        refused = len(study.refused.get((name, "trajectory"), ()))
        rows.append((*cells, _named(errors.names[k], condition.subject), len(errors.errors), refused))
    columns = (
        *("subject", "noise", "coverage_95", "lowest_coverage_95", "setup_coverage_95", "rms_z", "error_over_std"),
        *("setup_reported", "bias_rms", "largest_bias", "parameter", "recordings", "refused"),
    )
    title = (
        "The trajectory estimate's 95 % intervals of all base parameters and drives: coverage, by noise alone "
        "and with the set-up, errors over their deviations, fraction of recordings in which a set-up deviation "
        f"is reported that is not there, and biases in s.d., of which chance makes {1 / np.sqrt(study.recordings):.2f}"
    )
    heads = {
        "setup_coverage_95": "with set-up",
        "rms_z": "RMS z",
        "error_over_std": "error / s.d.",
        "setup_reported": "set-up found",
    }
    return tabular.Table(title, columns, tuple(rows), decimals=3, heads=heads)


def _rms_z(errors: Errors) -> float | None:
    """RMS of errors over their own standard deviations; None if one of these is zero."""
    if not errors.predicted.all():
        return None
    return float(np.sqrt(np.mean((errors.errors / errors.predicted) ** 2)))


def _rms_ratio(errors: Errors) -> float | None:
    """RMS error of a parameter over its RMS standard deviation, RMS over the parameters; None if one is zero."""
    if not errors.predicted_std.all():
        return None
    return float(np.sqrt(np.mean((errors.errors / errors.predicted_std) ** 2)))


def table_drives(study: Study) -> tabular.Table:
    """Errors of rotor inertias and friction of arms with friction, in % of the truth."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, outcome in study.trajectory.items():
        errors = outcome.errors
        rms, worst = np.sqrt((errors.errors**2).mean(axis=0)), abs(errors.errors).max(axis=0)
        for k, drive in enumerate(errors.names):
            if drive.startswith(DRIVES):
                each = (x[k] for x in (errors.mean, rms, worst, errors.predicted_std))
                percent = [100 * float(x) / float(outcome.true[k]) for x in each]
                cells: list[tabular.Cell] = [CONDITIONS[name].label, drive, float(outcome.true[k]), *percent]
                rows.append((*cells, float(errors.coverage[k]), len(errors.errors)))
    columns = ("noise", "drive", "true", "bias", "rms_error", "largest_error", "predicted", "coverage_95", "recordings")
    title = "The trajectory estimate of rotor inertias and friction: errors in % of the true values (SI units)"
    heads = {"rms_error": "RMS error", "largest_error": "largest error"}
    return tabular.Table(title, columns, tuple(rows), decimals=2, heads=heads)


def table_kinds(study: Study) -> tabular.Table:
    """Coverage of the intervals by kind of parameter, where a condition has several kinds."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, outcome in study.trajectory.items():
        errors, wide = outcome.errors, outcome.with_setup
        kinds = np.array([_kind(each) for each in errors.names])
        for kind in dict.fromkeys(kinds.tolist()) if len({*kinds}) > 1 else ():
            z = errors.errors[:, kinds == kind] / errors.predicted[:, kinds == kind]
            cells = [None if x is None else float(x.coverage[kinds == kind].mean()) for x in (errors, wide)]
            rows.append((CONDITIONS[name].label, kind, *cells, float(np.sqrt((z**2).mean())), len(errors.errors)))
    columns = ("noise", "kind", "coverage_95", "setup_coverage_95", "rms_z", "recordings")
    title = (
        "Coverage of the trajectory estimate's 95 % intervals by kind of parameter, by noise alone and with the set-up"
    )
    return tabular.Table(title, columns, tuple(rows), heads={"setup_coverage_95": "with set-up", "rms_z": "RMS z"})


def _kind(name: str) -> str:
    """Kind of a parameter: that of a drive, of a servo or of a payload, or `base parameter`."""
    kind, bracket, _ = name.partition("(")
    return kind if bracket or kind in (*SERVOS, "mass") else "base parameter"


def numbers(study: Study) -> dict[str, Any]:
    """Key numbers for scripts, for each condition, estimator and parameter."""
    out: dict[str, Any] = {"recordings": study.recordings}
    for (name, key), outcome in study.outcomes.items():
        refused = list(study.refused.get((name, key), ()))
        out.setdefault(name, asdict(CONDITIONS[name]))[key] = _numbers(outcome) | {"refused": refused}
    return out


def _numbers(outcome: Outcome) -> dict[str, Any]:
    """Key numbers of one condition and estimator."""
    errors, wide = outcome.errors, outcome.with_setup
    columns = {
        "true": outcome.true,
        "bias": errors.mean,
        "spread": errors.std,
        "predicted_std": errors.predicted_std,
        "coverage_95": errors.coverage,
        **({} if wide is None else {"predicted_std_setup": wide.predicted_std, "setup_coverage_95": wide.coverage}),
    }
    of_all = {"recordings": len(errors.errors), "rms_z": _rms_z(errors), "error_over_std": _rms_ratio(errors)}
    reported = {"setup_reported": outcome.reporting, "setup": dict(Counter(name for x in outcome.setup for name in x))}
    each = {column: dict(zip(errors.names, x.tolist(), strict=True)) for column, x in columns.items()}
    return {**of_all, **reported, **each}


def document(study: Study, provenance: dict[str, Any]) -> Document:
    """Tables, a figure and numbers of the study."""
    caption = (
        f"Error of {_named(PARAMETER, 'pendulum')} and {_named(PARAMETER, 'person')}, {study.recordings} recordings, "
        "by noise on the joint sensors: mean, 95 % of the errors (lines) and what each estimator predicts of itself "
        "(bars), for the paper's pendulum (a) and a person who bows (b); and the coverage of the trajectory estimate's "
        "intervals, with its biases in standard deviations, for every base parameter and drive (c). The ordinates "
        "of (a) and (b) are linear within ±1 %. In (c) correlated noise (AR) is as large as that of ×3 and of 0.5°; "
        "missing samples and outliers are besides ×1; rows without a letter are of an arm."
    )
    tables = {f"table_{subject}": table_estimators(study, subject) for subject in PANELS if compared(study, subject)}
    tables["table_coverage"] = table_coverage(study)
    if (drives := table_drives(study)).rows:
        tables["table_drives"] = drives
    if (kinds := table_kinds(study)).rows:
        tables["table_kinds"] = kinds
    return Document(
        "Bad motions and sensors",
        ABOUT,
        tables=tables,
        figures={"figure_noise": (figure(study), caption)},
        numbers={"summary": numbers(study), "provenance": provenance},
    )
