"""Report on a sweep: a table of the numbers of all runs, and a chart."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.data.outcomes import Sweep
from experiments.document import figures, symbols, tabular
from experiments.document.document import Document, Plot
from experiments.document.styles import empty_figure
from ident.display.plots import Figure, add_legend
from ident.errors import InputError

CHARTED = {
    "misaligned": {
        "condition_number_simplified": "Condition number, simplified model",
        "epsilon_simplified": "Residual ε, simplified model (N, N m)",
        "condition_number_full": "Condition number, full model on its own columns",
        "axis_error_deg": "Error of the recovered axes (deg)",
    },
    "multicontact": {
        "condition_number": "Condition number",
        "largest_error": "Largest error (kg, kg m, kg m²)",
        "largest_error_ignoring": "Largest error, contact ignored (kg, kg m, kg m²)",
        "contact_peak_force_N": "Peak contact force (N)",
    },
}
"""Numbers of a study's summary that the chart shows by default, and their titles."""


def table(sweep: Sweep, names: Sequence[str]) -> tabular.Table:
    """Means and standard deviations over the seeds, a row for each number and value."""
    rows = [
        (name, str(value), *_statistics(column))
        for name in names
        for value, column in zip(sweep.values, sweep.numbers(name).T, strict=True)
    ]
    columns = ("number", sweep.option, "runs", "mean", "std")
    title = f"Numbers over {tabular.heading(sweep.option)}, their means and standard deviations over the seeds"
    words = {name: tabular.heading(name) for name in names}
    return tabular.Table(title, columns, tuple(rows), decimals=4, deviations={"mean": "std"}, names=words)


def chart(sweep: Sweep, titles: Mapping[str, str]) -> Figure:
    """Chart of some numbers over the option, a panel for each: all seeds as dots, and their mean as a line."""
    numeric = not isinstance(sweep.values[0], str)
    x = np.array(sweep.values) if numeric else np.arange(len(sweep.values))
    order = np.argsort(x)
    with empty_figure(0.6 + 1.1 * len(titles)) as figure:
        panels = figure.subplots(len(titles), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (name, title) in zip(panels, titles.items(), strict=True):
            numbers = sweep.numbers(name)
            mean = np.array([_statistics(column)[1] for column in numbers.T], dtype=float)
            ax.plot(x[order], mean[order], "o-" if numeric else "o", color="C0", ms=3, zorder=3, label="mean")
            ax.plot(np.tile(x, len(numbers)), numbers.ravel(), "o", color="0.6", ms=1.5, label="seed")
            if np.nanmin(numbers) > 0 and np.nanmax(numbers) > 100 * np.nanmin(numbers):
                ax.set_yscale("log")
            else:
                figures.widen_flat(ax)
            ax.set_title(title, pad=3)
        if not numeric:
            panels[-1].set_xticks(x, [symbols.label(str(value)) for value in sweep.values])
            panels[-1].margins(x=0.2)
        panels[-1].set_xlabel(_label(sweep.option))
        add_legend(figure)
    return figure


def _statistics(x: np.ndarray) -> tuple[int, float | None, float | None]:
    """Number of runs that have a number, its mean and its standard deviation; None if undefined."""
    known = x[np.isfinite(x)]
    mean = float(known.mean()) if len(known) else None
    return len(known), mean, float(known.std(ddof=1)) if len(known) > 1 else None


def _label(name: str) -> str:
    """A name as a label: `axis_error_deg` becomes `Axis error (deg)`."""
    text = tabular.heading(name)
    return text[0].upper() + text[1:]


def document(sweep: Sweep, study: str, title: str, numbers: Sequence[str], provenance: dict[str, Any]) -> Document:
    """Table, chart and numbers of a sweep.

    Args:
        sweep: The sweep.
        study: Name of the study.
        title: Its title.
        numbers: Names of the numbers that the chart shows, by default `CHARTED`.
        provenance: Provenance of the results.

    Raises:
        InputError: There is no number of one of these names.
    """
    titles = CHARTED[study]
    charted = {name: titles.get(name, _label(name)) for name in numbers or titles}
    for name in charted:
        if name not in sweep.names:
            raise InputError(f"--numbers needs names of {', '.join(sweep.names)}, got '{name}'.")
    seeds = len(sweep.runs) // len(sweep.values)
    option = tabular.heading(sweep.option)
    caption = f"Numbers over {option}: of each seed, and their means."
    return Document(
        f"{title} over {option}",
        f"The study '{study}' over its option {sweep.option}, with {f'{seeds} seeds' if seeds > 1 else 'one seed'} of "
        "each value.",
        lines=[run["refused"] for run in sweep.runs if "refused" in run],
        heading="Refused",
        tables={"table_sweep": table(sweep, sweep.names)},
        figures={"figure_sweep": Plot(partial(chart, sweep, charted), caption)},
        numbers={"sweep": {"runs": sweep.runs, "provenance": provenance}, "provenance": provenance},
        screen=table(sweep, list(charted)).text(),
    )
