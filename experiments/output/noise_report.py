"""What noise on the joint sensors does to each estimator: tables, a figure, key numbers, and the terminal's text."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullLocator

from experiments.output import figures, report
from experiments.output.page import Said, conclude
from experiments.output.results import Results
from experiments.studies import noise
from experiments.studies.errors import HALF_WIDTH, Errors
from experiments.studies.noise import ESTIMATORS, LABELS, Study
from experiments.studies.noisy_recordings import CONDITIONS, SUBJECTS
from ident.geometry.inertia import with_bodies

PARAMETER = "Ixx2"
"""What the comparison looks at: an inertia, which accelerations alone tell of."""

ABOUT = (
    "Recordings of a pendulum and of a person who bows are simulated many times with noise on the joint sensors, and "
    "identified by several estimators: how far off each is, how far it says to be, and how often its intervals hold "
    "the truth."
)
"""What the page says of the study."""

LINES = {
    "ordinary": ("C1", "s"),
    "weighted": ("C4", "D"),
    "usual_filter": ("C1", "s"),
    "instruments": ("C2", "^"),
    "spline": ("C3", "v"),
    "chosen_filter": ("C4", "D"),
    "joint": ("C0", "o"),
}
"""Colour and marker of each estimator; no two of one panel share either."""

PANELS = {
    "pendulum": ("(a) Double pendulum, all states measured", "Noise of the joint states"),
    "person": ("(b) Person who bows, angles alone measured", "Noise of the joint angles"),
}
"""Titles and abscissas of what is compared."""

LINEAR = 1.0
"""Errors, in % of the truth, up to which the ordinates are linear, and logarithmic beyond."""


def compared(subject: str) -> list[str]:
    """Conditions in which a subject's estimators are compared."""
    return [name for name, each in CONDITIONS.items() if each.subject == subject and each.compared]


def table_estimators(found: Study, subject: str) -> report.Table:
    """Bias, spread, predicted deviation and coverage of one parameter, by noise and estimator."""
    who = SUBJECTS[subject]
    k = who.parameters.names.index(PARAMETER)
    true = float(who.true[k])
    rows: list[tuple[report.Cell, ...]] = []
    for name in compared(subject):
        for key in ESTIMATORS[subject]:
            if (errors := found.errors.get((name, key))) is not None:
                percent = [100 * float(x[k]) / true for x in (errors.mean, errors.std, errors.predicted_std)]
                said = [CONDITIONS[name].label, LABELS[key]]
                rows.append((*said, *percent, float(errors.coverage[k]), len(errors.errors)))
    columns = ("noise", "estimator", "bias", "spread", "predicted", "coverage_95", "recordings")
    title = f"Errors of {_named(PARAMETER, subject)} of the {subject}, % of {true:.2f} kg m², over many recordings"
    return report.Table(title, columns, tuple(rows), decimals=2)


def _named(parameter: str, subject: str) -> str:
    """A parameter with the name of its body."""
    return with_bodies([parameter], SUBJECTS[subject].mechanism.bodies)


def table_coverage(found: Study) -> report.Table:
    """How often the joint estimate's intervals hold the truth, and how large its biases are."""
    rows: list[tuple[report.Cell, ...]] = []
    for name, condition in CONDITIONS.items():
        if (errors := found.errors.get((name, "joint"))) is not None:
            ratio, coverage = errors.mean / errors.std, errors.coverage
            k = int(np.argmax(abs(ratio)))
            refused = len(found.refused.get((name, "joint"), ()))
            some = (coverage.mean(), coverage.min(), np.sqrt((ratio**2).mean()), abs(ratio[k]))
            shown: list[report.Cell] = [condition.subject, condition.label, *map(float, some)]
            rows.append((*shown, _named(errors.names[k], condition.subject), len(errors.errors), refused))
    columns = (
        *("subject", "noise", "coverage_95", "lowest_coverage_95", "bias_rms", "largest_bias", "parameter"),
        *("recordings", "refused"),
    )
    title = (
        "The joint estimate's 95 % intervals of all base parameters: fraction that hold the truth, and biases in "
        f"standard deviations, of which chance makes {1 / np.sqrt(found.recordings):.2f}"
    )
    return report.Table(title, columns, tuple(rows), decimals=3)


