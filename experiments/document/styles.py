"""Style of the paper's figures; matplotlib is imported with the first one."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.resources import as_file, files
from typing import Any

from experiments.document.sheet import SHEET
from ident.display.plots import Figure


@contextmanager
def paper_style() -> Iterator[None]:
    """Applies the style of the paper's figures, in the column width of the page, for the duration of a block."""
    import matplotlib as mpl

    with mpl.rc_context(_papers()), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # of names, drawn as boxes
        mpl.rcParams["figure.figsize"] = [SHEET.column, mpl.rcParams["figure.figsize"][1]]
        yield


@contextmanager
def empty_figure(height: float, *, wide: bool = False) -> Iterator[Figure]:
    """Yields a figure in this style, as wide as a column or as the page's text, with a height in inches."""
    with paper_style():
        from matplotlib.figure import Figure

        yield Figure(figsize=(SHEET.text if wide else SHEET.column, height))


@cache
def _papers() -> dict[Any, Any]:
    """All settings, the paper's before matplotlib's own; `rc_context` of a file would read all other styles first."""
    import matplotlib as mpl

    with as_file(files("experiments.document") / "paper.mplstyle") as path:
        settings = mpl.rc_params_from_file(path, use_default_template=True)
    # Reading the backend chooses one, and imports all of pyplot.
    return {name: settings[name] for name in settings if name != "backend"}
