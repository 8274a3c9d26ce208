"""Distribution of the errors over many trials, and percentiles of the paper's single run."""

import argparse
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.cli.print_options import author_choices, layout_of
from experiments.data.defaults import REDRAWN
from experiments.data.errors import Errors
from experiments.data.fitting import ESTIMATORS
from experiments.data.simulated import Study
from experiments.document import figures, report
from experiments.document.layout import PAPER, Layout
from experiments.document.page import PAGE, Said, filmed, write_report
from experiments.document.results import Results
from experiments.document.terminal import wrapped
from experiments.runs.workers import worker_pool
from experiments.studies.simulated import trajectory_trial, trial
from experiments.studies.trials import (
    FILE,
    TRAJECTORY_FILE,
    Draw,
    Outcome,
    run_trials,
    trajectory_trials_done,
    trajectory_trials_kept,
    trials_done,
)
from ident.errors import InputError

TRAJECTORY = "_trajectory"
"""Suffix of a model's name for its trajectory estimate."""


@dataclass(frozen=True, eq=False)
class Distribution(Errors):
    """Errors of one model's base parameters over the trials, and the paper's errors.

    Attributes:
        published: The paper's errors (parameters,).
    """

    published: np.ndarray

    @property
    def percentile(self) -> np.ndarray:
        """Percentiles of the paper's errors among the trials, at both limits of their rounding in print (2, p)."""
        low, high = self.published - 0.005, self.published + 0.005
        return 100 * np.array([np.mean(self.errors < limit, axis=0) for limit in (low, high)])


def table(model: str, found: Distribution, bodies: tuple[str, ...] = ()) -> report.Table:
    """Mean, spread and interval of the errors beside the prediction and the paper's single run."""
    low, high = found.interval
    joint, name = f"trajectory estimate ({ESTIMATORS['trajectory']})", model.removesuffix(TRAJECTORY)
    whose = f"{name} model" + (f"'s {joint}" if model.endswith(TRAJECTORY) else "")
    of_model = f"{name} model's trajectory estimate" if name != model else f"{name} model"
    caption = f"Errors of the {of_model} over {len(found.errors)} trials"
    return report.Table(
        f"Errors of the {whose} over {len(found.errors)} trials, kg, kg m and kg m²",
        *report.columns(
            parameter=found.names,
            mean_error=found.mean,
            std=found.std,
            low_95=low,
            high_95=high,
            predicted_std=found.predicted_std,
            coverage_95=found.coverage,
            paper_error=found.published,
            paper_percentile=["" if np.isnan(a) else f"{a:.0f} to {b:.0f}" for a, b in found.percentile.T],
        ),
        decimals=4,
        caption=caption,
        notes=("Paper's percentile: where the paper's single run lies among the trials.",),
        bodies=bodies,
    )


def chart(found: Mapping[str, Distribution], bodies: tuple[str, ...] = (), layout: Layout = PAPER) -> Figure:
    """Chart of all parameters, a panel for each model: interval, mean, prediction and the paper's error."""
    with figures.paper_style():
        width = figures.column_width() if len(found) < 3 else figures.text_width()
        figure = Figure(figsize=(width, 3.2))
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for ax, (model, d) in zip(panels, found.items(), strict=True):
            _draw(ax, d, [k for k, name in enumerate(d.names) if layout.shows(name, bodies)])
            ax.set_title(report.heading(model))
        names = [name for name in next(iter(found.values())).names if layout.shows(name, bodies)]
        panels[0].set_yticks(np.arange(len(names)), [figures.named_symbol(name, bodies) for name in names])
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2 if len(found) < 3 else 4)
    return figure


