"""Reports on many runs of a study: distribution of errors over trials, and numbers over the values of an option."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.data.fitting import ESTIMATORS, TRAJECTORY, Distribution
from experiments.data.paper import REDRAWN
from experiments.data.simulated_study import SimulatedStudy
from experiments.document import figures, tabular, typography
from experiments.document.figures import empty_figure
from experiments.document.tabular import as_stated, number, of_deviations, of_numbers
from experiments.document.typography import wrapped
from experiments.document.writer import Document, Plot
from experiments.reports import study_report
from experiments.studies.simulation import Swept
from ident.display.plots import Axes, Figure, add_legend
from ident.display.text import decimals_of
from ident.tolerances import INTERVAL

MEANING = (
    "A bias of least squares comes from a wrong model or from noise on the joint states, which is in the\n"
    "regressor (errors in variables); its predicted standard deviations include the wrenches' noise only and do\n"
    "not show it. Those of the trajectory estimate include the angles' noise too.\n"
)
"""Text after the tables."""


def table(
    model: str, distribution: Distribution, bodies: tuple[str, ...] = (), sums: Sequence[str] = ()
) -> tabular.Table:
    """Mean, spread and interval of the errors beside the prediction and the paper's single run.

    Args:
        model: Name of the model.
        distribution: Its errors.
        bodies: Names of the bodies of the parameters.
        sums: Sums that the parameters stand for.
    """
    name, trials, std = model.removesuffix(TRAJECTORY), len(distribution.errors), distribution.std
    low, high = distribution.interval
    of_model = f"{name} model's trajectory estimate" if name != model else f"{name} model"
    whose = f"{of_model} ({ESTIMATORS['trajectory']})" if name != model else of_model
    return tabular.Table(
        f"Errors of the {whose} over {trials} trials, kg, kg m and kg m²",
        *tabular.columns(
            parameter=distribution.names,
            mean_error=distribution.mean,
            std=std,
            low_95=low,
            high_95=high,
            predicted_std=distribution.predicted_std,
            coverage_95=distribution.coverage,
            paper_error=distribution.published,
            paper_percentile=[
                "" if np.isnan(paper) else f"{low:.0f} to {high:.0f}"
                for paper, (low, high) in zip(distribution.published, distribution.percentile.T, strict=True)
            ],
        ),
        # The paper's errors are as printed.
        digits={
            **dict.fromkeys(("low_95", "high_95"), of_numbers(std)),
            "predicted_std": of_deviations(distribution.predicted_std),
            "paper_error": [as_stated(distribution.published)] * len(std),
        },
        deviations={"mean_error": "std"},
        regrouped={"": sums},
        caption=f"Errors of the {of_model} over {trials} trials",
        notes=("Paper's percentile: where the paper's single run lies among the trials.",) * _beside(distribution),
        bodies=bodies,
    )


def _beside(distribution: Distribution) -> bool:
    """True if there are errors of the paper to compare with."""
    return bool(np.isfinite(distribution.published).any())


def chart(distributions: Mapping[str, Distribution], bodies: tuple[str, ...] = ()) -> Figure:
    """Chart of all parameters, a panel for each model: interval, mean, prediction and the paper's error."""
    wide = len(distributions) > 2
    with empty_figure(3.2, wide=wide) as figure:
        panels = figure.subplots(1, len(distributions), sharey=True, squeeze=False)[0]
        for ax, (model, d) in zip(panels, distributions.items(), strict=True):
            _draw(ax, d)
            ax.set_title(tabular.heading(model))
        names = next(iter(distributions.values())).names
        panels[0].set_yticks(np.arange(len(names)), [typography.named_symbol(name, bodies) for name in names])
        panels[0].invert_yaxis()
        add_legend(figure, columns=4 if wide else 2)
    return figure


def _draw(ax: Axes, d: Distribution) -> None:
    """Draws one model's panel."""
    rows, spread, (low, high) = np.arange(len(d.names)), INTERVAL * d.predicted_std, d.interval
    ax.axvline(0, color="0.6", lw=0.5)
    ax.barh(rows, 2 * spread, left=-spread, height=0.6, color="0.85", label="predicted 95 %")
    ax.hlines(rows, low, high, color="C0", lw=1.2, label="95 % of trials")
    ax.plot(d.mean, rows, "o", color="C0", ms=2.5, label="mean")
    if _beside(d):
        ax.plot(d.published, rows, "x", color="C1", ms=4, mew=0.9, label="paper")
    # Linear within ±0.01 and logarithmic beyond, so that errors of grams and gross ones are both visible.
    ax.set_xscale("symlog", linthresh=0.01, linscale=1.0)
    ticks = [-1, -0.1, -0.01, 0, 0.01, 0.1, 1]
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks], rotation=60)
    values = np.concatenate([low, high, d.published])
    ax.set_xlim(-_limit(-np.nanmin(values)), _limit(np.nanmax(values)))
    ax.set_xlabel("Error (kg, kg m, kg m²)")


def _limit(error: float) -> float:
    """A limit of the abscissa beyond an error."""
    return next((limit for limit in (0.3, 1.0, 3.0, 10.0) if error < 0.9 * limit), 100.0)


