"""Figures of an identification for print."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from experiments.document import figures, styles, symbols
from experiments.document.sheet import INKS
from experiments.reports.identify_page import shown_parameters
from ident.display.plots import amplitude_spectrum
from ident.estimate import Estimate
from ident.estimation.equations import COMPONENTS
from ident.estimation.units import channel_unit
from ident.tolerances import INTERVAL

MEASURED, ESTIMATED = INKS[:2]
"""Colours of measurements and of estimates, as on the page."""

COLUMN_PANELS = 16
"""Largest number of channels in a figure of one column; more take the width of the page."""

UNCERTAIN: dict[str, Any] = {"color": "0.8", "lw": 0, "zorder": 0, "label": "Low velocity, not judged"}
"""Style of spans in which joints are so slow that friction makes their torques indeterminate."""


def held_out_figure(result: Estimate) -> Figure:
    """Measured and predicted channels on the held-out part."""
    held = result.held_out
    time, measured, predicted = held.curves
    slow = held.interrupted(~held.moving, by=False)
    with styles.paper_style():
        figure, axes = _panels(result)
        for k, ax in enumerate(axes):
            ax.plot(time, measured[:, k], color=MEASURED, lw=1.2, label="Measured")
            ax.plot(time, predicted[:, k], color=ESTIMATED, ls="--", lw=0.8, label="Predicted")
            if slow[:, k].any():
                spans = figures.visible_spans(figures.spans(time, slow[:, k]), float(np.ptp(held.time)))
                # Lines of the grid would look like the shortest spans.
                ax.grid(visible=False, axis="x")
                bars = np.stack([spans[:, 0], np.diff(spans)[:, 0]], axis=1)
                ax.broken_barh(bars.tolist(), (0, 1), transform=ax.get_xaxis_transform(), **UNCERTAIN)
            ax.set_ylabel(_label(result, k), labelpad=2)
            figures.few_ticks(ax)
            ax.set_xlim(held.time[0], held.time[-1])
        _finish(figure, axes, "Time (s)", [Patch(**UNCERTAIN)] if slow.any() else [])
    return figure


def parameters_figure(result: Estimate) -> Figure:
    """Base parameters with 95 % intervals including the set-up, beside the model's, each over the largest of these."""
    arm, shown = result.prepared.mechanism, shown_parameters(result)
    value, std = result.psi[shown], result.std_setup[shown]
    prior = result.fit.equations.from_model[shown]
    size = np.maximum(np.maximum(np.abs(value), np.abs(prior)), INTERVAL * std)
    size = np.where(size > 0, size, 1)
    names = [symbols.named_symbol(result.base.names[k], arm.bodies) for k in shown]
    with styles.paper_style():
        figure, panels = styles.row_panels(names, "Value over the largest of estimate, model and half-width")
        for ax, rows in panels:
            ax.axvline(0, color="0.8", lw=0.6)
            half, own = INTERVAL * (std / size)[rows], (value / size)[rows]
            style: dict[str, Any] = {"fmt": "o", "ms": 2.5, "lw": 0.8, "color": ESTIMATED}
            ax.errorbar(own, rows, xerr=half, label="Estimate, 95 % with set-up", **style)
            ax.plot((prior / size)[rows], rows, "|", color=MEASURED, ms=7, label="Model")
        figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def spectra_figure(result: Estimate) -> Figure:
    """Spectra of the measured channels and of their residuals on the held-out part, up to three times the cut-off."""
    held, prepared = result.held_out, result.prepared
    highest = (
        prepared.recording.rate / 2
        if prepared.cutoff is None
        else min(3 * prepared.cutoff, prepared.recording.rate / 2)
    )
    with styles.paper_style():
        figure, axes = _panels(result)
        for k, ax in enumerate(axes):
            # Where nothing is explained the residual is what is measured, which shows on both sides.
            for x, color, width, label in (
                (held.samples.measured, MEASURED, 1.6, "Measured"),
                (held.residual, ESTIMATED, 0.6, "Residual"),
            ):
                frequency, amplitude = amplitude_spectrum(x[:, k], prepared.recording.rate)
                shown = (frequency > 0) & (frequency <= highest)
                ax.loglog(frequency[shown], np.maximum(amplitude[shown], 1e-12), color=color, lw=width, label=label)
            ax.set_ylabel(_label(result, k, "/√Hz"), labelpad=2)
            figures.few_decades(ax.xaxis)
            figures.few_decades(ax.yaxis)
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.margins(x=0)
        figures.join_minor_ticks(axes)
        _finish(figure, axes, "Frequency (Hz)")
    return figure


def _panels(result: Estimate) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each channel, from top to bottom and then from left to right."""
    count = len(result.channels)
    columns, width = (2, styles.column_width()) if count <= COLUMN_PANELS else (4, styles.text_width())
    rows = -(-count // columns)
    figure = Figure(figsize=(width, min(0.7 + 0.9 * rows, styles.text_height())))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    axes = list(grid.T.flat)
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes[:count]


def _finish(figure: Figure, axes: list[Axes], xlabel: str, extra: Sequence[Patch] = ()) -> None:
    """Labels the axes and adds the legend, with patches after the first panel's own entries."""
    places = [(ax, ax.get_subplotspec()) for ax in axes]
    lowest = {place.colspan.start: ax for ax, place in places if place is not None}
    for ax in lowest.values():
        ax.set_xlabel(xlabel, labelpad=2)
        ax.tick_params(labelbottom=True)
    figures.align_ylabels(axes)
    # Spans have one entry, whichever panels they are in.
    lines = [line for line in axes[0].lines if not str(line.get_label()).startswith("_")]
    figure.legend(handles=[*lines, *extra], loc="outside upper center", ncols=2)


def _label(result: Estimate, k: int, per: str = "") -> str:
    """Symbol or joint of a channel, and its unit, divided by `per`."""
    channel = result.channels[k]
    shown = f"${channel[0]}_{channel[1]}$ " if channel in COMPONENTS else f"{symbols.label(channel)}\n"
    return f"{shown}({channel_unit(channel, result.prepared.mechanism.tree)}{per})"
