"""Data of a figure: whatever its artists draw, as rows of numbers that agree with the picture.

A row is a point of a line, or an interval, a bar or a span. Curves are named by the labels of artists; a label after an
underscore names the data and is in no legend. Lines and spans across a whole panel are data if they have a label.
"""

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import repeat
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator

from experiments.document import symbols
from experiments.document.symbols import plain

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
    title, x_axis, y_axis = (symbols.cell(plain(text)) for text in (ax.get_title(), *_axis_names(ax)))
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
        transform = artist.get_data_transform() if isinstance(artist, Patch) else artist.get_transform()
        within = transform.contains_branch_seperately(ax.transData)
        if not (all(within) or curve):
            continue
        mark, numbers = _marks(artist, within, getattr(container, "orientation", None))
        words = {f"{name}_category": _nearest(categories[name], numbers.get(name)) for name in "xy"}
        cells = {name: _cells(column) for name, column in numbers.items()}
        yield dict.fromkeys(COLUMNS, "") | shared | {"curve": symbols.cell(curve), "mark": mark} | words | cells


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


def _categories(axis: Axis) -> dict[float, str]:
    """Words at the ticks of an axis by their place; empty if they are numbers."""
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
    return [symbols.cell(words[k]) if within else "" for k, within in zip(nearest, near, strict=True)]


def _cells(column: np.ndarray) -> list[float | None]:
    """Numbers of a column, None in place of NaN."""
    cells = column.tolist()
    return [None if np.isnan(x) else x for x in cells] if np.isnan(column).any() else cells


def _marks(artist: Artist, within: Sequence[bool], orientation: str | None) -> tuple[str, Numbers]:
    """Kind of an artist (`line`, `points`, `interval`, `bar` or `span`), and its numbers in coordinates of the data.

    Args:
        artist: The artist.
        within: For abscissa and ordinate True if the artist has them in coordinates of the data.
        orientation: Direction of the bar, None for all other artists.

    Raises:
        TypeError: The artist is of another class than those that figures have had so far.
    """
    if isinstance(artist, Line2D):
        points = np.column_stack([artist.get_xdata(orig=False), artist.get_ydata(orig=False)]).astype(float)
        points = points if all(within) else points[:1]
        mark = "points" if artist.get_linestyle() == "None" else "line"
        return mark, {name: points[:, k] for k, name in enumerate("xy") if within[k]}
    if isinstance(artist, LineCollection):
        return "interval", _extents(map(_vertices, artist.get_paths()), within, None)
    paths: Sequence[Path] = ()
    if isinstance(artist, PolyCollection):
        paths = artist.get_paths()
    if isinstance(artist, Patch):
        paths = [artist.get_path().transformed(artist.get_patch_transform())]
    outlines = [_vertices(path) for path in paths]
    if isinstance(artist, PolyCollection | Patch) and all(map(_is_box, outlines)):
        return "bar" if all(within) else "span", _extents(outlines, within, orientation)
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


def _vertices(path: Path) -> np.ndarray:
    """Corners of an outline (n, 2)."""
    return np.asarray(path.vertices, dtype=float)


def _is_box(outline: np.ndarray) -> bool:
    """True for the corners of an upright rectangle, the first of which may be repeated at the end."""
    return len(outline) <= 5 and all(len(np.unique(outline[:, k])) <= 2 for k in (0, 1))
