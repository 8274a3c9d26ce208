"""The paper's figures. Functions return a matplotlib Figure and touch no files; `save` writes one."""

import io
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator
from matplotlib.transforms import ScaledTranslation

from experiments.document.styles import paper_style
from ident.recordings.runs import runs

SYMBOLS = (("F_x", "N"), ("F_y", "N"), ("F_z", "N"), (r"\tau_x", "N m"), (r"\tau_y", "N m"), (r"\tau_z", "N m"))
"""Symbol and unit of the components of a wrench."""

_WRITTEN: dict[str, dict[str, Any]] = {
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},
    "png": {"pil_kwargs": {"compress_type": zlib.Z_RLE}},
}
"""Options of writing each format: no date; a PNG compression that takes half the time for an eighth more space."""


VISIBLE = 0.012
"""Smallest visible share of a panel's width, about a point."""


@dataclass(frozen=True)
class Line:
    """Style of one wrench: a curve, or, if `style` is empty, dots at every other sample from `first` on."""

    color: str
    width: float = 0.8
    style: str = "-"
    first: int = 0

    def draw(self, ax: Axes, x: np.ndarray, y: np.ndarray, label: str) -> None:
        """Draws values over an abscissa, both (N,)."""
        if self.style:
            ax.plot(x, y, self.style, color=self.color, lw=self.width, label=label)
        else:
            own = slice(self.first % 2, None, 2)
            ax.plot(x[own], y[own], "o", color=self.color, ms=self.width, mew=0, label=label)


def wrench_panels(
    x: np.ndarray,
    wrenches: Mapping[str, tuple[np.ndarray, Line]],
    xlabel: str,
    *,
    symbol: str = "{}",
    lowest: float | None = None,
    shaded: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    r"""Six panels, forces on the left and torques on the right, with a curve for each wrench.

    Args:
        x: Abscissa (N,).
        wrenches: For each legend entry a wrench `[F; τ]` (N, 6) and its line; later ones lie on top.
        xlabel: Label of the abscissa.
        symbol: Pattern of the ordinates' symbols in TeX, `|\Delta {}|` for errors.
        lowest: Share of a panel's largest value at which its logarithmic ordinate begins; by default it is linear.
        shaded: For each legend entry the samples where the background is grey (N,).

    Returns:
        The figure, one IEEE column wide.
    """
    with paper_style():
        figure = Figure()
        axes = figure.subplots(3, 2, sharex=True)
        for component, ax in enumerate(axes.T.flat):
            for label, (wrench, line) in wrenches.items():
                line.draw(ax, x, wrench[:, component], label)
            variable, unit = SYMBOLS[component]
            ax.set_ylabel(f"${symbol.format(variable)}$ ({unit})", labelpad=2)
            _tidy(ax, x)
            if lowest is not None:
                _logarithmic(ax, [wrench[:, component] for wrench, _ in wrenches.values()], lowest)
            for label, when in (shaded or {}).items():
                for k, (start, end) in enumerate(spans(x, when)):
                    ax.axvspan(start, end, color="0.87", lw=0, zorder=0, label=f"_{label}" if k else label)
        for ax in axes[-1]:
            ax.set_xlabel(xlabel, labelpad=2)
        align_ylabels(axes.flat)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        columns = len(labels) if len(labels) < 4 else 2
        legend = figure.legend(handles, labels, loc="outside upper center", ncols=columns)
        for handle in legend.get_lines():
            handle.set_linewidth(max(handle.get_linewidth(), 0.8))
            handle.set_markersize(max(handle.get_markersize(), 2))
    return figure


def align_ylabels(axes: Iterable[Axes]) -> None:
    """Aligns the labels of ordinates in each column of panels, beside its widest ticks, which have to be final.

    `Figure.align_ylabels` gives the same result, but measures all ticks of a column again for each label, at each
    step of the layout and in each file.
    """
    columns: dict[int, list[tuple[Axes, float]]] = {}
    for ax in axes:
        assert isinstance(ax.figure, Figure)
        _canvas(ax.figure)  # The canvas caches these measurements.
        ax.yaxis.label.set_visible(False)
        box, place = ax.yaxis.get_tightbbox(), ax.get_subplotspec()
        ax.yaxis.label.set_visible(True)
        assert place is not None
        width = 0.0 if box is None else ax.bbox.x0 - box.x0
        columns.setdefault(place.colspan.start, []).append((ax, width / ax.figure.dpi))
    for column in columns.values():
        widest = max(width for _, width in column)
        for ax, _ in column:
            left = ScaledTranslation(-widest - ax.yaxis.labelpad / 72, 0, ax.figure.dpi_scale_trans)
            ax.yaxis.set_label_coords(0, 0.5, transform=ax.transAxes + left)


def spans(x: np.ndarray, when: np.ndarray) -> np.ndarray:
    """First and last abscissae of the episodes in which `when` is true (k, 2)."""
    return x[runs(when) - [0, 1]]


def visible_spans(spans: np.ndarray, shown: float) -> np.ndarray:
    """Spans in order (k, 2), widened to be visible on an abscissa of length `shown`, and merged if nearly touching."""
    least = VISIBLE * shown
    spare = np.maximum(least - np.diff(spans, axis=1), 0) / 2
    wide = spans + np.hstack([-spare, spare])
    apart = np.flatnonzero(wide[1:, 0] - wide[:-1, 1] > least) + 1
    return np.array([[run[0, 0], run[-1, 1]] for run in np.split(wide, apart)])


def _tidy(ax: Axes, x: np.ndarray) -> None:
    """Sets limits and few ticks of a panel."""
    few_ticks(ax)
    ax.set_xlim(x[0], x[-1])
    widen_flat(ax)


def few_ticks(ax: Axes) -> None:
    """Sets few ticks, whose number does not depend on the panel's size: `align_ylabels` measures them before layout."""
    ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))


