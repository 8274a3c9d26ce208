"""The page that tables and figures are printed on, and the colours of curves on it and on the screen."""

INKS = ("black", "C1", "C0", "C2", "C3", "C4", "C5")
"""Colours of curves, in the order of pages: black, red and blue as in the paper, then the remaining ones."""

COLUMN, TEXT, HEIGHT = 3.486, 7.139, 8.6
"""Width of a column and of the text of pages with two columns (IEEEtran's, 252 and 516 pt, at 72.27 pt per inch), and
largest height of figures, with room for a caption, inches."""

ROW, MARGIN = 0.16, 0.8
"""Inches of a row, and of legend, ticks and label around them."""

ABREAST = 3
"""Panels side by side in a wide figure."""

MOST_ROWS = ABREAST * int((HEIGHT - MARGIN) / ROW)
"""Largest number of rows of such a figure on a page."""