def _draw(ax: Axes, d: Distribution, shown: Sequence[int]) -> None:
    """Draws one model's panel, with some of its parameters."""
    rows, spread, (low, high) = np.arange(len(shown)), 1.96 * d.predicted_std[shown], d.interval[:, shown]
    ax.axvline(0, color="0.6", lw=0.5)
    ax.barh(rows, 2 * spread, left=-spread, height=0.6, color="0.85", label="predicted 95 %")
    ax.hlines(rows, low, high, color="C0", lw=1.2, label="95 % of trials")
    ax.plot(d.mean[shown], rows, "o", color="C0", ms=2.5, label="mean")
    if np.isfinite(d.published).any():
        ax.plot(d.published[shown], rows, "x", color="C1", ms=4, mew=0.9, label="paper")
    # Linear within ±0.01 and logarithmic beyond, so that errors of grams and gross ones are both visible.
    ax.set_xscale("symlog", linthresh=0.01, linscale=1.0)
    ticks = [-1, -0.1, -0.01, 0, 0.01, 0.1, 1]
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks], rotation=60)
    values = np.concatenate([low, high, d.published[shown]])
    ax.set_xlim(-_limit(-np.nanmin(values)), _limit(np.nanmax(values)))
    ax.set_xlabel("Error (kg, kg m, kg m²)")


def _limit(error: float) -> float:
    """A limit of the abscissa beyond an error."""
    return next((limit for limit in (0.3, 1.0, 3.0, 10.0) if error < 0.9 * limit), 100.0)


def conclude(
    args: argparse.Namespace, study: Study, results: Results, text: str, said: Said, source: Path | None
) -> Results:
    """Writes and prints a study's results, and runs its trials.

    Args:
        args: The command line.
        study: The study.
        results: The results.
        text: Text for the terminal.
        said: Text of the page.
        source: The study file; None for a study of the package.

    Returns:
        All written results, with those of the trials.
    """
    layout = layout_of(args)
    if args.trials and not study.file.trials:
        raise InputError("--trials needs [trials] in the study file, with models by what the tables are to call them.")
    draw = Draw.of(study.file, args.redraw, study.recording)
    done = trials_done(draw, args), trajectory_trials_done(draw, args)
    choices = {**study.file.options, "formats": args.formats, **author_choices(args)}
    origin = report.provenance(choices, study.recording.provenance)
    origin["estimators"] = ESTIMATORS
    if source is not None:
        origin["study"] = {"file": source.name, "sha256": hashlib.sha256(source.read_bytes()).hexdigest()}
    written = results | Results(numbers={"provenance": origin})
    inputs = [] if source is None else [source]
    with report.results_folder(args.out, stale=report.OUTPUTS, inputs=inputs) as folder:
        written.write(folder, args.formats, layout)
        said, missing = filmed(args.film, folder, said)
        write_report(folder, written, args.formats, said)
    print(text)
    if args.trials:
        written |= _run(draw, *done, study, args, layout)
        write_report(args.out, written, args.formats, said)
    print(f"Everything is in {args.out}; open {PAGE}.")
    if missing:
        raise InputError(missing)
    return written


def _run(
    draw: Draw,
    done: Sequence[Outcome],
    trajectory_done: Sequence[Outcome],
    study: Study,
    args: argparse.Namespace,
    layout: Layout,
) -> Results:
    """Runs the trials, and writes and prints the distribution of their errors."""
    found = _distributions(draw, done, trajectory_done, study, args)
    remark = "No predicted interval of a model knows the errors of its recovered axes." if study.recovers else ""
    results = _results(found, draw, remark, study.known.bodies, layout)
    with report.results_folder(args.out) as folder:
        results.write(folder, args.formats, layout)
    for model, d in found.items():
        print(results.tables[f"monte_carlo_{model}"].text())
        biased = np.flatnonzero(np.abs(d.mean) > 4 * d.std / np.sqrt(len(d.errors)))
        if len(biased):
            named = ", ".join(f"{d.names[k]} by {d.mean[k]:+.3f}" for k in biased)
            print(wrapped(f"Biased beyond chance: {named}\n"))
    print(
        "A bias of least squares comes from a wrong model or from noise on the joint states, which is in the\n"
        "regressor (errors in variables); its predicted standard deviations know the wrenches' noise only and do not\n"
        f"show it. Those of the trajectory estimate know the angles' noise too.\n{remark}\n"
    )
    return results


