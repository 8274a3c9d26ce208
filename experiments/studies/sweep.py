"""A study with several values and seeds: its runs, a table of their numbers, and a chart."""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.cli.print_options import author_choices
from experiments.document import escape, figures, report
from experiments.document.page import PAGE, Said, complain, write_results
from experiments.document.results import Results
from experiments.reports import study_report
from experiments.runs.checkpoint import Checkpoint
from experiments.runs.workers import worker_pool
from experiments.studies.simulated import simulated
from experiments.studies.study_entries import packaged
from ident.errors import InputError
from ident.estimation.in_order import in_order

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

FILE = "runs.npz"
"""File in the output folder with the summaries of all runs."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Results of a study for each value and seed.

    Attributes:
        option: Name of the option.
        values: Its values.
        runs: Value, seed and summary of each run, or its error under `refused`; all values with the first seed, then
            with the next.
    """

    option: str
    values: Sequence[str | float]
    runs: Sequence[Mapping[str, Any]]

    @property
    def names(self) -> list[str]:
        """Names of the numbers in the summaries, without the paper's."""
        names = dict.fromkeys(name for run in self.runs for name, x in run.items() if isinstance(x, int | float))
        return [name for name in names if not name.startswith("paper_") and name not in (self.option, "seed")]

    def numbers(self, name: str) -> np.ndarray:
        """A number for each seed and value (seeds, values); NaN if a summary lacks it."""
        return np.array([run.get(name, np.nan) for run in self.runs], dtype=float).reshape(-1, len(self.values))


def run_of(study: str, option: str, run: tuple[str | float, int]) -> list[str]:
    """Summary of a study with a value and a seed as JSON, in a batch of one; run by workers."""
    value, seed = run
    try:
        found = study_report.summary(simulated(packaged(study, **{option: value}, seed=seed)))
    except InputError as error:
        found = {"refused": f"{option} {value}, seed {seed}: {error}"}
    return [json.dumps(found)]


def values_of(study: str, option: str, texts: Sequence[str]) -> list[str | float]:
    """Values of a study's option, of its default's type.

    Raises:
        InputError: The study has no such option, or the values are missing, equal or not of that type.
    """
    defaults = {name: value for name, value in packaged(study).options.items() if name != "seed"}
    if option not in defaults:
        raise InputError(f"--over needs an option of {study}, one of {', '.join(defaults)}, got '{option}'.")
    kind = type(defaults[option])
    try:
        values = [kind(text) for text in texts]
    except ValueError as error:
        raise InputError(f"--over {option} needs values of type {kind.__name__} ({error}).") from None
    if not values or len(set(values)) < len(values) or not all(isinstance(x, str) or abs(x) < np.inf for x in values):
        raise InputError(f"--over {option} needs one or more finite values, all different, got '{' '.join(texts)}'.")
    return values


def table(found: Sweep, names: Sequence[str]) -> report.Table:
    """Means and standard deviations over the seeds, a row for each number and value."""
    rows = [
        (name, str(value), *_statistics(column))
        for name in names
        for value, column in zip(found.values, found.numbers(name).T, strict=True)
    ]
    columns = ("number", found.option, "runs", "mean", "std")
    title = f"Numbers over {report.heading(found.option)}, their means and standard deviations over the seeds"
    words = {name: report.heading(name) for name in names}
    return report.Table(title, columns, tuple(rows), decimals=4, names=words)


