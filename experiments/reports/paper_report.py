"""Reports beside those of the paper's studies: on the mechanism, errors over many trials, numbers over an option."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.data import paper
from experiments.data.fitting import ESTIMATORS, TRAJECTORY, Distribution
from experiments.data.paper import REDRAWN, Drawing
from experiments.data.simulated_study import SimulatedStudy
from experiments.document import figures, tabular, typography
from experiments.document.figures import empty_figure
from experiments.document.tabular import as_stated, number, of_deviations, of_numbers
from experiments.document.typography import wrapped
from experiments.document.writer import Document, Plot
from experiments.reports import study_report
from experiments.studies.simulation import Swept
from ident.display.plots import Axes, Figure, add_legend
from ident.mechanism.tree import Tree
from ident.tolerances import INTERVAL


def table_1() -> tabular.Table:
    """Table I as printed."""
    columns = ("frame", "inertia", "alpha", "d", "theta", "r")
    title, heads = "Modified DH parameters of the double pendulum, as printed", {"alpha": "α", "theta": "θ"}
    return tabular.Table(title, columns, paper.TABLE_1, heads=heads)


def table_2(tree: Tree, base: np.ndarray) -> tabular.Table:
    """Table II: home pose in the world's frame and joint twist of each body."""
    home = tree.poses(np.zeros(len(tree.moving)))
    rows = []
    for i, (body, T) in enumerate(zip(tree.bodies, home, strict=True), start=1):
        turned = "1" if np.allclose(T[:3, :3], np.eye(3)) else _cell(T[:3, :3].ravel())
        rows.append((f"{body.name}, i = {i}", turned, *map(_cell, (T[:3, 3] + base, body.twist[:3], body.twist[3:]))))
    columns = ("frame", "initial rotation", "initial position", "twist v", "twist omega")
    heads = {"initial position": "initial position (m)", "twist v": "twist v (m)", "twist omega": "twist ω"}
    return tabular.Table("Geometric model of the double pendulum", columns, rows, heads=heads)


def _cell(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:g}" for value in values) + ")"


def figure_1(drawing: Drawing) -> Figure:
    """Figure 1: the mechanism on the left, its frames on the right."""
    with empty_figure(2.8) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        for ax in (left, right):
            _draw_links(ax, drawing)
            ax.set(xlabel="To the right (m)", ylabel="Upwards (m)", aspect="equal")
            ax.set_axis_off()
        _label_mechanism(left, drawing)
        labels = {"world": (26, -8), "$g_1$, base": (-52, -8), "$g_2$, link 1": (20, 14), "$g_3$, link 2": (16, 8)}
        for T, (label, shift) in zip([np.eye(4), *drawing.poses], labels.items(), strict=True):
            _frame(right, T)
            _note(right, T[:3, 3], label, shift)
    return figure


