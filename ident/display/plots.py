"""Figures of estimates and recordings, in the style that matplotlib is set to, which is imported with the first one."""

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.noise import channel_unit
from ident.files.table import vector_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:
    # matplotlib is imported with the first figure.
    Axes = Figure = Any


class Sheet(NamedTuple):
    """The page that a figure is drawn for, lengths in inches.

    Attributes:
        column: Width of a figure in one column.
        text: Width of one across the page.
        height: Largest height.
        abreast: Panels of parameters side by side across the page.
        row: Height of a parameter.
        panel: Height of a panel of curves.
        margin: Height of legend, ticks and labels.
        notebook: True for figures that notebooks show.
    """

    column: float
    text: float
    height: float
    abreast: int
    row: float
    panel: float
    margin: float
    notebook: bool = False

    @property
    def most_rows(self) -> int:
        """Largest number of parameters in a figure."""
        return self.abreast * int((self.height - self.margin) / self.row)


NOTEBOOK = Sheet(column=8, text=8, height=14.5, abreast=1, row=0.22, panel=1.4, margin=1.2, notebook=True)
"""A notebook: at most 60 parameters, as many as one scrolls through."""

MEASURED, ESTIMATED = "black", "C1"
"""Colours of measurements and models, and of estimates."""

SLOW: dict[str, Any] = {"color": "0.8", "lw": 0, "zorder": 0, "label": "Low velocity, not judged"}
"""Style of spans in which joints are so slow that friction makes their torques indeterminate."""

JOINTS = {"position": "rad or m", "command": "rad or m", "torque": "N m or N"}
"""Quantities of joints that are drawn, and their units where a recording states none."""


def parameters_figure(
    sheet: Sheet, names: Sequence[str], values: np.ndarray, half: np.ndarray, model: np.ndarray
) -> Figure:
    """Base parameters and their intervals' half-widths beside the model's, each over the largest of these (r,).

    If they are too many for the sheet, those with the narrowest relative intervals are drawn.
    """
    largest = np.max([np.abs(values), np.abs(model), np.full(len(values), 1e-300)], axis=0)
    shown = np.sort(np.argsort(half / largest, kind="stable")[: sheet.most_rows])
    size = np.maximum(largest, half)
    figure, panels = row_panels(
        sheet, [names[k] for k in shown], "Value over the largest of estimate, model and half-width"
    )
    for ax, rows in panels:
        own = shown[rows]
        ax.axvline(0, color="0.8", lw=0.6)
        style: dict[str, Any] = {"fmt": "o", "ms": 2.5, "lw": 0.8, "color": ESTIMATED}
        ax.errorbar((values / size)[own], rows, xerr=(half / size)[own], label="Estimate, 95 % with set-up", **style)
        ax.plot((model / size)[own], rows, "|", color=MEASURED, ms=7, label="Model")
    add_legend(figure)
    return figure


def fit_figure(
    sheet: Sheet, labels: Sequence[str], curves: tuple[np.ndarray, np.ndarray, np.ndarray], slow: np.ndarray
) -> Figure:
    """Measured and predicted channels.

    Args:
        sheet: The sheet.
        labels: Labels of the C channels.
        curves: Times (N,), NaN where curves are interrupted, and measured and predicted channels (N, C).
        slow: Mask of what is not judged, which is grey (N, C).
    """
    time, measured, predicted = curves
    start, end = np.nanmin(time), np.nanmax(time)
    figure, axes = channel_panels(sheet, labels, "Time (s)")
    for k, ax in enumerate(axes):
        ax.plot(time, measured[:, k], color=MEASURED, lw=1.2, label="Measured")
        ax.plot(time, predicted[:, k], color=ESTIMATED, ls="--", lw=0.8, label="Predicted")
        if slow[:, k].any():
            shaded = visible_spans(spans(time, slow[:, k]), end - start)
            # Lines of the grid would look like the shortest spans.
            ax.grid(visible=False, axis="x")
            bars = np.stack([shaded[:, 0], np.diff(shaded)[:, 0]], axis=1)
            ax.broken_barh(bars.tolist(), (0, 1), transform=ax.get_xaxis_transform(), **SLOW)
        few_ticks(ax)
        ax.set_xlim(start, end)
    add_legend(figure)
    return figure


def spectra_figure(
    sheet: Sheet, labels: Sequence[str], rate: float, channels: Sequence[np.ndarray], highest: float = np.inf
) -> Figure:
    """Amplitude spectra of measured channels and of their residuals (N, C), up to a frequency in Hz."""
    figure, axes = channel_panels(sheet, labels, "Frequency (Hz)")
    # Where nothing is explained the residual is what is measured, which shows on both sides.
    styles = (MEASURED, 1.6, "Measured"), (ESTIMATED, 0.6, "Residual")
    for x, (color, width, label) in zip(channels, styles, strict=True):
        frequency, amplitude = amplitude_spectrum(x, rate)
        shown = (frequency > 0) & (frequency <= highest)
        for ax, y in zip(axes, amplitude.T, strict=True):
            ax.plot(frequency[shown], np.maximum(y[shown], 1e-12), color=color, lw=width, label=label)
    for ax in axes:
        ax.set(xscale="log", yscale="log")
        few_decades(ax)
        ax.margins(x=0)
    add_legend(figure)
    return figure


