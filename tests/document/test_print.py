"""Tables and figures for print, compiled if LaTeX is installed."""

import shutil
import subprocess

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.document import figures, print_table, tabular
from experiments.document.print_table import PACKAGES

BODIES = ("base", "left_thigh", "shank & foot")
NAMES = ("m1", "m2rz2", "Ixy3")
TABLE = tabular.Table(
    "True parameters and errors, SI units",
    *tabular.columns(
        parameter=NAMES,
        true_full=[1.0, -12.5, np.nan],
        error_full=[1e-4, 0.25, 2e6],
        regrouping=["m1 + 0.425 m3", "m2rz2 - 2 Ixy3", "Ixy3"],
    ),
    marked=frozenset(["m2rz2"]),
    footnote="Why.",
    caption="True parameters and errors",
    notes=("Full: all of it.",),
    bodies=BODIES,
)

MISSING = [name for name in ("latexmk", "pdflatex", "kpsewhich") if shutil.which(name) is None]
MISSING += [
    f"{package}.sty"
    for package in (*PACKAGES.split(","), "geometry", "lmodern")
    if not MISSING and not subprocess.run(["kpsewhich", f"{package}.sty"], capture_output=True).stdout
]


def test_wide_tables_go_over_the_page_and_too_wide_ones_into_several():
    many = tabular.Table("t", ("name", *map(str, range(40))), (("a", *[1.5] * 40),))
    long = tabular.Table("t", ("name",), tuple((str(k),) for k in range(100)))
    one, floats, pages = (print_table.tex(each, "t") for each in (TABLE, many, long))
    assert one.count(r"\begin{table*}") > 0
    count = floats.count(r"\begin{table")
    assert count > 2 and floats.count(r"\label") == 1
    assert floats.count("continued") == floats.count(r"\addtocounter{table}{-1}") == count - 1
    assert pages.count(r"\toprule") == 2


@pytest.mark.parametrize("extension", ["svg", "png"])
def test_what_a_user_has_of_matplotlib_leaves_the_papers_figures_as_they_are(extension):
    def drawing():
        with figures.paper_style():
            figure = Figure(figsize=(1, 1))
            figure.subplots().plot([0, 1])
            return figures.drawn(figure, extension)

    own = {"axes.facecolor": "black", "lines.linestyle": "--", "font.size": 30}
    expected = drawing()
    with mpl.rc_context(own):
        assert drawing() == expected
        assert mpl.rcParams["font.size"] == own["font.size"]
