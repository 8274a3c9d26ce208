"""Figures of the validation: held-out residuals by candidate, published parameters, and agreement of estimates."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from experiments.data.validation import CANDIDATES, ESTIMATE, LEAST_SQUARES, MODEL, WORSE, Published, Study, Validation
from experiments.document import styles, symbols
from ident.tolerances import INTERVAL

LOOKS = {MODEL: ("0.55", "D"), LEAST_SQUARES: ("C1", "s"), ESTIMATE: ("C0", "o")}
"""Colour and marker of each candidate."""

PUBLISHED = ("black", "|")
"""Colour and marker of published numbers."""

ROW, HEAD, FOOT = 0.13, 0.30, 0.75
"""Inches of a row, of a panel's title, and of abscissa and legend."""

NEAR, FAR = -1.0, 3.0
"""Limits of the abscissa of the estimate over the published value; what is beyond is marked by arrows."""

ACROSS, LINE = 3, 0.085
"""Panels beside each other in the figure of known parameters, and inches of its rows."""

WIDEST = 1.0
"""Largest relative error that is drawn."""

TICKS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Ticks of ratios."""

LINEAR = 4.0
"""Difference in standard deviations up to which the abscissa is linear; it is logarithmic beyond."""

GROUPS = {
    "halves": ("C4", -0.22, "halves"),
    "trials": ("C0", 0.0, "trials alone"),
    "identical": ("C2", 0.22, "identical parts"),
}
"""Colour, place in its row, and label of each kind of agreement."""


def truth_figure(study: Study) -> Figure:
    """True values between the ends of their 95 % intervals, as relative errors, a panel for each system.

    Parameters are those whose intervals exclude zero, the narrowest interval on top.
    """
    shown = [each for each in study.truths.values() if each.significant.any()]
    columns = min(len(shown), ACROSS)
    rows = -(-len(shown) // columns)
    most = [max(int(each.significant.sum()) for each in shown[k * columns :][:columns]) for k in range(rows)]
    with styles.paper_style():
        drawing = Figure(figsize=(styles.text_width(), sum(LINE * count + HEAD for count in most) + FOOT))
        axes = drawing.subplots(rows, columns, squeeze=False, height_ratios=most).ravel()
        for ax, each in zip(axes, shown, strict=False):
            mask, holds = each.significant, abs(each.z) <= INTERVAL
            half = INTERVAL * np.hypot(each.std, each.tolerance)[mask] / abs(each.true[mask])
            order, error = np.argsort(half), each.errors(each.values)
            for row, k in enumerate(order):
                color = "C0" if holds[mask][k] else "C3"
                ends = 100 * np.clip([error[k] - half[k], error[k] + half[k]], -WIDEST, WIDEST)
                ax.hlines(row, *ends, color=color, lw=2.2, alpha=0.35)
                ax.plot(100 * error[k], row, "o", color=color, ms=2.6, mew=0)
            ax.axvline(0, color="black", lw=0.8, zorder=0)
            ax.set_xlim(-100 * WIDEST, 100 * WIDEST)
            ax.set_ylim(len(order) - 0.5, -0.5)
            names = np.array(each.names)[mask][order]
            ax.set_yticks(range(len(order)), [row_label(name) for name in names], fontsize=5)
            ax.set_title(f"{each.title}:\n{holds.sum()} of {len(holds)} intervals hold", fontsize=7)
            ax.set_xlabel("Estimate less true value, %", labelpad=2, fontsize=7)
            ax.tick_params(length=2, labelsize=5)
        for ax in axes[len(shown) :]:
            ax.remove()
        marks: list[Line2D] = [
            Line2D([], [], color="black", lw=0.8, label="true value"),
            Line2D([], [], color="C0", marker="o", ms=3, lw=2.2, label="estimate and its 95 % interval"),
            Line2D([], [], color="C3", marker="o", ms=3, lw=2.2, label="interval that misses the true value"),
        ]
        drawing.legend(handles=marks, loc="outside lower center", ncols=3, fontsize=7)
    return drawing


def row_label(name: str) -> str:
    """Name of a parameter for a row: a symbol with its joint in words, or the name of a body with its quantity."""
    kind, _, joint = name.removesuffix(")").partition("(")
    if joint:
        return f"${kind[0]}_{{{kind[1:]}}}$ of {channel_label(joint)}"
    return name.replace("_", " ") if " " in name else symbols.parameter_symbol(name)


def held_out_figure(study: Study) -> Figure:
    """Held-out residuals over signal by candidate, a panel for each recording, in two columns."""
    columns = _columns(list(study))
    heights = [sum(ROW * len(each.channels) + HEAD for each in column) for column in columns]
    with styles.paper_style():
        drawing = Figure(figsize=(styles.text_width(), max(heights) + FOOT))
        for part, column in zip(drawing.subfigures(1, len(columns), squeeze=False)[0], columns, strict=True):
            rows = [len(each.channels) + 1.0 for each in column]
            lowest, highest = _range(study)
            axes = part.subplots(len(column), 1, height_ratios=rows, sharex=True, squeeze=False)[:, 0]
            for ax, each in zip(axes, column, strict=True):
                _ratios(ax, each)
                ax.set_xlim(lowest, highest)
            axes[-1].set_xlabel("Held-out residual over signal", labelpad=2)
        drawing.legend(handles=_handles(study), loc="outside lower center", ncols=4, fontsize=7)
    return drawing


def _columns(validations: Sequence[Validation]) -> list[list[Validation]]:
    """Recordings in two columns of about the same height."""
    if len(validations) < 2:
        return [list(validations)]
    columns: list[list[Validation]] = [[], []]
    for each in sorted(validations, key=lambda each: -len(each.channels)):
        min(columns, key=lambda column: sum(len(x.channels) + 2 for x in column)).append(each)
    return columns


def _range(study: Study) -> tuple[float, float]:
    """Limits of the abscissa of ratios."""
    every = np.concatenate([np.concatenate(list(each.ratios.values())) for each in study])
    every = every[np.isfinite(every) & (every > 0)]
    return 0.8 * float(every.min()), 1.25 * float(every.max())


def _ratios(ax: Axes, validation: Validation) -> None:
    """Draws the ratios of a recording's channels."""
    rows = np.arange(len(validation.channels))
    ax.axvline(1, color="0.6", lw=0.6, zorder=0)
    for name, (color, marker) in LOOKS.items():
        if name in validation.ratios:
            ax.plot(validation.ratios[name], rows, marker, color=color, ms=3, mew=0, label=CANDIDATES[name])
    for channel, ratio in validation.entry.held_out.items():
        if channel in validation.channels:
            color, marker = PUBLISHED
            ax.plot(ratio, validation.channels.index(channel), marker, color=color, ms=6, label="published")
    ax.set_xscale("log")
    ax.set_yticks(rows, [channel_label(channel) for channel in validation.channels])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_title(validation.entry.title, fontsize=8, pad=2)
    ax.set_xticks(TICKS, [f"{x:g}" for x in TICKS])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.tick_params(axis="y", labelsize=6)


