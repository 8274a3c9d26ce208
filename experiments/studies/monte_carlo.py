"""How the errors of many trials are distributed, and where the paper's single run lies among them."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.cli.defaults import REDRAWN
from experiments.output import figures, report
from experiments.output.results import Results
from experiments.runs.workers import worker_pool
from experiments.studies.errors import Errors
from experiments.studies.fitting import ESTIMATORS
from experiments.studies.trials import (
    FILE,
    JOINT_FILE,
    Draw,
    Outcome,
    joint_trials_done,
    joint_trials_kept,
    run_trials,
    trials_done,
)
from ident.recordings.recording import Recording

JOINT = "_joint"
"""What the name of a model ends with where it is identified by the joint estimate."""


@dataclass(frozen=True, eq=False)
class Distribution(Errors):
    """Errors of one model's base parameters over the trials, and the paper's.

    Attributes:
        published: The paper's errors (parameters,).
    """

    published: np.ndarray

    @property
    def percentile(self) -> np.ndarray:
        """Percentiles of the paper's errors among the trials, over the half digit that print has rounded (2, p)."""
        low, high = self.published - 0.005, self.published + 0.005
        return 100 * np.array([np.mean(self.errors < limit, axis=0) for limit in (low, high)])


def table(model: str, found: Distribution) -> report.Table:
    """Mean, spread and interval of the errors beside the prediction and the paper's single run."""
    low, high = found.interval
    joint = f"joint estimate ({ESTIMATORS['joint']})"
    whose = f"{model.removesuffix(JOINT)} model" + (f"'s {joint}" if model.endswith(JOINT) else "")
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
            paper_percentile=[f"{a:.0f} to {b:.0f}" for a, b in found.percentile.T],
        ),
        decimals=4,
    )


def chart(found: Mapping[str, Distribution]) -> Figure:
    """All parameters at a glance, a panel for each model: interval, mean, prediction and the paper's error."""
    with figures.paper_style():
        figure = Figure(figsize=(3.5 if len(found) < 3 else 7.16, 3.2))
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for ax, (model, d) in zip(panels, found.items(), strict=True):
            rows = np.arange(len(d.names))
            ax.axvline(0, color="0.6", lw=0.5)
            spread = 1.96 * d.predicted_std
            ax.barh(rows, 2 * spread, left=-spread, height=0.6, color="0.85", label="predicted 95 %")
            ax.hlines(rows, *d.interval, color="tab:blue", lw=1.2, label="95 % of trials")
            ax.plot(d.mean, rows, "o", color="tab:blue", ms=2.5, label="mean")
            ax.plot(d.published, rows, "x", color="tab:red", ms=4, mew=0.9, label="paper")
            ax.set_title(report.heading(model))
            # Linear within ±0.01, logarithmic beyond, so that parameters known to grams stand beside wrong ones.
            ax.set_xscale("symlog", linthresh=0.01, linscale=1.0)
            ticks = [-1, -0.1, -0.01, 0, 0.01, 0.1, 1]
            ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks], rotation=60)
            shown = np.concatenate([d.interval.ravel(), d.published])
            ax.set_xlim(-_limit(-shown.min()), _limit(shown.max()))
            ax.set_xlabel("Error (kg, kg m, kg m²)")
            ax.set_yticks(rows, [figures.parameter_symbol(name) for name in d.names])
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2 if len(found) < 3 else 4)
    return figure


