"""Figures of a simulated study, as described in its file."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import cycle
from typing import Any

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
    entry, x, label = study.file.figures[name], study.recording.time, "Time (s)"
    more: dict[str, Any] = {}
    if entry.kind == "contacts":
        drawn = contacts(study)
    elif entry.kind == "wrenches":
        drawn = wrenches(study, entry.curves)
    elif entry.kind == "residuals":
        drawn, more = residuals(study, entry.curves), {"symbol": r"\Delta {}"}
    else:
        drawn, x, label = wrench_errors(study, entry.curves), np.arange(1, len(x) + 1), "Sample"
        more = {"symbol": r"|\Delta {}|", "lowest": LOWEST}
    return figures.wrench_panels(x, drawn, label, shaded=episodes(study), **more)


Drawn = dict[str, tuple[np.ndarray, figures.Line]]
"""Wrenches (N, 6) with their lines, by legend entry."""


def wrenches(study: SimulatedStudy, curves: Mapping[str, str]) -> Drawn:
    """Wrenches over time: the true and the measured total, the ground's, and predictions of models."""
    others = iter(other_lines(curves.values(), without="true"))
    drawn: Drawn = {}
    for label, what in curves.items():
        color = INKS[inks(curves.values())[what]]
        drawn[label] = wrench(study, what), figures.Line(color, TRUE_WIDTH) if what == "true" else next(others)
    return drawn


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


def wrench_errors(study: SimulatedStudy, curves: Mapping[str, str]) -> Drawn:
    """Absolute errors of the recovered wrenches over samples, as dots, and their running RMS.

    Models with equal errors, due to joint noise, have alternating dots, and means that show between each other's
    dashes.
    """
    samples, means = Drawn(), Drawn()
    # The first is drawn lowest and has to be the widest.
    widths = np.linspace(1.6, 0.8, len(curves)).tolist()
    each = zip(curves.items(), other_lines(curves.values()), widths, strict=True)
    for k, ((label, model), line, width) in enumerate(each):
        error = wrench_error(study, model)
        samples[label] = np.abs(error), replace(line, style="", width=DOTS, first=k)
        means[f"{label}, running RMS"] = running_rms(error), replace(line, width=width)
    return samples | means


def other_lines(curves: Iterable[str], without: str = "") -> list[figures.Line]:
    """Lines of curves, but for the one `without`, each with its own colour and style."""
    drawn, strokes = list(curves), cycle(STROKES)
    colors = inks(drawn)
    return [figures.Line(INKS[colors[what]], style=next(strokes)) for what in drawn if what != without]


def running_rms(x: np.ndarray) -> np.ndarray:
    """RMS of up to `WINDOW` samples around each (N, 6)."""
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(x**2, axis=0)])
    middle = np.arange(len(x))
    first, last = np.maximum(middle - WINDOW // 2, 0), np.minimum(middle + WINDOW // 2 + 1, len(x))
    return np.sqrt(np.maximum(sums[last] - sums[first], 0) / (last - first)[:, None])


def residuals(study: SimulatedStudy, curves: Mapping[str, str]) -> Drawn:
    """Measured total wrench less the models' predictions, over time."""
    lines = other_lines(curves.values()) if len(curves) > 1 else [figures.Line("black")]
    return {
        label: (study.total(model).values - study.fit(model).predicted, replace(line, width=0.4))
        for (label, model), line in zip(curves.items(), lines, strict=True)
    }


def contacts(study: SimulatedStudy) -> Drawn:
    """Contribution of each contact to the ground wrench, measured and moved to the base frame, over time."""
    measured, sites = study.measured.values, study.known.sites
    return {
        name.capitalize(): (study.problem.total(study.recording, {name}).values - measured, line)
        for name, line in zip(sites, other_lines(sites), strict=True)
    }


def episodes(study: SimulatedStudy) -> dict[str, np.ndarray]:
    """Samples in which all contacts touch (N,), by legend entry; empty if they never separate."""
    if not study.touching:
        return {}
    touching = np.all(list(study.touching.values()), axis=0)
    return {} if touching.all() else {"All touch" if study.several else "In contact": touching}
