"""Tables and figures for print, compiled if LaTeX is installed."""

import shutil
import subprocess

import numpy as np
import pytest

from experiments.document import print_table, sheet, tabular
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


@pytest.mark.parametrize("columns", [1, 2])
def test_wide_tables_go_over_the_page_and_too_wide_ones_into_several(columns):
    many = tabular.Table("t", ("name", *map(str, range(40))), (("a", *[1.5] * 40),))
    long = tabular.Table("t", ("name",), tuple((str(k),) for k in range(100)))
    with sheet.page(columns):
        one, floats, pages = (print_table.tex(each, "t") for each in (TABLE, many, long))
    assert (one.count(r"\begin{table*}") > 0) == (columns == 2)
    count = floats.count(r"\begin{table")
    assert count > 2 and floats.count(r"\label") == 1
    assert floats.count("continued") == floats.count(r"\addtocounter{table}{-1}") == count - 1
    assert pages.count(r"\toprule") == (3 if columns == 1 else 2)