def _flat(points: np.ndarray) -> np.ndarray:
    """Oblique projection of points (…, 3): Y to the right, Z up, X towards the reader's lower left."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    return np.stack([y - 0.45 * x, z - 0.3 * x], axis=-1)


def _draw_links(ax: Axes, drawing: Drawing) -> None:
    """Draws pedestal, links, joints and centres of mass from the front."""
    foot = drawing.base * [1, 1, 0]
    shoulder, elbow = drawing.poses[1, :3, 3], drawing.poses[2, :3, 3]
    links = {"base": (foot, shoulder, 6), "link 1": (shoulder, elbow, 4), "link 2": (elbow, drawing.end, 3)}
    for name, (a, b, width) in links.items():
        ax.plot(*_flat(np.array([a, b])).T, color="0.75", lw=width, solid_capstyle="round", label=name)
    ax.plot(*_flat(foot + np.array([[0, -0.25, 0], [0, 0.25, 0]])).T, color="0.3", lw=1, label="floor")
    for joint in (shoulder, elbow):
        ax.plot(*_flat(joint), "o", color="white", mec="black", ms=5, mew=0.8, label="joint")
    for k, (T, mass) in enumerate(zip(drawing.poses, drawing.masses, strict=True), start=1):
        ax.plot(*_flat(np.array([T[:3, 3], mass])).T, color="0.3", lw=0.6, label=f"frame to centre of mass {k}")
    ax.plot(*_flat(drawing.masses).T, "o", color="C4", ms=4, mec="black", mew=0.4, label="centre of mass")


def _label_mechanism(ax: Axes, drawing: Drawing) -> None:
    """Draws the symbols of masses, lengths and angles."""
    base, elbow = drawing.base, drawing.poses[2, :3, 3]
    _frame(ax, np.eye(4))
    _note(ax, base / 2, "$[T_x, T_y, T_z]^T$", (8, 0))
    _note(ax, (base + elbow) / 2, "$l_1$", (-14, -12))
    for i, (mass, shift) in enumerate(zip(drawing.masses, ((9, -5), (-20, 3), (-6, -10)), strict=True), start=1):
        _note(ax, mass, f"$m_{i}$", shift)
    for k, (origin, direction) in enumerate(((base, base), (elbow, elbow - base)), start=1):
        center, up = _flat(origin), _flat(direction) / np.linalg.norm(_flat(direction))
        ax.plot(*np.array([center, center + 0.36 * up]).T, color="0.4", lw=0.5, ls="--", label=f"straight on {k}")
        # A positive angle about X turns Y towards Z, counterclockwise in the figure.
        sweep = np.arctan2(up[1], up[0]) + np.linspace(0, drawing.q[k - 1], 31)
        arc = center[:, None] + 0.25 * np.array([np.cos(sweep), np.sin(sweep)])
        ax.plot(*arc, color="black", lw=0.7, label=rf"angle $\theta_{k}$")
        x, y = center + 0.34 * np.array([np.cos(sweep.mean()), np.sin(sweep.mean())])
        ax.text(x, y, rf"$\theta_{k}$", ha="center", va="center")


def _note(ax: Axes, point: np.ndarray, text: str, shift: tuple[int, int]) -> None:
    ax.annotate(text, tuple(_flat(point)), xytext=shift, textcoords="offset points", va="center")


def _frame(ax: Axes, T: np.ndarray) -> None:
    """Draws the axes of a frame: x vermilion, y green, z blue."""
    for axis, color in enumerate(("C1", "C2", "C0")):
        arrow = {"arrowstyle": "-|>", "color": color, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tuple(_flat(T[:3, 3] + 0.2 * T[:3, axis])), tuple(_flat(T[:3, 3])), arrowprops=arrow)


def mechanism_document(drawing: Drawing, difference: float, provenance: dict[str, Any]) -> Document:
    """Both tables and the figure.

    Args:
        drawing: The mechanism.
        difference: Largest difference between it and the mechanism of Table I.
        provenance: Provenance of the results.
    """
    frames = "x vermilion, y green, z blue"
    caption = f"The double pendulum (left) and its frames (right; {frames}), drawn from the scene's geometry."
    same = (
        f"Tables I and II are the same mechanism: poses and twists differ by {difference:.0e} at 100 random postures."
    )
    return Document(
        "The mechanism of the studies (Tables I and II)",
        lines=[same],
        tables={"table_1": table_1(), "table_2": table_2(drawing.tree, drawing.base)},
        figures={"figure_1": Plot(partial(figure_1, drawing), caption)},
        numbers={"provenance": provenance},
    )


MEANING = (
    "A bias of least squares comes from a wrong model or from noise on the joint states, which is in the\n"
    "regressor (errors in variables); its predicted standard deviations include the wrenches' noise only and do\n"
    "not show it. Those of the trajectory estimate include the angles' noise too.\n"
)
"""Text after the tables."""


def trials_table(
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


def trials_chart(distributions: Mapping[str, Distribution], bodies: tuple[str, ...] = ()) -> Figure:
    """Chart of all parameters, a panel for each model: interval, mean, prediction and the paper's error."""
    wide = len(distributions) > 2
    with empty_figure(3.2, wide=wide) as figure:
        panels = figure.subplots(1, len(distributions), sharey=True, squeeze=False)[0]
        for ax, (model, d) in zip(panels, distributions.items(), strict=True):
            _draw_trials(ax, d)
            ax.set_title(tabular.heading(model))
        names = next(iter(distributions.values())).names
        panels[0].set_yticks(np.arange(len(names)), [typography.named_symbol(name, bodies) for name in names])
        panels[0].invert_yaxis()
        add_legend(figure, columns=4 if wide else 2)
    return figure


def _draw_trials(ax: Axes, d: Distribution) -> None:
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


def trials_document(
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
        tables[f"monte_carlo_{name}"] = trials_table(name, d, bodies, study_report.sums(study, model))
        if name.endswith(TRAJECTORY):
            caption += f" Joint: {ESTIMATORS['trajectory']}; over the first {len(d.errors)} trials."
    return Document(
        tables=tables,
        figures={"figure_monte_carlo": Plot(partial(trials_chart, distributions, bodies), caption)},
        numbers={"monte_carlo": _numbers(distributions) | {"provenance": provenance}},
        screen="\n".join([*_texts(distributions, tables), f"{MEANING}{remark}\n"]),
    )


def _texts(distributions: Mapping[str, Distribution], tables: Mapping[str, tabular.Table]) -> Iterator[str]:
    """Yields each table as text, and a sentence on its biases."""
    for model, d in distributions.items():
        yield tables[f"monte_carlo_{model}"].text()
        beyond = np.abs(d.mean) > 4 * d.std / np.sqrt(len(d.errors))
        each = zip(d.names, d.mean.tolist(), of_numbers(d.std), beyond, strict=True)
        signed = ((name, "+" * (mean > 0), number(mean, 3 if k is None else k)) for name, mean, k, far in each if far)
        if biased := [f"{name} by {sign}{bias}" for name, sign, bias in signed]:
            yield wrapped(f"Biased beyond chance: {', '.join(biased)}\n")


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
