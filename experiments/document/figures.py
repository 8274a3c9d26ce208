"""Style, files and data of figures, and figures of wrenches as in the paper; only functions import matplotlib.

The data of a figure are whatever its artists draw, as rows of numbers that agree with the picture. A row is a point of
a line, or an interval, a bar or a span. Curves are named by the labels of artists; a label after an underscore names
the data and is in no legend. Lines and spans across a whole panel are data if they have a label.
"""

import csv
import io
import re
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from experiments.document import typography
from experiments.document.typography import plain
from ident.display.plots import Axes, Figure, Sheet, add_legend, few_decades, few_ticks, label_above, spans

INKS = ("black", "C1", "C0", "C2", "C3", "C4", "C5")
"""Colours of curves, in the order of pages: black, red and blue as in the paper, then the remaining ones."""

SHEET = Sheet(3.486, 7.139, 8.6, 3, row=0.16, panel=0.9, margin=0.8)
"""Sizes of figures for print on pages of two columns (IEEEtran's, 252 and 516 pt, at 72.27 pt per inch), with room
for a caption."""

SYMBOLS = (("F_x", "N"), ("F_y", "N"), ("F_z", "N"), (r"\tau_x", "N m"), (r"\tau_y", "N m"), (r"\tau_z", "N m"))
"""Symbol and unit of the components of a wrench."""

_WRITTEN: dict[str, dict[str, Any]] = {
    "pdf": {"metadata": {"CreationDate": None}},
    "svg": {"metadata": {"Date": None}},
    "png": {"pil_kwargs": {"compress_type": zlib.Z_RLE}},
}
"""Options of writing each format: no date; a PNG compression that takes half the time for an eighth more space."""


@contextmanager
def paper_style() -> Iterator[None]:
    """Applies the style of the paper's figures, in the column width of the page, for the duration of a block."""
    import matplotlib as mpl

    with mpl.rc_context(_papers()), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # of names, drawn as boxes
        mpl.rcParams["figure.figsize"] = [SHEET.column, mpl.rcParams["figure.figsize"][1]]
        yield


@contextmanager
def empty_figure(height: float, *, wide: bool = False) -> Iterator[Figure]:
    """Yields a figure in this style, as wide as a column or as the page's text, with a height in inches."""
    with paper_style():
        from matplotlib.figure import Figure

        yield Figure(figsize=(SHEET.text if wide else SHEET.column, height))


@cache
def _papers() -> dict[Any, Any]:
    """All settings, the paper's before matplotlib's own; `rc_context` of a file would read all other styles first."""
    import matplotlib as mpl

    with as_file(files("experiments.document") / "paper.mplstyle") as path:
        settings = mpl.rc_params_from_file(path, use_default_template=True)
    # Reading the backend chooses one, and imports all of pyplot.
    return {name: settings[name] for name in settings if name != "backend"}


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
    with empty_figure(3.6) as figure:
        axes = figure.subplots(3, 2, sharex=True)
        for component, ax in enumerate(axes.T.flat):
            for label, (wrench, line) in wrenches.items():
                line.draw(ax, x, wrench[:, component], label)
            variable, unit = SYMBOLS[component]
            label_above(ax, f"${symbol.format(variable)}$ ({unit})")
            few_ticks(ax)
            ax.set_xlim(x[0], x[-1])
            widen_flat(ax)
            largest = max(float(np.abs(wrench[:, component]).max()) for wrench, _ in wrenches.values())
            if lowest is not None and largest > 0:
                ax.set_yscale("log")
                few_decades(ax)
                ax.set_ylim(lowest * largest, 1.5 * largest)
            for label, when in (shaded or {}).items():
                for k, (start, end) in enumerate(spans(x, when)):
                    ax.axvspan(start, end, color="0.87", lw=0, zorder=0, label=f"_{label}" if k else label)
        for ax in axes[-1]:
            ax.set_xlabel(xlabel, labelpad=2)
        legend = add_legend(figure)
        for handle in legend.get_lines():
            handle.set_linewidth(max(handle.get_linewidth(), 0.8))
            handle.set_markersize(max(handle.get_markersize(), 2))
    return figure


def save(figure: Figure, folder: Path, name: str, formats: Iterable[str]) -> None:
    """Writes `folder/name.FORMAT` for each format, byte-identical for identical figures."""
    for extension in formats:
        (folder / f"{name}.{extension}").write_bytes(drawn(figure, extension))