def figure(found: Study) -> Figure:
    """Errors of every estimator over the noise, and coverage and bias of the joint estimate."""
    with figures.paper_style():
        drawing = Figure(figsize=(figures.column_width(), 5.6))
        (above,), (between,), (below,) = drawing.subfigures(3, 1, height_ratios=(1.75, 1.75, 2.1), squeeze=False)
        for part, subject in ((above, "pendulum"), (between, "person")):
            _compare(part.subplots(), found, subject)
            handles: list[Artist] = [_handle(key) for key in ESTIMATORS[subject]]
            handles.append(Patch(color="0.8", lw=0, label="predicted, 95 %"))
            _legend(part, handles)
        below.suptitle("(c) Joint estimate, all base parameters", fontsize=8)
        _honesty(below.subplots(1, 2, sharey=True), found)
        marks: dict[str, Any] = {"ms": 2, "alpha": 0.5, "mew": 0, "lw": 0, "color": "C0", "marker": "o"}
        _legend(
            below,
            [
                Line2D([], [], label="one parameter", **marks),
                Line2D([], [], label="their mean, 95 %", **marks | {"ms": 3.5, "alpha": 1, "lw": 0.9}),
                Patch(color="0.88", lw=0, label="chance, 95 %"),
            ],
        )
    return drawing


def _legend(part: SubFigure, handles: Sequence[Artist]) -> None:
    part.legend(
        handles=handles,
        loc="outside lower center",
        ncols=3,
        fontsize=7,
        columnspacing=0.9,
        handlelength=1.4,
        handletextpad=0.4,
        borderpad=0.2,
    )


def _handle(key: str) -> Line2D:
    color, marker = LINES[key]
    return Line2D([], [], color=color, marker=marker, ms=3, lw=0.9, label=LABELS[key])


def _compare(ax: Axes, found: Study, subject: str) -> None:
    """Mean error and 95 % of the errors of one parameter, over a bar for what was predicted."""
    who, shown = SUBJECTS[subject], list(ESTIMATORS[subject])
    k = who.parameters.names.index(PARAMETER)
    percent = 100 / float(who.true[k])
    ax.axhline(0, color="0.3", lw=0.6)
    for place, name in enumerate(compared(subject)):
        for at, key in enumerate(shown):
            if (errors := found.errors.get((name, key))) is None:
                continue
            x = place + 0.8 * ((at + 0.5) / len(shown) - 0.5)
            mean, spread, said = (percent * float(y[k]) for y in (errors.mean, errors.std, errors.predicted_std))
            color, marker = LINES[key]
            ax.bar(x, 2 * HALF_WIDTH * said, 0.6 / len(shown), mean - HALF_WIDTH * said, color=color, alpha=0.25, lw=0)
            ax.vlines(x, mean - HALF_WIDTH * spread, mean + HALF_WIDTH * spread, color=color, lw=0.9)
            ax.plot(x, mean, marker, color=color, ms=3)
    title, xlabel = PANELS[subject]
    ax.set_title(title)
    ax.set_yscale("symlog", linthresh=LINEAR, linscale=0.7)
    ax.set_yticks([-100, -10, -1, 0, 1, 10])
    ax.set_ylim(-300, 40)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:+g}".replace("-", "\N{MINUS SIGN}") if y else "0"))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylabel(f"Error of {figures.parameter_symbol(PARAMETER)} (%)", labelpad=2)
    ax.set_xlabel(xlabel, labelpad=2)
    labels = [CONDITIONS[name].label.removeprefix("noise ") for name in compared(subject)]
    ax.set_xticks(range(len(labels)), labels)
    ax.set_xlim(-0.5, len(labels) - 0.5)
    ax.grid(visible=False, axis="x")
    for border in range(1, len(labels)):
        ax.axvline(border - 0.5, color="0.8", lw=0.4)