def chart(found: Sweep, titles: Mapping[str, str]) -> Figure:
    """Chart of some numbers over the option, a panel for each: all seeds as dots, and their mean as a line."""
    numeric = not isinstance(found.values[0], str)
    x = np.array(found.values) if numeric else np.arange(len(found.values))
    order = np.argsort(x)
    with figures.paper_style():
        figure = Figure(figsize=(figures.column_width(), 0.6 + 1.1 * len(titles)))
        panels = figure.subplots(len(titles), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (name, title) in zip(panels, titles.items(), strict=True):
            numbers = found.numbers(name)
            mean = np.array([_statistics(column)[1] for column in numbers.T], dtype=float)
            ax.plot(x[order], mean[order], "o-" if numeric else "o", color="C0", ms=3, zorder=3, label="mean")
            for row in numbers:
                ax.plot(x, row, "o", color="0.6", ms=1.5, label="seed")
            if np.nanmin(numbers) > 0 and np.nanmax(numbers) > 100 * np.nanmin(numbers):
                ax.set_yscale("log")
            else:
                figures.widen_flat(ax)
            ax.set_title(title, pad=3)
        if not numeric:
            panels[-1].set_xticks(x, [escape.label(str(value)) for value in found.values])
            panels[-1].margins(x=0.2)
        panels[-1].set_xlabel(_label(found.option))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles[:2], labels[:2], loc="outside upper center", ncols=2)
    return figure


def _statistics(x: np.ndarray) -> tuple[int, float | None, float | None]:
    """Number of runs that have a number, its mean and its standard deviation; None if undefined."""
    known = x[np.isfinite(x)]
    mean = float(known.mean()) if len(known) else None
    return len(known), mean, float(known.std(ddof=1)) if len(known) > 1 else None


def _label(name: str) -> str:
    """A name as a label: `axis_error_deg` becomes `Axis error (deg)`."""
    text = report.heading(name)
    return text[0].upper() + text[1:]


def swept(args: argparse.Namespace, option: str, values: Sequence[str | float]) -> Sweep:
    """Runs the study with each value and seed, or the remainder of an interrupted run.

    Raises:
        InputError: All runs raise errors, or a worker died.
    """
    runs = [(value, seed) for seed in range(args.seeds) for value in values]
    kept = Checkpoint("runs", args.out / FILE, {"study": args.study, "option": option, "values": values})
    done = kept.done()[: len(runs)] if args.resume else []
    with worker_pool(max(1, min(args.workers, len(runs) - len(done))), args.scheduler, args.tls) as pool:
        work = partial(run_of, args.study, option)
        with closing(in_order(pool.executor, work, runs[len(done) :], ahead=pool.ahead)) as batches:
            outcomes = kept.collect(batches, len(runs), done)
    found = [
        {option: value, "seed": seed, **json.loads(str(x))} for (value, seed), x in zip(runs, outcomes, strict=True)
    ]
    refused = [run["refused"] for run in found if "refused" in run]
    if len(refused) == len(found):
        raise InputError(f"{args.study} refuses every run: {refused[0]}")
    for sentence in refused:
        print(f"Refused: {sentence}", file=sys.stderr)
    return Sweep(option, values, found)


def run(args: argparse.Namespace) -> None:
    """Runs the sweep, and writes and prints its results."""
    option, *texts = args.over
    values = values_of(args.study, option, texts)
    args.out = args.out / args.study / option
    with report.writable(args.out):
        found = swept(args, option, values)
    titles = CHARTED[args.study]
    charted = {name: titles.get(name, _label(name)) for name in args.numbers or titles}
    for name in charted:
        if name not in found.names:
            raise InputError(f"--numbers needs names of {', '.join(found.names)}, got '{name}'.")
    choices = {key: getattr(args, key) for key in ("study", "over", "seeds", "numbers", "formats")}
    choices |= author_choices(args)
    origin = report.provenance(choices)
    written = Results(
        {"table_sweep": table(found, found.names)},
        {
            "figure_sweep": (
                chart(found, charted),
                f"Numbers over {report.heading(option)}: of each seed, and their means.",
            )
        },
        {"sweep": {"runs": found.runs, "provenance": origin}, "provenance": origin},
    )
    refused = [run["refused"] for run in found.runs if "refused" in run]
    with report.results_folder(args.out) as folder:
        seeds = f"{args.seeds} seeds" if args.seeds > 1 else "one seed"
        about = f"The study '{args.study}' over its option {option}, with {seeds} of each value."
        said = Said(
            f"{packaged(args.study).title} over {report.heading(option)}", about, lines=refused, heading="Refused"
        )
        unprinted = write_results(args, folder, written, args.formats, said)
    print(table(found, list(charted)).text())
    print(f"Everything is in {args.out}; open {PAGE}.")
    complain(unprinted)
