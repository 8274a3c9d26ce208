"""Figures with a row for each parameter, never higher than a page."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.document import styles

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
    across = 1 if len(labels) <= COLUMN_ROWS else ABREAST[styles.page_columns()]
    rows = max(1, -(-len(labels) // across))
    width = styles.column_width() if across == 1 else styles.text_width()
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
    return ABREAST[styles.page_columns()] * int((styles.text_height() - MARGIN) / ROW)
