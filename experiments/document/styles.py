"""Style of the paper's figures, and figures with a row for each parameter."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.resources import as_file, files
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.document.sheet import ABREAST, COLUMN, HEIGHT, MARGIN, ROW, TEXT

COLUMN_ROWS = 24
"""Largest number of rows in a figure of one column; more take the width of the page."""


def row_panels(labels: Sequence[str], xlabel: str) -> tuple[Figure, list[tuple[Axes, np.ndarray]]]:
    """A figure with a row for each label, one column wide or, with many rows, in panels across the page.

    Returns:
        The figure, and for each panel its axes and the indices of its rows, which are their ordinates as well.
    """
    across = 1 if len(labels) <= COLUMN_ROWS else ABREAST
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


@contextmanager
def paper_style() -> Iterator[None]:
    """Applies the style of the paper's figures, in the column width of the page, for the duration of a block."""
    with mpl.rc_context(_papers()), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # of names, drawn as boxes
        mpl.rcParams["figure.figsize"] = [COLUMN, mpl.rcParams["figure.figsize"][1]]
        yield


@cache
def _papers() -> dict[Any, Any]:
    """All settings, the paper's before matplotlib's own; `rc_context` of a file would read all other styles first."""
    with as_file(files("experiments.document") / "paper.mplstyle") as path:
        settings = mpl.rc_params_from_file(path, use_default_template=True)
    # Reading the backend chooses one, and imports all of pyplot.
    return {name: settings[name] for name in settings if name != "backend"}


def column_width() -> float:
    """Width of a column in inches, within `paper_style`."""
    return float(mpl.rcParams["figure.figsize"][0])


def text_width() -> float:
    """Width of the page's text in inches, for figures across all columns."""
    return TEXT


def text_height() -> float:
    """Height of the page's text in inches, less room for a caption."""
    return HEIGHT
