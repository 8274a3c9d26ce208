"""The page that tables and figures are printed on, and the colours of curves on it and on the screen."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ident.display.plots import Sheet

INKS = ("black", "C1", "C0", "C2", "C3", "C4", "C5")
"""Colours of curves, in the order of pages: black, red and blue as in the paper, then the remaining ones."""

WIDTHS = {1: (4.77, 4.77), 2: (3.486, 7.139)}
"""Width in inches of a column and of the text, on pages with one column (LaTeX's article) and with two (IEEEtran's, 252
and 516 pt, at 72.27 pt per inch)."""

HEIGHTS = {1: 6.7, 2: 8.6}
"""Largest height of figures on those pages, inches, with room for a caption."""

_PAGE: ContextVar[int] = ContextVar("_PAGE", default=2)
"""Number of columns of the page."""


@contextmanager
def page(columns: int) -> Iterator[None]:
    """Sizes a block's tables and figures for a page of so many columns."""
    before = _PAGE.set(columns)
    try:
        yield
    finally:
        _PAGE.reset(before)


def page_columns() -> int:
    """Number of columns of the page."""
    return _PAGE.get()


def current() -> Sheet:
    """Sizes of figures for print on a page, with room for a caption."""
    columns = page_columns()
    return Sheet(*WIDTHS[columns], HEIGHTS[columns], {1: 2, 2: 3}[columns], row=0.16, panel=0.9, margin=0.8)