def amplitude_spectrum(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and amplitude spectral densities of signals (N, …), by Welch's method."""
    # Equal to scipy.signal.welch, which takes half a second to import. At 100 Hz there is a point each 0.2 Hz.
    length = min(len(x), 512)
    window = np.hanning(length + 1)[:-1]
    starts = np.arange(0, len(x) - length + 1, length - length // 2)
    pieces = np.moveaxis(x[starts[:, None] + np.arange(length)], 1, -1)
    spectra = np.fft.rfft((pieces - pieces.mean(axis=-1, keepdims=True)) * window)
    power = 2 * (np.abs(spectra) ** 2).mean(axis=0) / (rate * (window**2).sum())
    power[..., 0] /= 2
    power[..., -1] /= 2 - length % 2
    return np.fft.rfftfreq(length, 1 / rate), np.sqrt(np.moveaxis(power, -1, 0))


def recording_figure(
    time: np.ndarray, channels: Mapping[str, np.ndarray], units: Mapping[str, str], wrenches: Sequence[str]
) -> Figure:
    """Joint positions, commands and torques of a recording over time, and force and moment of each wrench."""
    panels = _panels_of(channels, units, wrenches)
    number = max(len(panels), 1)
    figure = _figure(NOTEBOOK, NOTEBOOK.text, NOTEBOOK.margin + NOTEBOOK.panel * number)
    axes = figure.subplots(number, sharex=True, squeeze=False)[:, 0]
    for (label, lines), ax in zip(panels.items(), axes, strict=False):
        for name, x in lines.items():
            ax.plot(time, x, lw=1, label=name)
        ax.set_ylabel(label)
        ax.margins(x=0)
        if len(lines) <= 10:
            ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    axes[-1].set_xlabel("Time (s)")
    return figure


def _panels_of(
    channels: Mapping[str, np.ndarray], units: Mapping[str, str], wrenches: Sequence[str]
) -> dict[str, dict[str, np.ndarray]]:
    """Lines (N,) of each panel by name, by the panel's label."""
    # Positions of three components are those of bodies.
    positions = [name for name in channels if name.endswith("_position") and channels[name].shape[1:] != (3,)]
    joints = [name.removesuffix("_position") for name in positions]
    groups = {(f"Joint {kind}", unit): {j: f"{j}_{kind}" for j in joints} for kind, unit in JOINTS.items()}
    for name in wrenches:
        groups |= {(f"Force {name}", "N"): {"F": f"{name}_force"}, (f"Moment {name}", "N m"): {"M": f"{name}_torque"}}
    panels = {}
    for (title, usual), names in groups.items():
        measured = {line: name for line, name in names.items() if name in channels}
        stated = dict.fromkeys(units.get(name, usual) for name in measured.values())
        lines = [each for line, name in measured.items() for each in vector_columns(line, channels[name]).items()]
        if lines:
            panels[f"{title}\n({', '.join(stated)})"] = dict(lines)
    return panels


def row_panels(sheet: Sheet, labels: Sequence[str], xlabel: str) -> tuple[Figure, list[tuple[Axes, np.ndarray]]]:
    """A figure with a row for each label, one column wide or, with many rows, in panels across the page.

    Returns:
        The figure, and for each panel its axes and the indices of its rows, which are their ordinates as well.
    """
    across = 1 if len(labels) <= 24 else sheet.abreast
    rows = max(1, -(-len(labels) // across))
    figure = _figure(sheet, sheet.column if across == 1 else sheet.text, sheet.margin + sheet.row * rows)
    panels = []
    for k, ax in enumerate(figure.subplots(1, across, sharex=True, squeeze=False)[0]):
        own = np.arange(len(labels))[k * rows : (k + 1) * rows]
        ax.set_yticks(own, labels[k * rows : (k + 1) * rows])
        ax.set_ylim((k + 1) * rows - 0.4, k * rows - 0.6)
        panels.append((ax, own))
    label = panels[0][0].set_xlabel if across == 1 else figure.supxlabel
    label(xlabel)
    return figure, panels


def channel_panels(sheet: Sheet, labels: Sequence[str], xlabel: str) -> tuple[Figure, list[Axes]]:
    """A figure with a panel below each label, from top to bottom and then from left to right."""
    columns, width = (2, sheet.column) if len(labels) <= 16 else (4, sheet.text)
    rows = -(-len(labels) // columns)
    figure = _figure(sheet, width, min(sheet.margin + sheet.panel * rows, sheet.height))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    axes = list(grid.T.flat)
    for ax, label in zip(axes, labels, strict=False):
        label_above(ax, label)
    for ax in axes[len(labels) :]:
        ax.remove()
    for ax in (*axes[rows - 1 : len(labels) : rows], axes[len(labels) - 1]):
        ax.set_xlabel(xlabel, labelpad=2)
        ax.tick_params(labelbottom=True)
    return figure, axes[: len(labels)]


def channel_labels(equations: Equations, per: str = "") -> list[str]:
    """Names of the channels with their units, divided by `per`."""
    return [f"{name} ({channel_unit(name, equations.mechanism.tree)}{per})" for name in equations.channels]


def label_above(ax: Axes, label: str) -> None:
    """Writes the label of an ordinate above it, where it can be read without turning the head.

    More than 34 letters would reach into the panel beside it: a longer label lacks its middle.
    """
    # A layout leaves room for the whole of a title, and for half the height of a turned label. With a stated place,
    # no ticks are measured to find one.
    title = label if len(label) <= 34 else f"{label[:17]}…{label[-17:]}"
    ax.set_title(title, loc="left", pad=3, y=1.0)
    ax.set_ylabel(label, visible=False)
    ax.yaxis.set_label_coords(0, 0)


def few_ticks(ax: Axes) -> None:
    """Sets few ticks, at round numbers."""
    ax.locator_params(axis="x", nbins=5, steps=[1, 2, 5, 10])
    ax.locator_params(axis="y", nbins=4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3)


def few_decades(ax: Axes, ticks: Sequence[float] = ()) -> None:
    """Sets few ticks of logarithmic axes, or those of `ticks` in sight, with ticks without numbers between them."""
    for axis in (ax.xaxis, ax.yaxis):
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            locator: Any = axis.get_major_locator()
            locator.set_params(numticks=5)
            if ticks:
                axis.set_ticks([tick for tick in ticks if low <= tick <= high])
            axis.set_major_formatter(lambda x, _: decade(x))
            axis.set_minor_formatter("")


def decade(x: float) -> str:
    """Number of a tick: plain, which is drawn faster, or a power of ten if it is long.

    >>> decade(0.01), decade(1e-7)
    ('0.01', '$10^{-7}$')
    """
    return f"{x:g}" if 1e-3 <= x < 1e4 else f"$10^{{{np.log10(x):.0f}}}$"


def add_legend(figure: Figure, place: str = "upper", columns: int | None = None) -> Any:
    """Adds a legend above or below a figure, with the entries of all panels, each once."""
    pairs = (pair for ax in figure.axes for pair in zip(*ax.get_legend_handles_labels(), strict=True))
    entries = {label: handle for handle, label in pairs}
    beside: Any = f"outside {place} center"
    ncols = columns or (len(entries) if len(entries) < 4 else 2)
    return figure.legend([*entries.values()], [*entries], loc=beside, ncols=ncols)


def spans(x: np.ndarray, when: np.ndarray) -> np.ndarray:
    """First and last abscissae of the episodes in which `when` is true (k, 2)."""
    edges = np.flatnonzero(np.diff(when, prepend=False, append=False))
    return x[edges.reshape(-1, 2) - [0, 1]]


def visible_spans(spans: np.ndarray, shown: float) -> np.ndarray:
    """Spans in order (k, 2), widened to be visible on an abscissa of length `shown`, and merged if nearly touching."""
    # About a point of a panel's width.
    least = 0.012 * shown
    spare = np.maximum(least - np.diff(spans, axis=1), 0) / 2
    wide = spans + np.hstack([-spare, spare])
    apart = np.flatnonzero(wide[1:, 0] - wide[:-1, 1] > least) + 1
    return np.array([[run[0, 0], run[-1, 1]] for run in np.split(wide, apart)])


_UNSHOWN: list[Figure] = []
"""Figures of the notebook's running cell that are not shown yet."""


def _figure(sheet: Sheet, width: float, height: float) -> Figure:
    """An empty figure; for a notebook one of pyplot's, so that notebooks know how to show it."""
    from matplotlib import figure as drawn

    if not sheet.notebook:
        return drawn.Figure(figsize=(width, height))
    from matplotlib import pyplot

    class CellFigure(drawn.Figure):
        """A figure that a notebook shows once at the end of its cell, whether or not it is the cell's last value."""

        def _ipython_display_(self) -> None:
            """Counts the figure as shown, and leaves the showing to others."""
            if self in _UNSHOWN:
                _UNSHOWN.remove(self)
            raise NotImplementedError

    figure = pyplot.figure(figsize=(width, height), layout="constrained", FigureClass=CellFigure)
    # Notebooks show pyplot's open figures themselves.
    pyplot.close(figure)
    shell: Any = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if hasattr(shell, "kernel"):
        _UNSHOWN.append(figure)
        shell.events.register("post_execute", _show)
    return figure


def _show() -> None:
    """Shows the figures that the cell has not shown."""
    for figure in list(_UNSHOWN):
        sys.modules["IPython"].display.display(figure)
