"""Figures of a simulated study, as described in its file."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import cycle

import numpy as np

from experiments.data.simulated_study import SimulatedStudy, wrench_error
from experiments.document import figures
from experiments.document.figures import INKS
from ident.display.plots import Figure

TRUE_WIDTH = 1.6
"""Line width of the truth in points: it lies below the others and shows on both sides."""

STROKES = ("-", "--", ":", "-.")
"""Line styles of other curves, for print without colours."""

WINDOW = 25
"""Samples of the running mean of errors, a quarter of a second."""

DOTS = 0.7
"""Diameter of the dots of single samples, in points."""

LOWEST = 0.001
"""Smallest error shown, relative to a panel's largest."""


def figure(study: SimulatedStudy, name: str) -> Figure:
    """A figure of the study by file name."""
    entry = study.file.figures[name]
    if entry.kind == "contacts":
        return contacts(study)
    kinds = {"wrenches": wrenches, "wrench errors": wrench_errors, "residuals": residuals}
    return kinds[entry.kind](study, entry.curves)


def wrenches(study: SimulatedStudy, curves: Mapping[str, str]) -> Figure:
    """Wrenches over time: the true and the measured total, the ground's, and predictions of models."""
    colors, strokes = inks(curves.values()), cycle(STROKES)
    drawn = {}
    for label, what in curves.items():
        color = INKS[colors[what]]
        line = figures.Line(color, TRUE_WIDTH) if what == "true" else figures.Line(color, style=next(strokes))
        drawn[label] = wrench(study, what), line
    return figures.wrench_panels(study.recording.time, drawn, "Time (s)", shaded=episodes(study))


def inks(curves: Iterable[str]) -> dict[str, int]:
    """Indices into `INKS` of the wrenches in a figure, in the paper's colours.

    With the ground's wrench in red, the true total is blue and a recovered one black (Figure 4); without it the true
    one is black, and the models' are red and blue (Figure 2).
    """
    shown = list(dict.fromkeys(curves))
    own = {"ground": 1, "true": 2} if "ground" in shown else {"true": 0}
    free = cycle([k for k in range(len(INKS)) if k not in own.values()])
    return {what: own[what] if what in own else next(free) for what in shown}


def page_inks(study: SimulatedStudy, curves: Iterable[str]) -> list[int]:
    """Colours of wrenches on the study's page: those of its first figure of wrenches, or other free ones."""
    entries = (entry.curves.values() for entry in study.file.figures.values() if entry.kind == "wrenches")
    wanted = list(curves)
    chosen = inks([*next(entries, ()), *wanted])
    return [chosen[what] for what in wanted]


def wrench(study: SimulatedStudy, what: str) -> np.ndarray:
    """A wrench by its name in a study file: one of `study_displays.WRENCHES`, or a model's prediction (N, 6)."""
    if what == "ground":
        return study.recording.wrench("ground").values
    totals = {"true": lambda: study.true, "measured": lambda: study.measured}
    return totals[what]().values if what in totals else study.fit(what).predicted


def wrench_errors(study: SimulatedStudy, curves: Mapping[str, str]) -> Figure:
    """Absolute errors of the recovered wrenches over samples, as dots, and their running RMS.

    Models with equal errors, due to joint noise, have alternating dots, and means that show between each other's
    dashes.
    """
    errors = {label: wrench_error(study, model) for label, model in curves.items()}
    lines = dict(zip(curves, other_lines(curves.values()), strict=True))
    samples = {
        label: (np.abs(error), replace(lines[label], style="", width=DOTS, first=k))
        for k, (label, error) in enumerate(errors.items())
    }
    # The first is drawn lowest and has to be the widest.
    widths = np.linspace(1.6, 0.8, len(curves))
    means = {
        f"{label}, running RMS": (running_rms(error), replace(lines[label], width=float(width)))
        for (label, error), width in zip(errors.items(), widths, strict=True)
    }
    number = np.arange(1, len(study.recording.time) + 1)
    return figures.wrench_panels(
        number, samples | means, "Sample", symbol=r"|\Delta {}|", lowest=LOWEST, shaded=episodes(study)
    )


def other_lines(curves: Iterable[str]) -> list[figures.Line]:
    """Lines of curves without the truth, each with its own colour and style."""
    drawn, strokes = list(curves), cycle(STROKES)
    colors = inks(drawn)
    return [figures.Line(INKS[colors[what]], style=next(strokes)) for what in drawn]


def running_rms(x: np.ndarray) -> np.ndarray:
    """RMS of up to `WINDOW` samples around each (N, 6)."""
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(x**2, axis=0)])
    middle = np.arange(len(x))
    first, last = np.maximum(middle - WINDOW // 2, 0), np.minimum(middle + WINDOW // 2 + 1, len(x))
    return np.sqrt(np.maximum(sums[last] - sums[first], 0) / (last - first)[:, None])


def residuals(study: SimulatedStudy, curves: Mapping[str, str]) -> Figure:
    """Measured total wrench less the models' predictions, over time."""
    shown = {label: study.total(model).values - study.fit(model).predicted for label, model in curves.items()}
    lines = other_lines(curves.values()) if len(curves) > 1 else [figures.Line("black")]
    drawn = {
        label: (wrench, replace(line, width=0.4)) for (label, wrench), line in zip(shown.items(), lines, strict=True)
    }
    return figures.wrench_panels(study.recording.time, drawn, "Time (s)", symbol=r"\Delta {}", shaded=episodes(study))


def contacts(study: SimulatedStudy) -> Figure:
    """Contribution of each contact to the ground wrench, measured and moved to the base frame, over time."""
    taken = {
        name: study.problem.total(study.recording, {name}).values - study.measured.values for name in study.known.sites
    }
    drawn = {name.capitalize(): (x, line) for (name, x), line in zip(taken.items(), other_lines(taken), strict=True)}
    return figures.wrench_panels(study.recording.time, drawn, "Time (s)", shaded=episodes(study))


def episodes(study: SimulatedStudy) -> dict[str, np.ndarray]:
    """Samples in which all contacts touch (N,), by legend entry; empty if they never separate."""
    if not study.touching:
        return {}
    touching = np.all(list(study.touching.values()), axis=0)
    return {} if touching.all() else {"All touch" if study.several else "In contact": touching}