def channel_label(channel: str) -> str:
    """Name of a channel for a figure: a symbol for components of the wrench, words for joints."""
    if len(channel) == 2 and channel[0] in "FM":
        return rf"${channel[0]}_{channel[1]}$"
    return channel.removesuffix("_joint").replace("_", " ")


def _handles(study: Study) -> list[Line2D]:
    """Legend of the candidates."""
    shown: dict[str, tuple[str, str]] = {CANDIDATES[name]: look for name, look in LOOKS.items()}
    if any(each.entry.held_out for each in study):
        shown["published"] = PUBLISHED
    return [Line2D([], [], color=c, marker=m, lw=0, ms=3, label=name) for name, (c, m) in shown.items()]


def published_figure(study: Study) -> Figure:
    """Estimates over published parameters with 95 % intervals of both, and z of each difference."""
    rows = [(each, published) for each in study for published in each.entry.published]
    with styles.paper_style():
        drawing = Figure(figsize=(styles.column_width(), FOOT + 0.17 * len(rows)))
        ax = drawing.subplots()
        ax.axvline(1, color="0.5", lw=0.6, zorder=0)
        for row, (validation, published) in enumerate(rows):
            _compared(ax, row, validation, published)
        ax.set_yticks(range(len(rows)), [_parameter(*each) for each in rows])
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_xlim(NEAR, FAR)
        ax.set_xlabel("Estimate over published value", labelpad=2)
        for row, (above, below) in enumerate(pairwise(rows)):
            if above[0] is not below[0]:
                ax.axhline(row + 0.5, color="0.8", lw=0.5)
        marks: list[Line2D] = [
            Line2D([], [], color="C0", marker="o", ms=3, lw=1.6, label="estimate, 95 % of the noise"),
            Line2D([], [], color="C0", lw=0.7, label="with the set-up"),
            Line2D([], [], color="black", marker="|", ms=6, lw=0.7, label="published"),
        ]
        drawing.legend(handles=marks, loc="outside lower center", ncols=2, fontsize=7)
    return drawing


