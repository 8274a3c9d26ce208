"""Trial of an author's style on a small figure, before any work that a bad style would waste."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from experiments.document import figures, styles, symbols
from ident.errors import InputError

LONGEST = 100.0
"""Largest width and height of a figure, inches."""

PIXELS = 1e8
"""Largest number of pixels: at 300 per inch, a poster of 85 cm by 85 cm."""

LARGEST = 500.0
"""Largest size of letters and lines, points; drawing larger ones takes minutes, or all memory."""


def try_style(path: Path) -> None:
    """Draws curves, letters and formulas in the style of the surrounding `styles.author_style`.

    Args:
        path: The style's file, for the message.

    Raises:
        InputError: Figures cannot be drawn in it.
    """
    try:
        with styles.paper_style():
            _check_sizes()
        _draw()
    # Each backend, font library and converter of settings raises errors of its own.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"--style needs a style file of matplotlib's in which figures can be drawn, but '{path}': {reason[:200]}."
        ) from None


def _check_sizes() -> None:
    """Raises an error for sizes that take too much memory or time."""
    size, settings = np.array(mpl.rcParams["figure.figsize"], float), mpl.rcParams
    if not ((size > 0) & (size <= LONGEST)).all():
        raise ValueError(f"figure.figsize needs to be above 0 and at most {LONGEST:g} inches, got {size.tolist()}")
    for name in ("figure.dpi", "savefig.dpi"):
        dpi = settings["figure.dpi"] if settings[name] == "figure" else settings[name]
        if not (dpi > 0 and np.prod(size) * dpi**2 <= PIXELS):
            raise ValueError(f"{name} needs to be positive and give at most {PIXELS:g} pixels, got {dpi:g}")
    for name, value in settings.items():
        measured = name.endswith(("size", "width", "pad", "labelpad", "fontsize")) and isinstance(value, float | int)
        if measured and not abs(value) <= LARGEST:
            raise ValueError(f"{name} needs to be at most {LARGEST:g}, got {value:g}")


def _draw() -> None:
    """Draws a small figure in all formats, with curves, letters and formulas on linear and logarithmic axes."""
    x = np.linspace(0.1, 1, 20)
    with styles.paper_style():
        figure = Figure()
        for ax, scale in zip(figure.subplots(1, 2), ("linear", "log"), strict=True):
            ax.plot(x, x, "o--", color="C1", label="Curve, ±1°")
            ax.errorbar(x[::5], x[::5], xerr=0.1, fmt="none")
            ax.axvspan(0.2, 0.4)
            ax.set_yscale(scale)
        ax.set_title(symbols.parameter_symbol("m2rz2"))
        ax.set_xlabel(r"Time, $t$ (s)")
        figure.legend(*ax.get_legend_handles_labels())
    for extension in ("png", "pdf", "svg"):
        figures.drawn(figure, extension)
