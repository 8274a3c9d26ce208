"""Nothing in files in place of figures, whose drawing takes most of a study's time."""

import pytest
from matplotlib.figure import Figure

from experiments.output import figures, identify_report


def not_drawn(figure: Figure, extension: str) -> bytes:
    """An empty file in place of a figure."""
    return b""


def leave_undrawn(patched: pytest.MonkeyPatch) -> None:
    """Draws nothing while a monkeypatch lasts, nor measures ticks to align labels, which is to draw them once.

    Figures of `identify`, whose axes take longer to set up than the estimate, have none.
    """
    patched.setattr(figures, "drawn", not_drawn)
    patched.setattr(figures, "align_ylabels", lambda axes: None)
    for name in ("held_out_figure", "parameters_figure", "spectra_figure"):
        patched.setattr(identify_report, name, lambda *given: Figure())
