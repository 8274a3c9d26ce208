"""The page that tables and figures are printed on, and the colours of curves on it and on the screen."""

from ident.display.plots import Sheet

INKS = ("black", "C1", "C0", "C2", "C3", "C4", "C5")
"""Colours of curves, in the order of pages: black, red and blue as in the paper, then the remaining ones."""

SHEET = Sheet(3.486, 7.139, 8.6, 3, row=0.16, panel=0.9, margin=0.8)
"""Sizes of figures for print on pages of two columns (IEEEtran's, 252 and 516 pt, at 72.27 pt per inch), with room
for a caption."""