def drawn(figure: Figure, extension: str) -> bytes:
    """A figure's file in a format."""
    import matplotlib as mpl
    from matplotlib.backend_bases import get_registered_canvas_class
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with paper_style():
        # The canvas of pixels caches text sizes from the first measurement to the last file.
        pixels: Any = figure.canvas if isinstance(figure.canvas, FigureCanvasAgg) else FigureCanvasAgg(figure)
        # The layout is solved once; solved again for each file it would depend on the previous files.
        if (layout := figure.get_layout_engine()) is not None:
            _solve(layout, figure)
        # Figure.savefig would draw each file twice, in case the layout were not solved yet. The file is drawn in
        # memory: if writing fails, matplotlib's backends raise errors that do not name the disk.
        file = io.BytesIO()
        # Vector backends leave a dpi of 72 behind.
        figure.dpi = mpl.rcParams["savefig.dpi"]
        canvas = pixels if extension == "png" else get_registered_canvas_class(extension)(figure)
        getattr(canvas, f"print_{extension}")(file, **_WRITTEN[extension])
        figure.set_canvas(pixels)
        return _rounded(file.getvalue()) if extension == "svg" else file.getvalue()


def _solve(layout: Any, figure: Figure) -> None:
    """Solves a layout, and draws minor ticks of an axis as one line of markers: ticks take ten times as long."""
    from matplotlib import rcParams
    from matplotlib.markers import TICKDOWN, TICKLEFT
    from matplotlib.ticker import LogLocator

    axes: list[Any] = [axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
    between = [(axis, each) for axis in axes if isinstance(each := axis.get_minor_locator(), LogLocator)]
    for axis in axes:
        # Beside empty labels matplotlib would measure all ticks at each drawing.
        if not axis.get_label_text():
            axis.set_label_coords(0, 0)
    for axis, _ in between:
        axis.set_ticks([], minor=True)
    layout.execute(figure)
    figure.set_layout_engine("none")
    style = {"ms": rcParams["xtick.minor.size"], "mew": rcParams["xtick.minor.width"], "clip_on": False}
    for axis, locator in between:
        ax, (low, high) = axis.axes, sorted(axis.get_view_interval())
        along = np.array([place for place in locator() if low <= place <= high])
        places, marker, coordinates = (along, 0 * along), TICKDOWN, ax.get_xaxis_transform()
        if axis is ax.yaxis:
            places, marker, coordinates = places[::-1], TICKLEFT, ax.get_yaxis_transform()
        ax.plot(*places, "k", ls="", marker=marker, transform=coordinates, scalex=False, scaley=False, **style)


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


NUMBERS = ("x", "y", "x_low", "x_high", "y_low", "y_high")
"""Columns of numbers: coordinates of points, and ends of intervals, bars and spans."""

COLUMNS = ("panel", "title", "x_axis", "y_axis", "curve", "mark", "x_category", "y_category", *NUMBERS)
"""All columns; those without `KEPT` are left out if they are empty."""

KEPT = frozenset({"panel", "x_axis", "y_axis", "curve", "mark", "x", "y"})
"""Columns that every figure's data have."""

_UNNAMED = re.compile(r"_child\d+|_nolegend_?|_container\d+|")
"""Labels that matplotlib gives artists without one."""


Numbers = dict[str, np.ndarray]
"""Some columns of `NUMBERS`, each (N,); coordinates relative to a panel's height or width are left out."""


def csv_text(figure: Figure) -> str:
    """Data of a figure as comma-separated values with full precision, in the order in which artists were drawn.

    Raises:
        TypeError: An artist is of a class that this module cannot read.
    """
    blocks = [block for panel, ax in enumerate(figure.axes, start=1) for block in _blocks(panel, ax)]
    kept = [name for name in COLUMNS if name in KEPT or any(block[name] for block in blocks)]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(kept)
    for block in blocks:
        number = max(len(column) for column in block.values() if isinstance(column, list))
        columns = (block[name] if isinstance(block[name], list) else repeat(block[name], number) for name in kept)
        writer.writerows(zip(*columns, strict=False))
    return out.getvalue()


def _blocks(panel: int, ax: Axes) -> Iterator[dict[str, Any]]:
    """Yields columns by name for each artist of a panel: lists of cells, or a cell that all rows share."""
    title, x_axis, y_axis = (typography.cell(plain(text)) for text in (ax.get_title(), *_axis_names(ax)))
    shared = {"panel": panel, "title": title, "x_axis": x_axis, "y_axis": y_axis}
    categories = {"x": _categories(ax.xaxis), "y": _categories(ax.yaxis)}
    containers: dict[int, Any] = {}
    for each in ax.containers:
        for part in each:
            # Points and lines of error bars are tuples of artists, or None.
            containers |= dict.fromkeys(map(id, part if isinstance(part, tuple) else [part]), each)
    for artist in (*ax.lines, *ax.collections, *ax.patches, *ax.images):
        container = containers.get(id(artist))
        curve = _curve(artist if container is None else container)
        # A patch's own shape has a transform besides.
        transform = getattr(artist, "get_data_transform", artist.get_transform)()
        within = transform.contains_branch_seperately(ax.transData)
        if not (all(within) or curve):
            continue
        mark, numbers = _marks(artist, within, getattr(container, "orientation", None))
        words = {f"{name}_category": _nearest(categories[name], numbers.get(name)) for name in "xy"}
        cells = {name: _cells(column) for name, column in numbers.items()}
        yield dict.fromkeys(COLUMNS, "") | shared | {"curve": typography.cell(curve), "mark": mark} | words | cells


def _curve(labelled: Any) -> str:
    """Name of the data of an artist or container, empty without a label."""
    label = str(labelled.get_label() or "")
    return "" if _UNNAMED.fullmatch(label) else plain(label.removeprefix("_"))


def _axis_names(ax: Axes) -> Iterator[str]:
    """Yields the labels of abscissa and ordinate of a panel, of one that shares it, or of the figure."""
    figure: Any = ax.figure
    sharing = {"x": ax.get_shared_x_axes(), "y": ax.get_shared_y_axes()}
    for name, of_figure in (("x", figure.get_supxlabel()), ("y", figure.get_supylabel())):
        labels = [getattr(each, f"get_{name}label")() for each in (ax, *sharing[name].get_siblings(ax))]
        yield next(filter(None, [*labels, of_figure]), "")


def _categories(axis: Any) -> dict[float, str]:
    """Words at the ticks of an axis by their place; empty if they are numbers."""
    from matplotlib.ticker import FixedLocator

    if not isinstance(axis.get_major_locator(), FixedLocator):
        return {}
    places = [float(place) for place in axis.get_majorticklocs()]
    texts = [plain(text) for text in axis.get_major_formatter().format_ticks(places)]
    return {} if all(map(_is_number, places, texts)) else dict(zip(places, texts, strict=True))


def _is_number(place: float, text: str) -> bool:
    """True if a tick's text is the number at its place, or empty."""
    with suppress(ValueError):
        return not text or float(text.replace(",", "").replace("\N{MINUS SIGN}", "-")) == place
    return False


def _nearest(categories: Mapping[float, str], column: np.ndarray | None) -> list[str] | str:
    """Words of the tick nearest to each coordinate, empty for those without; empty if there are no categories."""
    if column is None or not categories:
        return ""
    places, words = np.array([*categories]), [*categories.values()]
    distances = np.nan_to_num(np.abs(column[:, None] - places), nan=np.inf)
    nearest = distances.argmin(axis=1)
    near = distances.min(axis=1) <= 0.5
    return [typography.cell(words[k]) if within else "" for k, within in zip(nearest, near, strict=True)]


def _cells(column: np.ndarray) -> list[float | None]:
    """Numbers of a column, None in place of NaN."""
    cells = column.tolist()
    return [None if np.isnan(x) else x for x in cells] if np.isnan(column).any() else cells


def _marks(artist: Any, within: Sequence[bool], orientation: str | None) -> tuple[str, Numbers]:
    """Kind of an artist (`line`, `points`, `interval`, `bar` or `span`), and its numbers in coordinates of the data.

    Args:
        artist: The artist.
        within: For abscissa and ordinate True if the artist has them in coordinates of the data.
        orientation: Direction of the bar, None for all other artists.

    Raises:
        TypeError: The artist is of another class than those that figures have had so far.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if isinstance(artist, Line2D):
        points = np.column_stack([artist.get_xdata(orig=False), artist.get_ydata(orig=False)]).astype(float)
        points = points if all(within) else points[:1]
        mark = "points" if artist.get_linestyle() == "None" else "line"
        return mark, {name: points[:, k] for k, name in enumerate("xy") if within[k]}
    if isinstance(artist, LineCollection | PolyCollection | Patch):
        if isinstance(artist, Patch):
            paths: Sequence[Any] = [artist.get_path().transformed(artist.get_patch_transform())]
        else:
            paths = artist.get_paths()
        corners = [np.asarray(path.vertices, float) for path in paths]
        if isinstance(artist, LineCollection):
            return "interval", _extents(corners, within, None)
        if all(map(_is_box, corners)):
            return "bar" if all(within) else "span", _extents(corners, within, orientation)
    raise TypeError(f"The data of a figure are of lines, intervals, bars and spans, not of {type(artist).__name__}.")


def _extents(outlines: Iterable[np.ndarray], within: Sequence[bool], orientation: str | None) -> Numbers:
    """Lower and upper ends of intervals, bars or spans with these corners (n, 2) each; across bars their middle."""
    numbers: Numbers = {}
    ends = np.array([[each.min(axis=0), each.max(axis=0)] for each in outlines]).reshape(-1, 2, 2)
    across = {"vertical": 0, "horizontal": 1}.get(orientation or "")
    for k, name in enumerate("xy"):
        low, high = ends[:, 0, k], ends[:, 1, k]
        if within[k] and (k == across or (low == high).all()):
            numbers[name] = (low + high) / 2
        elif within[k]:
            numbers |= {f"{name}_low": low, f"{name}_high": high}
    return numbers


def _is_box(outline: np.ndarray) -> bool:
    """True for the corners of an upright rectangle, the first of which may be repeated at the end."""
    return len(outline) <= 5 and all(len(np.unique(outline[:, k])) <= 2 for k in (0, 1))
