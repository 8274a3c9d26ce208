"""Figures of a simulated study, as its file describes them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from experiments.output import figures
from experiments.output.study_tables import wrench_error
from experiments.studies.simulated import Study

TRUE_LINE = figures.Line("black", width=1.6)
"""The truth lies below all else, so thick that it shows on both sides."""

LINES = tuple(
    figures.Line(*each) for each in (("C1", 0.8, "-"), ("C0", 0.8, "--"), ("C2", 0.8, ":"), ("C3", 0.8, "-."))
)
"""Everything else differs by its strokes too, for print without colours."""

WINDOW = 25
"""Samples that a running mean of errors takes, a quarter of a second."""

LOWEST = 0.001
"""Share of a panel's largest error from which errors are shown."""


def figure(study: Study, name: str) -> Figure:
    """A figure of the study by the name of its file."""
    entry = study.file.figures[name]
    if entry["kind"] == "contacts":
        return contacts(study)
    kinds = {"wrenches": wrenches, "wrench errors": wrench_errors, "residuals": residuals}
    return kinds[entry["kind"]](study, entry.get("curves", {}))


def wrenches(study: Study, curves: Mapping[str, str]) -> Figure:
    """Wrenches over time: the true and the measured total one, the ground's, and those that models predict."""
    drawn = {label: wrench(study, what) for label, what in curves.items()}
    others = iter(LINES * len(curves))
    lines = {label: TRUE_LINE if what == "true" else next(others) for label, what in curves.items()}
    return figures.wrench_panels(
        study.recording.time, {k: (drawn[k], lines[k]) for k in curves}, "Time (s)", shaded=episodes(study)
    )


def wrench(study: Study, what: str) -> np.ndarray:
    """A wrench by what a study file calls it: one of `study_entries.WRENCHES`, or what a model predicts (N, 6)."""
    if what == "ground":
        return study.recording.wrench("ground").values
    totals = {"true": lambda: study.true, "measured": lambda: study.measured}
    return totals[what]().values if what in totals else study.fit(what).predicted


def wrench_errors(study: Study, curves: Mapping[str, str]) -> Figure:
    """Absolute errors of the recovered wrenches over samples, faint, and their running root mean squares.

    Where models err alike, as joint noise makes them, samples hide one another; their means show through each other's
    strokes.
    """
    errors = {label: wrench_error(study, model) for label, model in curves.items()}
    lines = dict(zip(curves, LINES * len(curves), strict=False))
    samples = {
        label: (np.abs(error), figures.Line(lines[label].color, width=0.3, alpha=0.35))
        for label, error in errors.items()
    }
    # The first lies lowest and has to be the widest.
    widths = np.linspace(1.6, 0.8, len(curves))
    means = {
        f"{label}, running RMS": (running_rms(error), replace(lines[label], width=float(width)))
        for (label, error), width in zip(errors.items(), widths, strict=True)
    }
    number = np.arange(1, len(study.recording.time) + 1)
    return figures.wrench_panels(
        number, samples | means, "Sample", symbol=r"|\Delta {}|", lowest=LOWEST, shaded=episodes(study)
    )


def running_rms(x: np.ndarray) -> np.ndarray:
    """Root mean square of up to `WINDOW` samples around each (N, 6)."""
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(x**2, axis=0)])
    middle = np.arange(len(x))
    first, last = np.maximum(middle - WINDOW // 2, 0), np.minimum(middle + WINDOW // 2 + 1, len(x))
    return np.sqrt(np.maximum(sums[last] - sums[first], 0) / (last - first)[:, None])


def residuals(study: Study, curves: Mapping[str, str]) -> Figure:
    """Measured total wrench less what models predict of it, over time."""
    shown = {label: study.total(model).values - study.fit(model).predicted for label, model in curves.items()}
    lines = LINES if len(curves) > 1 else (figures.Line("black"),)
    thin = (replace(line, width=0.4) for line in lines * len(curves))
    drawn = {label: (wrench, line) for (label, wrench), line in zip(shown.items(), thin, strict=False)}
    return figures.wrench_panels(study.recording.time, drawn, "Time (s)", symbol=r"\Delta {}", shaded=episodes(study))


def contacts(study: Study) -> Figure:
    """What each contact takes from the ground wrench, measured and moved to the base frame, over time."""
    taken = {
        name: study.problem.total(study.recording, {name}).values - study.measured.values for name in study.known.sites
    }
    drawn = {name.capitalize(): (x, line) for (name, x), line in zip(taken.items(), LINES * len(taken), strict=False)}
    return figures.wrench_panels(study.recording.time, drawn, "Time (s)", shaded=episodes(study))


def episodes(study: Study) -> dict[str, np.ndarray]:
    """When the contacts touch, all of several, by what the legend calls it (N,); nothing where they never let go."""
    if not study.touching:
        return {}
    touching = np.all(list(study.touching.values()), axis=0)
    return {} if touching.all() else {"All touch" if study.several else "In contact": touching}