def document(
    distributions: Mapping[str, Distribution], study: SimulatedStudy, redrawn: str, provenance: dict[str, Any]
) -> Document:
    """A table for each model, a chart and key numbers.

    Args:
        distributions: Errors by model.
        study: The study.
        redrawn: One of `REDRAWN`.
        provenance: Provenance of the trials.
    """
    trials, bodies = study.file.trials, study.known.bodies
    remark = "Predicted intervals do not include errors of the recovered axes." if study.recovers else ""
    paper = " and the paper's single run" if any(map(_beside, distributions.values())) else ""
    caption = (
        f"Errors over {max(len(d.errors) for d in distributions.values())} trials beside the predicted "
        f"interval{paper}. Drawn anew: {REDRAWN[redrawn]}.{remark and f' {remark}'}"
    )
    tables = {}
    for name, d in distributions.items():
        model = trials.get(name) or trials[name.removesuffix(TRAJECTORY)]
        tables[f"monte_carlo_{name}"] = table(name, d, bodies, study_report.sums(study, model))
        if name.endswith(TRAJECTORY):
            caption += f" Joint: {ESTIMATORS['trajectory']}; over the first {len(d.errors)} trials."
    return Document(
        tables=tables,
        figures={"figure_monte_carlo": Plot(partial(chart, distributions, bodies), caption)},
        numbers={"monte_carlo": _numbers(distributions) | {"provenance": provenance}},
        screen="\n".join([*_texts(distributions, tables), f"{MEANING}{remark}\n"]),
    )


def _texts(distributions: Mapping[str, Distribution], tables: Mapping[str, tabular.Table]) -> Iterator[str]:
    """Yields each table as text, and a sentence on its biases."""
    for model, d in distributions.items():
        yield tables[f"monte_carlo_{model}"].text()
        biased = np.flatnonzero(np.abs(d.mean) > 4 * d.std / np.sqrt(len(d.errors)))
        if len(biased):
            yield wrapped(f"Biased beyond chance: {', '.join(_bias(d, int(k)) for k in biased)}\n")


def _bias(d: Distribution, k: int) -> str:
    """Bias of a parameter in words."""
    decimals = decimals_of(d.std[k])
    sign = "+" if d.mean[k] > 0 else ""
    return f"{d.names[k]} by {sign}{number(d.mean[k], 3 if decimals is None else decimals)}"


def _numbers(distributions: Mapping[str, Distribution]) -> dict[str, Any]:
    """Key numbers for scripts."""
    numbers: dict[str, Any] = {"trials": max(len(d.errors) for d in distributions.values())}
    for model, d in distributions.items():
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


CHARTED = ("condition_number", "largest_error", "axis_error_deg", "contact_peak_force_N")
"""First parts of the names of a summary's numbers that the chart shows by default."""


def sweep_table(sweep: Swept, names: Sequence[str]) -> tabular.Table:
    """Means and standard deviations over the seeds, a row for each number and value."""
    each = [(name, *pair) for name in names for pair in zip(sweep.values, sweep.numbers(name).T, strict=True)]
    rows = [(name, str(value), *_counted(*_statistics(column))) for name, value, column in each]
    columns = ("number", sweep.option, "runs", "mean", "std")
    several = len(sweep.runs) > len(sweep.values)
    title = f"Numbers over {tabular.heading(sweep.option)}" + ", means and standard deviations of the seeds" * several
    words = {name: tabular.heading(name) for name in names}
    return tabular.Table(title, columns, rows, decimals=4, deviations={"mean": "std"}, names=words)


def sweep_chart(sweep: Swept, titles: Mapping[str, str]) -> Figure:
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
            panels[-1].set_xticks(x, [typography.label(str(value)) for value in sweep.values])
            panels[-1].margins(x=0.2)
        panels[-1].set_xlabel(_label(sweep.option))
        add_legend(figure)
    return figure


def _statistics(x: np.ndarray) -> tuple[int, float | None, float | None]:
    """Number of runs that have a number, its mean and its standard deviation; None if undefined."""
    known = x[np.isfinite(x)]
    mean = float(known.mean()) if len(known) else None
    return len(known), mean, float(known.std(ddof=1)) if len(known) > 1 else None


def _counted(runs: int, mean: float | None, std: float | None) -> tuple[tabular.Cell, ...]:
    """The same with a mean that is a count without decimals, as a rank that is the same in all runs."""
    return runs, int(mean) if mean is not None and not std and mean.is_integer() else mean, std


def _label(name: str) -> str:
    """A name as a label: `axis_error_deg` becomes `Axis error (deg)`."""
    text = tabular.heading(name)
    return text[0].upper() + text[1:]


def sweep_document(sweep: Swept, title: str, numbers: Sequence[str], provenance: dict[str, Any]) -> Document:
    """Table, chart and numbers of a sweep.

    Args:
        sweep: The sweep.
        title: Title of the study.
        numbers: Names of the numbers that the chart shows; empty for those of `CHARTED`.
        provenance: Provenance of the results.
    """
    charted = {name: _label(name) for name in numbers or sweep.names if numbers or name.startswith(CHARTED)}
    shown, seeds = ", ".join(map(tabular.heading, charted)), len(sweep.runs) > len(sweep.values)
    caption = f"{title}: {shown} over {tabular.heading(sweep.option)}" + " of each seed, and their means" * seeds + "."
    return Document(
        tables={"table_sweep": sweep_table(sweep, sweep.names)},
        figures={"figure_sweep": Plot(partial(sweep_chart, sweep, charted), caption)},
        numbers={"sweep": {"runs": sweep.runs, "provenance": provenance}},
        screen=sweep_table(sweep, list(charted)).text(),
    )
