import io

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.document import figures, styles

STYLES = {"style": {}, "other side": {"xtick.top": True, "ytick.right": True, "xtick.direction": "in"}}
"""Styles of ticks by name."""


def logarithmic(joined, span=1e3):
    """Four panels with logarithmic axes that share abscissae."""
    figure = Figure(figsize=(3, 3))
    axes = figure.subplots(2, 2, sharex=True)
    for k, ax in enumerate(axes.flat):
        ax.loglog([1, 50], [1, span * 2**k])
        figures.few_decades(ax.xaxis)
        figures.few_decades(ax.yaxis)
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.margins(x=0)
    axes[1, 0].set_xlabel("$x$")
    if joined:
        figures.join_minor_ticks(axes.flat)
    return figure


def picture(figure):
    """Pixels of a figure's PNG file."""
    return mpl.image.imread(io.BytesIO(figures.drawn(figure, "png")))


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_minor_ticks_that_are_joined_look_the_same(style):
    with styles.paper_style(), mpl.rc_context(style):
        joined, apart = logarithmic(joined=True), logarithmic(joined=False)
        np.testing.assert_array_equal(picture(joined), picture(apart))
        assert not any(axis.get_minorticklocs().size for ax in joined.axes for axis in (ax.xaxis, ax.yaxis))
        assert all(ax.yaxis.get_minorticklocs().size for ax in apart.axes)