def few_decades(axis: Axis) -> None:
    """Sets few ticks of a logarithmic axis, whose number does not depend on the panel's size, as `few_ticks` does."""
    axis.set_major_locator(LogLocator(numticks=5))
    axis.set_minor_locator(LogLocator(subs="auto", numticks=5))


def join_minor_ticks(axes: Iterable[Axes]) -> None:
    """Draws the minor ticks of each axis as one line of markers, which looks the same; limits and ticks have to be set.

    matplotlib measures and draws each minor tick and its empty label separately, which takes most of the time of
    logarithmic panels. Minor ticks with labels or lines of a grid stay as they are.
    """
    # Panels may share a locator, so all places are computed before any locator is replaced.
    axis_of = [(ax, axis, _bare_minor_ticks(axis)) for ax in axes for axis in (ax.xaxis, ax.yaxis)]
    for ax, axis, places in axis_of:
        if not places.size:
            continue
        tick = axis.get_minor_ticks(1)[0]
        for edge, mark in enumerate((tick.tick1line, tick.tick2line)):
            if mark.get_visible():
                ax.add_artist(_marks_like(mark, ax, axis, places, edge))
        axis.set_minor_locator(NullLocator())


def _bare_minor_ticks(axis: Axis) -> np.ndarray:
    """Visible places of an axis's minor ticks; empty if they have labels or lines of a grid."""
    low, high = sorted(axis.get_view_interval())
    places = np.asarray(axis.get_minorticklocs())
    places = places[(places >= low) & (places <= high)]
    labelled = any(axis.get_minor_formatter().format_ticks(places.tolist()))
    return places[:0] if labelled or axis.get_minor_ticks(1)[0].gridline.get_visible() else places


def _marks_like(mark: Line2D, ax: Axes, axis: Axis, places: np.ndarray, edge: float) -> Line2D:
    """Line of markers that look like a tick's, at places of an axis and at an edge of the panel, 0 or 1."""
    edges = np.full(places.size, edge)
    x, y = (places, edges) if axis is ax.xaxis else (edges, places)
    line = Line2D(x, y, transform=ax.get_xaxis_transform() if axis is ax.xaxis else ax.get_yaxis_transform())
    line.set(linestyle="none", marker=mark.get_marker(), markersize=mark.get_markersize())
    line.set(markeredgewidth=mark.get_markeredgewidth(), color=mark.get_markeredgecolor())
    line.set(zorder=axis.get_zorder(), clip_on=False, in_layout=False, label="_nolegend_")
    return line


def _logarithmic(ax: Axes, curves: Sequence[np.ndarray], lowest: float) -> None:
    """Sets a logarithmic ordinate for curves of absolute values, unless all are zero."""
    largest = max(float(np.abs(curve).max()) for curve in curves)
    if largest > 0:
        ax.set_yscale("log")
        few_decades(ax.yaxis)
        ax.yaxis.set_minor_formatter(NullFormatter())
        ax.set_ylim(lowest * largest, 1.5 * largest)
        join_minor_ticks([ax])


def save(figure: Figure, folder: Path, name: str, formats: Iterable[str]) -> None:
    """Writes `folder/name.FORMAT` for each format, byte-identical for identical figures."""
    for extension in formats:
        (folder / f"{name}.{extension}").write_bytes(drawn(figure, extension))


def drawn(figure: Figure, extension: str) -> bytes:
    """A figure's file in a format."""
    with paper_style():
        pixels = _canvas(figure)
        # The layout is solved once; solved again for each file it would depend on the previous files.
        if (layout := figure.get_layout_engine()) is not None:
            _place_empty_labels(figure)
            layout.execute(figure)
            figure.set_layout_engine("none")
        # Figure.savefig would draw each file twice, in case the layout were not solved yet. The file is drawn in
        # memory: if writing fails, matplotlib's backends raise errors that do not name the disk.
        file = io.BytesIO()
        # Vector backends leave a dpi of 72 behind.
        dpi = mpl.rcParams["savefig.dpi"]
        figure.dpi = mpl.rcParams["figure.dpi"] if dpi == "figure" else dpi
        canvas = pixels if extension == "png" else get_registered_canvas_class(extension)(figure)
        getattr(canvas, f"print_{extension}")(file, **_WRITTEN[extension])
        figure.set_canvas(pixels)
        content = file.getvalue()
        return _rounded(content) if extension == "svg" else content


def _place_empty_labels(figure: Figure) -> None:
    """Fixes the places of empty labels of axes, beside which matplotlib would measure all ticks at each drawing."""
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            if not axis.get_label_text():
                axis.set_label_coords(0, 0)


def _canvas(figure: Figure) -> FigureCanvasAgg:
    """The figure's pixel canvas, which caches text sizes from the first measurement to the last file."""
    canvas = figure.canvas
    return canvas if isinstance(canvas, FigureCanvasAgg) else FigureCanvasAgg(figure)


def _rounded(svg: bytes) -> bytes:
    """An SVG drawing with paths in hundredths of a point, which halves its size."""

    def path(match: re.Match[bytes]) -> bytes:
        return re.sub(rb"-?\d+\.\d{3,}", lambda number: b"%.2f" % float(number[0]), match[0])

    return re.sub(rb' d="[^"]*"', path, svg)


def widen_flat(ax: Axes) -> None:
    """Widens a flat ordinate, so that rounding noise does not fill its panel."""
    low, high = ax.get_ylim()
    middle = (low + high) / 2
    if high - low < max(1e-6, 1e-4 * abs(middle)):
        half = 0.05 * abs(middle) if abs(middle) > 1e-6 else 1
        ax.set_ylim(middle - half, middle + half)
