"""Style of figures: the paper's, or an author's, and the sizes of the page that it is for."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import matplotlib as mpl

from experiments.document.layout import HEIGHTS, WIDTHS
from ident.errors import InputError

_PAGE: ContextVar[int] = ContextVar("_PAGE", default=2)
"""Number of columns of the page."""

_AUTHORS: ContextVar[Any] = ContextVar("_AUTHORS", default=())
"""An author's settings, which precede the paper's."""


@contextmanager
def paper_style() -> Iterator[None]:
    """Applies the style of the paper's figures, or an author's, for the duration of a block."""
    with mpl.rc_context(_papers()):
        mpl.rcParams.update(_AUTHORS.get())
        yield


@cache
def _papers() -> dict[Any, Any]:
    """All settings, the paper's before matplotlib's own; `rc_context` of a file would read all other styles first."""
    with as_file(files("experiments.document") / "paper.mplstyle") as path:
        settings = mpl.rc_params_from_file(path, use_default_template=True)
    # Reading the backend chooses one, and imports all of pyplot.
    return {name: settings[name] for name in settings if name != "backend"}


@contextmanager
def author_style(path: Path | None, columns: int) -> Iterator[None]:
    """Draws a block's figures for a page of so many columns, in the style of a matplotlib style file.

    Raises:
        InputError: The file does not exist, or has a setting unknown to matplotlib.
    """
    with paper_style():
        given: Any = {"figure.figsize": [WIDTHS[columns][0], mpl.rcParams["figure.figsize"][1]]}
    if path is not None:
        try:
            settings = [
                line.partition("#")[0].partition(":")[0].strip() for line in path.read_text("utf-8").splitlines()
            ]
            if unknown := [name for name in settings if name and name not in mpl.rcParams]:
                raise KeyError(unknown[0])
            given |= mpl.rc_params_from_file(path, fail_on_error=True, use_default_template=False)
        # Matplotlib's checks of values raise errors of all classes.
        except Exception as error:
            reason = f"'{error.args[0]}' is no setting" if isinstance(error, KeyError) else str(error)
            raise InputError(f"--style needs a style file of matplotlib's, but '{path}': {reason}.") from None
    before, page = _AUTHORS.set(given), _PAGE.set(columns)
    try:
        yield
    finally:
        _AUTHORS.reset(before)
        _PAGE.reset(page)


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
