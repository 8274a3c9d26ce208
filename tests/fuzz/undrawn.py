"""Empty files in place of figures, whose drawing takes most of a study's time."""

import pytest
from matplotlib.figure import Figure

from experiments.document import figures
from experiments.reports import identify_figures


def not_drawn(figure: Figure, extension: str) -> bytes:
    """An empty file in place of a figure."""
    return b""


def leave_undrawn(patched: pytest.MonkeyPatch) -> None:
    """Draws no figures while a monkeypatch lasts, and measures no ticks to align labels, which would draw them once.

    Figures of `identify` are empty, as their axes take longer to set up than the estimate.
    """
    patched.setattr(figures, "drawn", not_drawn)
    patched.setattr(figures, "align_ylabels", lambda axes: None)
    for name in ("held_out_figure", "parameters_figure", "spectra_figure"):
        patched.setattr(identify_figures, name, lambda *given: Figure())
