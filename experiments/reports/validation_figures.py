"""Figures of the validation: held-out residuals by candidate, published parameters, and agreement of estimates."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from experiments.data.validation import CANDIDATES, ESTIMATE, LEAST_SQUARES, MODEL, WORSE, Study, Validation
from experiments.document import typography
from experiments.document.figures import empty_figure
from ident.display.plots import Axes, Figure, add_legend, few_decades
from ident.tolerances import INTERVAL

LOOKS = {MODEL: ("0.55", "D"), LEAST_SQUARES: ("C1", "s"), ESTIMATE: ("C0", "o")}
"""Colour and marker of each candidate."""

PUBLISHED = ("black", "|")
"""Colour and marker of published numbers."""

FOOT = 0.75
"""Inches of abscissa and legend."""

TICKS = tuple(first * 10.0**power for power in range(-4, 3) for first in (1, 2, 5))
"""Ticks of ratios, as far as they are on the abscissa."""

GROUPS = {
    "halves": ("C4", -0.22, "halves"),
    "trials": ("C0", 0.0, "trials alone"),
    "identical": ("C2", 0.22, "identical parts"),
}
"""Colour, place in its row, and label of each kind of agreement."""


def row_label(name: str) -> str:
    """Name of a parameter for a row: a symbol with its joint in words, or the name of a body with its quantity."""
    kind, _, joint = name.removesuffix(")").partition("(")
    if joint:
        return f"${kind[0]}_{{{kind[1:]}}}$ of {channel_label(joint)}"
    return name.replace("_", " ") if " " in name else typography.parameter_symbol(name)


def held_out_figure(study: Study) -> Figure:
    """Held-out residuals over signal by candidate, a panel for each recording, in two columns."""
    columns = _columns(list(study))
    heights = [sum(0.13 * len(each.channels) + 0.3 for each in column) for column in columns]
    every = np.concatenate([ratios for each in study for ratios in each.ratios.values()])
    every = every[np.isfinite(every) & (every > 0)]
    lowest, highest = 0.8 * float(every.min()), 1.25 * float(every.max())
    with empty_figure(max(heights) + FOOT, wide=True) as drawing:
        for part, column in zip(drawing.subfigures(1, len(columns), squeeze=False)[0], columns, strict=True):
            rows = [len(each.channels) + 1.0 for each in column]
            axes = part.subplots(len(column), 1, height_ratios=rows, sharex=True, squeeze=False)[:, 0]
            for ax, each in zip(axes, column, strict=True):
                _ratios(ax, each)
                ax.set_xlim(lowest, highest)
                few_decades(ax, TICKS if highest < 100 * lowest else ())
            axes[-1].set_xlabel("Held-out residual over signal", labelpad=2)
        add_legend(drawing, "lower", columns=4)
    return drawing


def _columns(validations: Sequence[Validation]) -> list[list[Validation]]:
    """Recordings in two columns of about the same height."""
    columns: list[list[Validation]] = [[] for _ in validations[:2]]
    for each in sorted(validations, key=lambda each: -len(each.channels)):
        min(columns, key=lambda column: sum(len(x.channels) + 2 for x in column)).append(each)
    return columns


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
    ax.tick_params(axis="y", labelsize=6)


def channel_label(channel: str) -> str:
    """Name of a channel for a figure: a symbol for components of the wrench, words for joints."""
    if len(channel) == 2 and channel[0] in "FM":
        return rf"${channel[0]}_{channel[1]}$"
    return channel.removesuffix("_joint").replace("_", " ")


def published_figure(study: Study) -> Figure:
    """Estimates over published parameters with 95 % intervals of both, and z of each difference.

    What is beyond the abscissa is marked by arrows.
    """
    near, far = -1.0, 3.0
    pairs = [(each, published) for each in study for published in each.entry.published]
    published = np.array([[each.value, abs(each.std)] for _, each in pairs])
    values = np.array([each.values[one.name] for each, one in pairs]) / published[:, :1]
    rows, half = np.arange(len(pairs)), INTERVAL * np.abs(values[:, 1:])
    with empty_figure(FOOT + 0.17 * len(rows)) as drawing:
        ax = drawing.subplots()
        ax.axvline(1, color="0.5", lw=0.6, zorder=0)
        bars: dict[str, Any] = {"color": "black", "fmt": "|", "ms": 6, "lw": 0.7, "label": "published"}
        ax.errorbar(np.ones(len(rows)), rows + 0.2, xerr=INTERVAL * published[:, 1] / abs(published[:, 0]), **bars)
        style: dict[str, Any] = {"ms": 3, "color": "C0"}
        ax.errorbar(values[:, 0], rows, xerr=half[:, 1], fmt="none", lw=0.7, label="with the set-up", **style)
        ax.errorbar(values[:, 0], rows, xerr=half[:, 0], fmt="o", lw=1.6, label="estimate, 95 % of the noise", **style)
        for ends, limit, marker in ((values[:, 0] - half.T, near, "<"), (values[:, 0] + half.T, far, ">")):
            beyond = rows[((ends < near) | (ends > far)).any(axis=0)]
            ax.plot(np.full(len(beyond), limit), beyond, marker, color="C0", ms=3, clip_on=False, label="_beyond")
        ax.set_yticks(rows, [f"{each.entry.title}, {row_label(one.name)}" for each, one in pairs])
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_xlim(near, far)
        ax.set_xlabel("Estimate over published value", labelpad=2)
        for row, (each, one) in enumerate(pairs):
            z = f"{round(each.published_z(one), 1) + 0.0:+.1f}".replace("-", "\N{MINUS SIGN}")
            ax.text(1.04, row, f"$z$ = {z}", transform=ax.get_yaxis_transform(), va="center", fontsize=6)
        for row, (above, below) in enumerate(pairwise(pairs)):
            if above[0] is not below[0]:
                ax.axhline(row + 0.5, color="0.8", lw=0.5)
        add_legend(drawing, "lower", columns=2)
    return drawing


def summary_figure(study: Study) -> Figure:
    """Estimate's residuals over those of the best other candidate, and differences of trials, by recording."""
    shown = list(study)
    with empty_figure(FOOT + 0.25 + 0.2 * len(shown), wide=True) as drawing:
        left, right = drawing.subplots(1, 2, sharey=True)
        rng = np.random.default_rng(0)
        names = [each.entry.title for each in shown]
        _strip(left, dict(zip(names, (each.against_best for each in shown), strict=True)), rng, color="black")
        left.axvspan(1, WORSE, color="0.88", lw=0)
        left.axvline(1, color="0.4", lw=0.6, label="equal")
        left.set_xscale("log")
        few_decades(left, TICKS)
        left.set_xlabel("Residual over the best other candidate's", labelpad=2)
        left.set_title("(a) Held-out channels")
        for name, (color, shift, label) in GROUPS.items():
            rows = {f"{label}, {own}": agreement(each)[name] for own, each in zip(names, shown, strict=True)}
            _strip(right, rows, rng, color=color, shift=shift)
        right.axvspan(-INTERVAL, INTERVAL, color="0.88", lw=0)
        # Linear up to this difference, in standard deviations, and logarithmic beyond.
        linear = 4.0
        right.set_xscale("symlog", linthresh=linear)
        largest = max(abs(z).max(initial=linear) for each in shown for z in agreement(each).values())
        ticks = [x for x in (-30, -10, -4, -2, 0, 2, 4, 10, 30) if abs(x) <= largest]
        right.set_xticks(ticks, [str(x).replace("-", "\N{MINUS SIGN}") for x in ticks])
        right.minorticks_off()
        right.set_xlim(-1.05 * largest, 1.05 * largest)
        right.set_xlabel("Difference in standard deviations", labelpad=2)
        right.set_title("(b) Agreement")
        left.set_yticks(range(len(shown)), names)
        left.set_ylim(len(shown) - 0.5, -0.5)
        marks = [right.plot([], [], "o", color=c, ms=3, label=label)[0] for c, _, label in GROUPS.values()]
        drawing.legend(handles=marks, loc="outside lower center", ncols=3)
    return drawing


def agreement(validation: Validation) -> dict[str, np.ndarray]:
    """Differences in stated standard deviations: of halves, of trials identified alone, and of identical parts.

    Those of halves are not widened by a parameter's own halves, which would always agree.
    """
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