def _limit(error: float) -> float:
    """A limit of the abscissa that an error does not reach."""
    return next((limit for limit in (0.3, 1.0, 3.0, 10.0) if error < 0.9 * limit), 100.0)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a study needs for its trials.

    Attributes:
        scene: Arguments of `scenes.load`.
        analyse: What becomes of a recording.
        names: Names of the base parameters.
        published: The paper's errors of each model, in the order of the outcomes.
        joint: What becomes of a recording by the joint estimate of one of these models.
        joint_model: Name of that model.
        remark: What else must be known of the predicted standard deviations.
    """

    scene: Mapping[str, Any]
    analyse: Callable[[Recording], Outcome]
    names: tuple[str, ...]
    published: Mapping[str, Sequence[float]]
    joint: Callable[[Recording], Outcome]
    joint_model: str
    remark: str = ""


def conclude(
    args: argparse.Namespace,
    choices: Mapping[str, Any],
    recording: Recording,
    plan: Plan,
    results: Results,
    text: str,
) -> Results:
    """Ends a study's command line: writes its results, prints them, and runs its trials.

    Args:
        args: The study's options.
        choices: Those that decide the results, for the provenance.
        recording: The study's recording.
        plan: What the trials need.
        results: What the study leaves behind.
        text: What the terminal shows.

    Returns:
        All that was written, by the trials too.
    """
    draw = Draw.of(args, plan.scene, recording)
    done = trials_done(draw, args), joint_trials_done(draw, args)
    origin = report.provenance({**choices, "formats": args.formats}, recording.provenance)
    origin["estimators"] = ESTIMATORS
    written = results | Results(numbers={"provenance": origin})
    with report.results_folder(args.out, stale=report.OUTPUTS) as folder:
        written.write(folder, args.formats)
    print(text)
    if args.trials:
        written |= _run(draw, *done, plan, args)
    print(f"Tables, figures, summary and provenance are in {args.out}.")
    return written


def _run(
    draw: Draw, done: Sequence[Outcome], joint_done: Sequence[Outcome], plan: Plan, args: argparse.Namespace
) -> Results:
    """Runs the trials, and writes and prints how their errors are distributed."""
    found = _distributions(draw, done, joint_done, plan, args)
    results = _results(found, draw, plan.remark)
    with report.results_folder(args.out) as folder:
        results.write(folder, args.formats)
    for model, d in found.items():
        print(results.tables[f"monte_carlo_{model}"].text())
        biased = np.flatnonzero(np.abs(d.mean) > 4 * d.std / np.sqrt(len(d.errors)))
        if len(biased):
            print("Biased beyond chance: " + ", ".join(f"{d.names[k]} by {d.mean[k]:+.3f}" for k in biased) + "\n")
    print(
        "A bias of least squares comes from a wrong model or from noise on the joint states, which is in the\n"
        "regressor (errors in variables); its predicted standard deviations know the wrenches' noise only and do not\n"
        f"show it. Those of the joint estimate know the angles' noise too.\n{plan.remark}\n"
    )
    return results


def _distributions(
    draw: Draw, done: Sequence[Outcome], joint_done: Sequence[Outcome], plan: Plan, args: argparse.Namespace
) -> dict[str, Distribution]:
    """Runs the trials, and the first of them once more for the joint estimate."""
    joint_trials = min(args.trials, args.joint_trials)
    if not args.resume:
        joint_trials_kept(draw, args).set_aside()
    left = max(args.trials - len(done), joint_trials - len(joint_done))
    with worker_pool(max(1, min(args.workers, left)), args.scheduler, args.tls) as pool:
        run = partial(run_trials, draw, executor=pool.executor, ahead=pool.ahead, threads=pool.threads)
        outcomes = run(plan.analyse, args.trials, file=args.out / FILE, done=done)
        found = {
            model: Distribution(plan.names, outcomes[:, k, 0], outcomes[:, k, 1], np.array(errors))
            for k, (model, errors) in enumerate(plan.published.items())
        }
        if joint_trials:
            (file, what), published = (args.out / JOINT_FILE, "joint trials"), found[plan.joint_model].published
            outcomes = run(plan.joint, joint_trials, file=file, done=joint_done, what=what)
            joint = Distribution(plan.names, outcomes[:, 0, 0], outcomes[:, 0, 1], published)
            found[plan.joint_model + JOINT] = joint
    return found


def _results(found: Mapping[str, Distribution], draw: Draw, remark: str) -> Results:
    """A table for each model, a chart and key numbers."""
    caption = (
        f"Errors over {max(len(d.errors) for d in found.values())} trials beside the predicted interval and the "
        f"paper's single run. Drawn anew: {REDRAWN[draw.redrawn]}."
    )
    caption += remark and f" {remark}"
    caption += "".join(
        f" Joint: {ESTIMATORS['joint']}; over the first {len(d.errors)} trials."
        for model, d in found.items()
        if model.endswith(JOINT)
    )
    return Results(
        tables={f"monte_carlo_{model}": table(model, d) for model, d in found.items()},
        figures={"figure_monte_carlo": (chart(found), caption)},
        numbers={"monte_carlo": _numbers(found) | {"provenance": report.provenance(draw.identity)}},
    )


def _numbers(found: Mapping[str, Distribution]) -> dict[str, Any]:
    """Key numbers for scripts."""
    numbers: dict[str, Any] = {"trials": max(len(d.errors) for d in found.values())}
    for model, d in found.items():
        if model.endswith(JOINT):
            numbers["joint_trials"] = len(d.errors)
        columns = {
            "std_over_predicted": d.std / d.predicted_std,
            "coverage_95": d.coverage,
            "bias": d.mean,
            "bias_standard_error": d.std / np.sqrt(len(d.errors)),
        }
        for name, values in columns.items():
            numbers[f"{name}_{model}"] = dict(zip(d.names, values.tolist(), strict=True))
    return numbers