def _honesty(axes: Sequence[Axes], found: Study) -> None:
    """Coverage of the joint estimate's intervals, and its biases, in every condition."""
    left, right = axes
    shown = [name for name in CONDITIONS if (name, "joint") in found.errors]
    rows = np.arange(len(shown))
    chance = HALF_WIDTH / np.sqrt(found.recordings)
    for ax, middle, half in ((left, 95, 100 * chance * np.sqrt(0.95 * 0.05)), (right, 0, chance)):
        ax.axvspan(middle - half, middle + half, color="0.88", lw=0)
        ax.axvline(middle, color="0.4", lw=0.6)
    for row, name in enumerate(shown):
        errors = found.errors[name, "joint"]
        for ax, each in ((left, 100 * errors.coverage), (right, errors.mean / errors.std)):
            ax.plot(each, np.full(len(each), row), "o", color="C0", ms=2, alpha=0.5, mew=0)
        mean, half = 100 * float(errors.coverage.mean()), _uncertainty(errors)
        left.hlines(row, mean - half, min(mean + half, 100), color="C0", lw=0.9)
        left.plot(mean, row, "o", color="C0", ms=3.5)
    left.set_yticks(rows, [_row(name) for name in shown])
    left.invert_yaxis()
    left.set_xlabel("Intervals with the truth (%)", labelpad=2)
    right.set_xlabel("Bias (s.d.)", labelpad=2)
    lowest = min(float(found.errors[name, "joint"].coverage.min()) for name in shown)
    left.set_xlim(min(84.0, 100 * lowest - 2), 101)
    widest = max(float(abs(found.errors[n, "joint"].mean / found.errors[n, "joint"].std).max()) for n in shown)
    right.set_xlim(-1.1 * max(widest, chance), 1.1 * max(widest, chance))


def _row(name: str) -> str:
    """A condition in a word or two, after the panel that shows its subject."""
    condition = CONDITIONS[name]
    label = condition.label.removeprefix("noise ").replace("0.5°, AR", "AR").replace("×3, AR", "AR")
    return f"({PANELS[condition.subject][0][1]}) {label}"


def _uncertainty(errors: Errors) -> float:
    """95 % of what chance does to the mean coverage, in %; a recording's parameters are not independent."""
    each = errors.covered.mean(axis=1)
    return 100 * HALF_WIDTH * float(each.std(ddof=1)) / np.sqrt(len(each))


def numbers(found: Study) -> dict[str, Any]:
    """Key numbers for scripts: of every condition and estimator those of every parameter."""
    out: dict[str, Any] = {"recordings": found.recordings}
    for (name, key), errors in found.errors.items():
        columns = {
            "true": SUBJECTS[CONDITIONS[name].subject].true,
            "bias": errors.mean,
            "spread": errors.std,
            "predicted_std": errors.predicted_std,
            "coverage_95": errors.coverage,
        }
        out.setdefault(name, asdict(CONDITIONS[name]))[key] = {
            "recordings": len(errors.errors),
            "refused": list(found.refused.get((name, key), ())),
        } | {column: dict(zip(errors.names, x.tolist(), strict=True)) for column, x in columns.items()}
    return out


def results(found: Study) -> Results:
    """What the study leaves behind."""
    caption = (
        f"Error of {_named(PARAMETER, 'pendulum')} and {_named(PARAMETER, 'person')}, {found.recordings} recordings, "
        "by noise on the joint sensors: mean, 95 % of the errors (lines) and what each estimator predicts of itself "
        "(bars), for the paper's pendulum (a) and a person who bows (b); and how often the joint estimate's intervals "
        "hold the truth, with its biases in standard deviations, for every base parameter (c). The ordinates of (a) "
        "and (b) are linear within ±1 %. In (c) correlated noise (AR) is as large as that of ×3 and of 0.5°; missing "
        "samples and outliers are besides ×1."
    )
    tables = {f"table_{subject}": table_estimators(found, subject) for subject in SUBJECTS}
    tables["table_coverage"] = table_coverage(found)
    return Results(tables, {"figure_noise": (figure(found), caption)}, {"summary": numbers(found)})


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    with report.writable(args.out):
        found = noise.study(noise.outcomes(args), args.recordings)
    choices = {key: getattr(args, key) for key in ("seed", "recordings", "formats")}
    conclude(args, results(found), Said("Noise on the joint sensors", ABOUT), report.provenance(choices))
