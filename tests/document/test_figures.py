"""Files of figures: each format that is chosen is drawn once, nothing else is, and data agree with pictures."""

import csv
import io
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import experiments
from experiments.document import drawn_data, figures
from ident.display.plots import few_decades

ROOT = Path(experiments.__file__).parents[1]


def run(code, *options):
    """Output of code that runs in a process of its own."""
    command = [sys.executable, "-c", code, *options]
    return subprocess.run(command, check=True, cwd=ROOT, capture_output=True, text=True).stdout


def test_no_figure_is_drawn_for_none_and_matplotlib_not_imported(tmp_path):
    """Figures that are not asked for cost nothing; the page has its pictures and no section of figures."""
    log = ["scenes/arm.xml", "scenes/arm.csv", "--estimator", "ordinary", "--name", "arm"]
    code = "from experiments import identify; identify.main()\nimport sys; assert 'matplotlib' not in sys.modules"
    run(code, *log, "--formats", "none", "--out", str(tmp_path))
    page = (tmp_path / "arm" / "report.html").read_text(encoding="utf-8")
    assert not list(tmp_path.glob("arm/figure_*")) and 'id="figures"' not in page
    assert page.count('<svg class="picture"') == 3 and "<img" not in page


REPORTS = """
import importlib, pkgutil, sys
import experiments.document.figures, experiments.document.writer, experiments.reports, ident.display.plots
for each in pkgutil.iter_modules(experiments.reports.__path__, "experiments.reports."):
    importlib.import_module(each.name)
"""
HELP = """
import sys
from experiments import identify
try:
    identify.main(["--help"])
except SystemExit:
    pass
"""


@pytest.mark.parametrize(
    ("code", "unused"),
    [(REPORTS, {"matplotlib", "scipy.signal", "pandas"}), (HELP, {"matplotlib", "jinja2", "tqdm", "scipy", "mujoco"})],
)
def test_what_draws_nothing_imports_no_matplotlib(code, unused):
    printed = run(f"{code}\nprint('unused:', *({unused} & set(sys.modules)))")
    assert printed.splitlines()[-1] == "unused:"


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


def test_logarithmic_axes_have_ticks_without_numbers_between_decades():
    ax = Figure().subplots()
    ax.loglog([1e-7, 1e3], [0.03, 3])
    few_decades(ax)
    assert len(ax.get_yticks(minor=True)) > 10 and not any(label.get_text() for label in ax.get_yticklabels(minor=True))
    assert {"0.1", "1"} <= {label.get_text() for label in ax.get_yticklabels()}
    assert "$10^{-6}$" in {label.get_text() for label in ax.get_xticklabels()}


DRAWN = {
    "line": (lambda ax: ax.plot([0, np.nan], [2, 3]), [("0.0", "2.0", *[""] * 4), ("", "3.0", *[""] * 4)]),
    "points": (lambda ax: ax.plot([1], [2], "o"), [("1.0", "2.0", *[""] * 4)]),
    "bar": (lambda ax: ax.barh([1], [4], left=-1), [("", "1.0", "-1.0", "3.0", "", "")]),
    "interval": (lambda ax: ax.vlines([8], 0, 9), [("8.0", "", "", "", "0.0", "9.0")]),
    "span": (lambda ax: ax.axvspan(6, 7, label="_a"), [("", "", "6.0", "7.0", "", "")]),
}


@pytest.mark.parametrize("mark", DRAWN)
def test_data_are_the_numbers_that_artists_draw(mark):
    draw, expected = DRAWN[mark]
    ax = Figure().subplots()
    draw(ax)
    ax.set(xlabel=r"$m_{2}r_{z,2}$ (kg m)", yticks=[1, 2, 3], yticklabels=["=a", "b", "c"])
    rows = list(csv.DictReader(io.StringIO(drawn_data.csv_text(ax.figure))))
    assert [tuple(row.get(name, "") for name in drawn_data.NUMBERS) for row in rows] == expected
    assert {(row["mark"], row["x_axis"]) for row in rows} == {(mark, "m2rz2 (kg m)")}
    words = {"1.0": "'=a", "2.0": "b", "3.0": "c"}
    assert [row.get("y_category", "") for row in rows] == [words.get(row["y"], "") for row in rows]


@pytest.mark.parametrize("draw", [lambda ax: ax.imshow(np.eye(2)), lambda ax: ax.fill_between([0, 1, 2], [0, 1, 0])])
def test_artists_that_cannot_be_read_are_named(draw):
    figure = Figure()
    artist = draw(figure.subplots())
    with pytest.raises(TypeError, match=f"not of {type(artist).__name__}"):
        drawn_data.csv_text(figure)


def test_minor_ticks_are_drawn_as_matplotlib_draws_them(monkeypatch):
    def drawing():
        with figures.empty_figure(2) as figure:
            ax = figure.subplots()
            ax.loglog([0.03, 30], [2e-3, 5])
            few_decades(ax)
            return figures.drawn(figure, "png")

    def laid_out(layout, figure):
        layout.execute(figure)
        figure.set_layout_engine("none")

    marked = drawing()
    monkeypatch.setattr(figures, "_solve", laid_out)
    assert drawing() == marked