def _distributions(
    draw: Draw, done: Sequence[Outcome], trajectory_done: Sequence[Outcome], study: Study, args: argparse.Namespace
) -> dict[str, Distribution]:
    """Runs the trials, and repeats the first of them for the trajectory estimate."""
    file, trajectory_model = study.file, study.file.trajectory_trials
    trajectory_trials = min(args.trials, args.trajectory_trials) if trajectory_model else 0
    if not args.resume:
        trajectory_trials_kept(draw, args).set_aside()
    left = max(args.trials - len(done), trajectory_trials - len(trajectory_done))
    analyse = partial(trial, study.problem, tuple(file.trials.values()))
    with worker_pool(max(1, min(args.workers, left)), args.scheduler, args.tls) as pool:
        run = partial(run_trials, draw, executor=pool.executor, ahead=pool.ahead, threads=pool.threads)
        outcomes = run(analyse, args.trials, file=args.out / FILE, done=done)
        found = {
            name: _distribution(study, model, outcomes[:, k]) for k, (name, model) in enumerate(file.trials.items())
        }
        if trajectory_model and trajectory_trials:
            (kept, what), model = (args.out / TRAJECTORY_FILE, "trajectory trials"), file.trials[trajectory_model]
            analyse = partial(trajectory_trial, study.problem, model)
            outcomes = run(analyse, trajectory_trials, file=kept, done=trajectory_done, what=what)
            found[trajectory_model + TRAJECTORY] = _distribution(study, model, outcomes[:, 0])
    return found


def _distribution(study: Study, model: str, outcomes: np.ndarray) -> Distribution:
    """A model's errors and predicted standard deviations (trials, 2, parameters), beside the published errors."""
    names, published = study.fit(model).base.names, study.file.published.get("error", {}).get(model, {})
    beside = np.array([published.get(name, np.nan) for name in names])
    return Distribution(names, outcomes[:, 0], outcomes[:, 1], beside)


def _results(
    found: Mapping[str, Distribution], draw: Draw, remark: str, bodies: tuple[str, ...], layout: Layout
) -> Results:
    """A table for each model, a chart and key numbers."""
    caption = (
        f"Errors over {max(len(d.errors) for d in found.values())} trials beside the predicted interval and the "
        f"paper's single run. Drawn anew: {REDRAWN[draw.redrawn]}."
    )
    caption += remark and f" {remark}"
    caption += "".join(
        f" Joint: {ESTIMATORS['trajectory']}; over the first {len(d.errors)} trials."
        for model, d in found.items()
        if model.endswith(TRAJECTORY)
    )
    return Results(
        tables={f"monte_carlo_{model}": table(model, d, bodies) for model, d in found.items()},
        figures={"figure_monte_carlo": (chart(found, bodies, layout), caption)},
        numbers={"monte_carlo": _numbers(found) | {"provenance": report.provenance(draw.identity)}},
    )


def _numbers(found: Mapping[str, Distribution]) -> dict[str, Any]:
    """Key numbers for scripts."""
    numbers: dict[str, Any] = {"trials": max(len(d.errors) for d in found.values())}
    for model, d in found.items():
        if model.endswith(TRAJECTORY):
            numbers["trajectory_trials"] = len(d.errors)
        columns = {
            "std_over_predicted": d.std / d.predicted_std,
            "coverage_95": d.coverage,
            "bias": d.mean,
            "bias_standard_error": d.std / np.sqrt(len(d.errors)),
        }
        for name, values in columns.items():
            numbers[f"{name}_{model}"] = dict(zip(d.names, values.tolist(), strict=True))
    return numbers
