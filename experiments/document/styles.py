"""Style of the paper's figures, the sizes of the page that they are for, and figures with a row for each parameter."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib.resources import as_file, files
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROW, MARGIN = 0.16, 0.8
"""Inches of a row, and of legend, ticks and label around them."""

COLUMN_ROWS = 24
"""Largest number of rows in a figure of one column; more take the width of the page."""

ABREAST = {1: 2, 2: 3}
"""Panels side by side in a wide figure, by the columns of the page."""


def row_panels(labels: Sequence[str], xlabel: str) -> tuple[Figure, list[tuple[Axes, np.ndarray]]]:
    """A figure with a row for each label, one column wide or, with many rows, in panels across the page.

    Returns:
        The figure, and for each panel its axes and the indices of its rows, which are their ordinates as well.
    """
    across = 1 if len(labels) <= COLUMN_ROWS else ABREAST[page_columns()]
    rows = max(1, -(-len(labels) // across))
    width = column_width() if across == 1 else text_width()
    figure = Figure(figsize=(width, MARGIN + ROW * rows))
    panels = []
    for k, ax in enumerate(figure.subplots(1, across, sharex=True, squeeze=False)[0]):
        own = np.arange(len(labels))[k * rows : (k + 1) * rows]
        ax.set_yticks(own, labels[k * rows : (k + 1) * rows])
        ax.set_ylim((k + 1) * rows - 0.4, k * rows - 0.6)
        panels.append((ax, own))
    if across == 1:
        panels[0][0].set_xlabel(xlabel)
    else:
        figure.supxlabel(xlabel, fontsize=mpl.rcParams["axes.labelsize"])
    return figure, panels


def most_rows() -> int:
    """Largest number of rows of such a figure on a page."""
    return ABREAST[page_columns()] * int((text_height() - MARGIN) / ROW)


WIDTHS = {1: (4.77, 4.77), 2: (3.486, 7.139)}
"""Width in inches of a column and of the text, on pages with one column (LaTeX's article) and with two (IEEEtran's, 252
and 516 pt, at 72.27 pt per inch)."""

HEIGHTS = {1: 6.7, 2: 8.6}
"""Largest height of figures on those pages, inches, with room for a caption."""

_PAGE: ContextVar[int] = ContextVar("_PAGE", default=2)
"""Number of columns of the page."""


@contextmanager
def paper_style() -> Iterator[None]:
    """Applies the style of the paper's figures, in the column width of the page, for the duration of a block."""
    with mpl.rc_context(_papers()):
        mpl.rcParams["figure.figsize"] = [WIDTHS[_PAGE.get()][0], mpl.rcParams["figure.figsize"][1]]
        yield


@cache
def _papers() -> dict[Any, Any]:
    """All settings, the paper's before matplotlib's own; `rc_context` of a file would read all other styles first."""
    with as_file(files("experiments.document") / "paper.mplstyle") as path:
        settings = mpl.rc_params_from_file(path, use_default_template=True)
    # Reading the backend chooses one, and imports all of pyplot.
    return {name: settings[name] for name in settings if name != "backend"}


@contextmanager
def page(columns: int) -> Iterator[None]:
    """Sizes a block's tables and figures for a page of so many columns."""
    before = _PAGE.set(columns)
    try:
        yield
    finally:
        _PAGE.reset(before)


def column_width() -> float:
    """Width of a column in inches, within `paper_style`."""
    return float(mpl.rcParams["figure.figsize"][0])


def text_width() -> float:
    """Width of the page's text in inches, for figures across all columns."""
    return WIDTHS[_PAGE.get()][1]


def page_columns() -> int:
    """Number of columns of the page."""
    return _PAGE.get()


def text_height() -> float:
    """Height of the page's text in inches, less room for a caption."""
    return HEIGHTS[_PAGE.get()]
