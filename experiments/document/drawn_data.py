"""Data of a figure: whatever its artists draw, as rows of numbers that agree with the picture.

A row is a point of a line, or an interval, a bar or a span. Curves are named by the labels of artists; a label after an
underscore names the data and is in no legend. Lines and spans across a whole panel are data if they have a label.
"""

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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
from matplotlib.transforms import Transform

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


@dataclass(frozen=True, eq=False)
class Marks:
    """Numbers that an artist draws.

    Attributes:
        mark: `line`, `points`, `interval`, `bar` or `span`.
        numbers: Some columns of `NUMBERS`, each (N,); coordinates relative to a panel's height or width are left out.
    """

    mark: str
    numbers: Mapping[str, np.ndarray]


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
        columns = [block[name] for name in kept]
        number = max(len(column) for column in columns if isinstance(column, list))
        writer.writerows(
            zip(*(column if isinstance(column, list) else repeat(column, number) for column in columns), strict=False)
        )
    return out.getvalue()


def _blocks(panel: int, ax: Axes) -> Iterator[dict[str, Any]]:
    """Yields columns by name for each artist of a panel: lists of cells, or a cell that all rows share."""
    title, *names = (symbols.cell(plain(text)) for text in (ax.get_title(), _axis_name(ax, 0), _axis_name(ax, 1)))
    shared = {"panel": panel, "title": title, "x_axis": names[0], "y_axis": names[1]}
    categories = {"x": _categories(ax.xaxis), "y": _categories(ax.yaxis)}
    containers = {id(part): each for each in ax.containers for part in _parts(each)}
    for artist in (*ax.lines, *ax.collections, *ax.patches, *ax.images):
        container = containers.get(id(artist))
        curve = _curve(artist if container is None else container)
        within = _transform(artist).contains_branch_seperately(ax.transData)
        if not (all(within) or curve):
            continue
        marks = _marks(artist, within, getattr(container, "orientation", None))
        words = {f"{name}_category": _nearest(categories[name], marks.numbers.get(name)) for name in "xy"}
        numbers = {name: _cells(column) for name, column in marks.numbers.items()}
        empty = dict.fromkeys(COLUMNS, "")
        yield empty | shared | {"curve": symbols.cell(curve), "mark": marks.mark} | words | numbers


def _parts(container: Any) -> Iterator[Artist]:
    """Yields the artists of a container, such as points and lines of error bars."""
    for part in container:
        yield from part if isinstance(part, tuple) else [part] if part is not None else []


def _transform(artist: Artist) -> Transform:
    """Transform of an artist's coordinates, for a patch without that of its own shape."""
    return artist.get_data_transform() if isinstance(artist, Patch) else artist.get_transform()


def _curve(labelled: Any) -> str:
    """Name of the data of an artist or container, empty without a label."""
    label = str(labelled.get_label() or "")
    return "" if _UNNAMED.fullmatch(label) else plain(label.removeprefix("_"))


def _axis_name(ax: Axes, which: int) -> str:
    """Label of the abscissa (0) or ordinate (1) of a panel, of one that shares it, or of the figure."""
    shared = (ax.get_shared_x_axes(), ax.get_shared_y_axes())[which]
    labels = [(other.xaxis, other.yaxis)[which].get_label_text() for other in (ax, *shared.get_siblings(ax))]
    figure: Any = ax.figure
    return next(filter(None, [*labels, (figure.get_supxlabel, figure.get_supylabel)[which]()]), "")


def _categories(axis: Axis) -> dict[float, str]:
    """Words at the ticks of an axis by their place; empty if they are numbers."""
    if not isinstance(axis.get_major_locator(), FixedLocator):
        return {}
    places = [float(place) for place in axis.get_majorticklocs()]
    texts = [plain(text) for text in axis.get_major_formatter().format_ticks(places)]
    pairs = dict(zip(places, texts, strict=True))
    return {} if all(map(_is_number, places, texts)) else pairs


def _is_number(place: float, text: str) -> bool:
    """True if a tick's text is the number at its place, or empty."""
    try:
        return not text or float(text.replace(",", "").replace("\N{MINUS SIGN}", "-")) == place
    except ValueError:
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


def _marks(artist: Artist, within: Sequence[bool], orientation: str | None) -> Marks:
    """Numbers that an artist draws, in the coordinates of the data.

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
        return Marks(mark, {name: points[:, k] for k, name in enumerate("xy") if within[k]})
    if isinstance(artist, LineCollection):
        return _extents("interval", map(_vertices, artist.get_paths()), within, None)
    if isinstance(artist, PolyCollection | Patch):
        paths = artist.get_paths() if isinstance(artist, PolyCollection) else [_path(artist)]
        outlines = [_vertices(path) for path in paths]
        if all(map(_is_box, outlines)):
            return _extents("bar" if all(within) else "span", outlines, within, orientation)
    raise TypeError(f"The data of a figure are of lines, intervals, bars and spans, not of {type(artist).__name__}.")


def _extents(mark: str, outlines: Iterable[np.ndarray], within: Sequence[bool], orientation: str | None) -> Marks:
    """Lower and upper ends of intervals, bars or spans with these corners (n, 2) each; across bars their middle."""
    numbers: dict[str, np.ndarray] = {}
    ends = np.array([[each.min(axis=0), each.max(axis=0)] for each in outlines]).reshape(-1, 2, 2)
    across = {"vertical": 0, "horizontal": 1}.get(orientation or "")
    for k, name in enumerate("xy"):
        low, high = ends[:, 0, k], ends[:, 1, k]
        if within[k] and (k == across or (low == high).all()):
            numbers[name] = (low + high) / 2
        elif within[k]:
            numbers |= {f"{name}_low": low, f"{name}_high": high}
    return Marks(mark, numbers)


def _path(patch: Patch) -> Path:
    """Outline of a patch in its own coordinates."""
    return patch.get_path().transformed(patch.get_patch_transform())


def _vertices(path: Path) -> np.ndarray:
    """Corners of an outline (n, 2)."""
    return np.asarray(path.vertices, dtype=float)


def _is_box(outline: np.ndarray) -> bool:
    """True for the corners of an upright rectangle, the first of which may be repeated at the end."""
    return len(outline) <= 5 and all(len(np.unique(outline[:, k])) <= 2 for k in (0, 1))
