"""Formats of figures: each that is chosen is drawn once, and nothing else is."""

import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import experiments
from ident.display.plots import few_decades

ROOT = Path(experiments.__file__).parents[1]


def test_no_figure_is_drawn_for_none_and_matplotlib_not_imported(tmp_path):
    """Figures that are not asked for cost nothing; the page has its pictures and no section of figures."""
    command = "from experiments import identify; identify.main()\nimport sys; assert 'matplotlib' not in sys.modules"
    log = ["scenes/arm.xml", "scenes/arm.csv", "--estimator", "ordinary", "--name", "arm"]
    options = [*log, "--formats", "none", "--out", str(tmp_path)]
    subprocess.run([sys.executable, "-c", command, *options], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
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
    run = [sys.executable, "-c", f"{code}\nprint('unused:', *({unused} & set(sys.modules)))"]
    printed = subprocess.run(run, check=True, cwd=ROOT, capture_output=True, text=True).stdout
    assert printed.splitlines()[-1] == "unused:"


def test_logarithmic_axes_have_ticks_without_numbers_between_decades():
    ax = Figure().subplots()
    ax.loglog([1e-7, 1e3], [0.03, 3])
    few_decades(ax)
    assert len(ax.get_yticks(minor=True)) > 10 and not any(label.get_text() for label in ax.get_yticklabels(minor=True))
    assert {"0.1", "1"} <= {label.get_text() for label in ax.get_yticklabels()}
    assert "$10^{-6}$" in {label.get_text() for label in ax.get_xticklabels()}
