"""Empty files in place of figures, whose drawing takes most of a study's time."""

import pytest
from matplotlib.figure import Figure

from experiments.document import figures
from experiments.document.document import Plot


def not_drawn(figure: Figure, extension: str) -> bytes:
    """An empty file in place of a figure."""
    return b""


def leave_undrawn(patched: pytest.MonkeyPatch) -> None:
    """Draws no figures while a monkeypatch lasts: those of documents are empty, and so are their files."""
    patched.setattr(figures, "drawn", not_drawn)
    patched.setattr(Plot, "figure", Figure())