def _compared(ax: Axes, row: int, validation: Validation, published: Published) -> None:
    """Draws an estimate over a published value, its intervals, and z."""
    value, std, std_setup = (x / published.value for x in validation.values[published.name])
    if np.isfinite(published.std):
        half = INTERVAL * published.std / abs(published.value)
        ax.hlines(row + 0.2, 1 - half, 1 + half, color="black", lw=0.7)
    ax.plot(1, row, marker="|", color="black", ms=6)
    for deviation, width in ((std_setup, 0.7), (std, 1.6)):
        low, high = value - INTERVAL * abs(deviation), value + INTERVAL * abs(deviation)
        ax.hlines(row, max(low, NEAR), min(high, FAR), color="C0", lw=width)
        for end, limit, marker in ((low, NEAR, "<"), (high, FAR, ">")):
            if not NEAR <= end <= FAR:
                ax.plot(limit, row, marker, color="C0", ms=3, clip_on=False)
    if NEAR <= value <= FAR:
        ax.plot(value, row, "o", color="C0", ms=3)
    z = f"{round(validation.published_z(published), 1) + 0.0:+.1f}".replace("-", "\N{MINUS SIGN}")
    ax.text(1.04, row, f"$z$ = {z}", transform=ax.get_yaxis_transform(), va="center", fontsize=6)


def _parameter(validation: Validation, published: Published) -> str:
    """Name of a published parameter and of its recording."""
    return f"{validation.entry.title}, {row_label(published.name)}"


def summary_figure(study: Study) -> Figure:
    """Estimate's residuals over those of the best other candidate, and differences of trials, by recording."""
    shown = list(study)
    with styles.paper_style():
        drawing = Figure(figsize=(styles.text_width(), FOOT + 0.25 + 0.2 * len(shown)))
        left, right = drawing.subplots(1, 2, sharey=True)
        rng = np.random.default_rng(0)
        names = [each.entry.title for each in shown]
        _strip(left, dict(zip(names, (each.against_best for each in shown), strict=True)), rng, color="black")
        left.axvspan(1, WORSE, color="0.88", lw=0)
        left.axvline(1, color="0.4", lw=0.6, label="equal")
        left.set_xscale("log")
        left.set_xticks([0.5, 1, 2], ["0.5", "1", "2"])
        left.xaxis.set_minor_locator(NullLocator())
        left.set_xlabel("Residual over the best other candidate's", labelpad=2)
        left.set_title("(a) Held-out channels")
        for name, (color, shift, label) in GROUPS.items():
            rows = {f"{label}, {own}": agreement(each)[name] for own, each in zip(names, shown, strict=True)}
            _strip(right, rows, rng, color=color, shift=shift)
        right.axvspan(-INTERVAL, INTERVAL, color="0.88", lw=0)
        right.set_xscale("symlog", linthresh=LINEAR)
        largest = max(abs(z).max(initial=LINEAR) for each in shown for z in agreement(each).values())
        ticks = [x for x in (-30, -10, -4, -2, 0, 2, 4, 10, 30) if abs(x) <= largest]
        right.set_xticks(ticks, [str(x).replace("-", "\N{MINUS SIGN}") for x in ticks])
        right.xaxis.set_minor_locator(NullLocator())
        right.set_xlim(-1.05 * largest, 1.05 * largest)
        right.set_xlabel("Difference in standard deviations", labelpad=2)
        right.set_title("(b) Agreement")
        left.set_yticks(range(len(shown)), names)
        left.set_ylim(len(shown) - 0.5, -0.5)
        marks = [Line2D([], [], color=c, marker="o", lw=0, ms=3, label=label) for c, _, label in GROUPS.values()]
        drawing.legend(handles=marks, loc="outside lower center", ncols=3, fontsize=7)
    return drawing


def agreement(validation: Validation) -> dict[str, np.ndarray]:
    """Differences in stated standard deviations: of halves, of trials identified alone, and of identical parts."""
    return {
        "halves": validation.halves / validation.widening,
        "trials": validation.trial_z,
        "identical": validation.alike_z,
    }


def _strip(
    ax: Axes, rows: Mapping[str, np.ndarray], rng: np.random.Generator, *, shift: float = 0.0, color: str = "C0"
) -> None:
    """Draws the numbers of each row, by its name, as dots that are spread a little."""
    for row, (name, numbers) in enumerate(rows.items()):
        at = row + shift + rng.uniform(-0.07, 0.07, len(numbers))
        ax.plot(numbers, at, "o", color=color, ms=2.2, alpha=0.6, mew=0, label=name)
