"""Figure of the study of noise: errors by estimator, and coverage and biases of the trajectory estimate."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullLocator

from experiments.data.errors import Errors
from experiments.document import styles, symbols
from experiments.noise.conditions import CONDITIONS, SUBJECTS
from experiments.noise.estimators import ESTIMATORS, LABELS
from experiments.noise.study import Study
from ident.tolerances import INTERVAL

PARAMETER = "Ixx2"
"""Parameter of the comparison: an inertia, which is identifiable from accelerations alone."""

LINES = {
    "ordinary": ("C1", "s"),
    "weighted": ("C4", "D"),
    "usual_filter": ("C1", "s"),
    "instruments": ("C2", "^"),
    "spline": ("C3", "v"),
    "chosen_filter": ("C4", "D"),
    "trajectory": ("C0", "o"),
}
"""Colour and marker of each estimator; no two in one panel share either."""

PANELS = {
    "pendulum": ("(a) Double pendulum, all states measured", "Noise of the joint states"),
    "person": ("(b) Person who bows, angles alone measured", "Noise of the joint angles"),
}
"""Titles and abscissas of the panels."""

LINEAR = 1.0
"""Errors, in % of the truth, up to which the ordinates are linear; they are logarithmic beyond."""

PANEL, ROW, MARGIN = 1.75, 0.12, 0.9
"""Heights, inches: of a comparison, of a row of the coverage, and of the margin around its rows."""


def compared(study: Study, subject: str) -> list[str]:
    """Conditions in which a subject's estimators are compared."""
    looked_at = {name: CONDITIONS[name] for name in study.conditions}
    return [name for name, each in looked_at.items() if each.subject == subject and each.compared]


def figure(study: Study) -> Figure:
    """Errors of each estimator over the noise, and coverage and bias of the trajectory estimate."""
    subjects = [subject for subject in PANELS if compared(study, subject)]
    heights = [PANEL] * len(subjects) + [MARGIN + ROW * len(study.trajectory)]
    with styles.paper_style():
        drawing = Figure(figsize=(styles.column_width(), sum(heights)))
        parts = drawing.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        for part, subject in zip(parts, subjects, strict=False):
            _compare(part.subplots(), study, subject)
            handles: list[Artist] = [_handle(key) for key in ESTIMATORS[subject]]
            handles.append(Patch(color="0.8", lw=0, label="predicted, 95 %"))
            _legend(part, handles)
        below = parts[-1]
        below.suptitle(f"{'(c) ' if subjects else ''}Trajectory estimate, all base parameters and drives", fontsize=8)
        _honesty(below.subplots(1, 2, sharey=True), study)
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


def _compare(ax: Axes, study: Study, subject: str) -> None:
    """Draws mean and 95 % of the errors of one parameter, over a bar for the predicted ones."""
    who, shown = SUBJECTS[subject], list(ESTIMATORS[subject])
    k = who.parameters.names.index(PARAMETER)
    percent = 100 / float(who.true[k])
    ax.axhline(0, color="0.3", lw=0.6)
    for place, name in enumerate(compared(study, subject)):
        for at, key in enumerate(shown):
            if (outcome := study.outcomes.get((name, key))) is None:
                continue
            errors = outcome.errors
            x = place + 0.8 * ((at + 0.5) / len(shown) - 0.5)
            mean, spread, predicted = (percent * float(y[k]) for y in (errors.mean, errors.std, errors.predicted_std))
            color, marker = LINES[key]
            half = INTERVAL * predicted
            label = f"_{LABELS[key]}"
            ax.bar(
                x, 2 * half, 0.6 / len(shown), mean - half, color=color, alpha=0.25, lw=0, label=f"{label}, predicted"
            )
            ax.vlines(
                x, mean - INTERVAL * spread, mean + INTERVAL * spread, color=color, lw=0.9, label=f"{label}, 95 %"
            )
            ax.plot(x, mean, marker, color=color, ms=3, label=f"{label}, mean")
    title, xlabel = PANELS[subject]
    ax.set_title(title)
    ax.set_yscale("symlog", linthresh=LINEAR, linscale=0.7)
    ax.set_yticks([-100, -10, -1, 0, 1, 10])
    ax.set_ylim(-300, 40)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:+g}".replace("-", "\N{MINUS SIGN}") if y else "0"))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylabel(f"Error of {symbols.parameter_symbol(PARAMETER)} (%)", labelpad=2)
    ax.set_xlabel(xlabel, labelpad=2)
    labels = [CONDITIONS[name].label.removeprefix("noise ") for name in compared(study, subject)]
    ax.set_xticks(range(len(labels)), labels)
    ax.set_xlim(-0.5, len(labels) - 0.5)
    ax.grid(visible=False, axis="x")
    for border in range(1, len(labels)):
        ax.axvline(border - 0.5, color="0.8", lw=0.4)


def _honesty(axes: Sequence[Axes], study: Study) -> None:
    """Draws coverage of the trajectory estimate's intervals, and its biases, in each condition."""
    left, right = axes
    shown = {name: outcome.errors for name, outcome in study.trajectory.items()}
    rows = np.arange(len(shown))
    chance = INTERVAL / np.sqrt(study.recordings)
    for ax, middle, half in ((left, 95, 100 * chance * np.sqrt(0.95 * 0.05)), (right, 0, chance)):
        ax.axvspan(middle - half, middle + half, color="0.88", lw=0, label="_chance, 95 %")
        ax.axvline(middle, color="0.4", lw=0.6)
    for row, errors in enumerate(shown.values()):
        for ax, each in ((left, 100 * errors.coverage), (right, errors.mean / errors.std)):
            ax.plot(each, np.full(len(each), row), "o", color="C0", ms=2, alpha=0.5, mew=0, label="_parameter")
        mean, half = 100 * float(errors.coverage.mean()), _uncertainty(errors)
        left.hlines(row, mean - half, min(mean + half, 100), color="C0", lw=0.9, label="_mean, 95 %")
        left.plot(mean, row, "o", color="C0", ms=3.5, label="_mean")
    left.set_yticks(rows, [_row(study, name) for name in shown])
    left.invert_yaxis()
    left.set_xlabel("Intervals with the truth (%)", labelpad=2)
    right.set_xlabel("Bias (s.d.)", labelpad=2)
    lowest = min(float(errors.coverage.min()) for errors in shown.values())
    left.set_xlim(min(84.0, 100 * lowest - 2), 101)
    widest = max(float(abs(errors.mean / errors.std).max()) for errors in shown.values())
    right.set_xlim(-1.1 * max(widest, chance), 1.1 * max(widest, chance))


def _row(study: Study, name: str) -> str:
    """A condition in a word or two, after the letter of the panel that shows its subject, if any."""
    condition = CONDITIONS[name]
    label = condition.label.removeprefix("noise ").replace("0.5°, AR", "AR").replace("×3, AR", "AR")
    in_panel = compared(study, condition.subject)
    return f"({PANELS[condition.subject][0][1]}) {label}" if in_panel else label


def _uncertainty(errors: Errors) -> float:
    """95 % half-width of the mean coverage by chance, in %; a recording's parameters are not independent."""
    each = errors.covered.mean(axis=1)
    return 100 * INTERVAL * float(each.std(ddof=1)) / np.sqrt(len(each))
