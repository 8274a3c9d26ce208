"""Formats of figures: each that is chosen is drawn once, and nothing else is."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG

import experiments
from experiments import misaligned

CANVASES = {"png": FigureCanvasAgg, "pdf": FigureCanvasPdf, "svg": FigureCanvasSVG}
ROOT = Path(experiments.__file__).parents[1]
SHORT = ["--samples", "60", "--trials", "2", "--redraw", "sensors"]
FIGURES = ("figure_2", "figure_3", "figure_monte_carlo")


@pytest.fixture
def drawings(monkeypatch):
    """Number of files that were drawn, by format."""
    drawn = Counter()

    def counted(extension, write):
        def write_and_count(*args, **options):
            drawn[extension] += 1
            return write(*args, **options)

        return write_and_count

    for extension, canvas in CANVASES.items():
        name = f"print_{extension}"
        monkeypatch.setattr(canvas, name, counted(extension, getattr(canvas, name)))
    return drawn


@pytest.mark.slow
@pytest.mark.usefixtures("no_trajectory", "here")
@pytest.mark.parametrize("formats", [["svg"], ["pdf", "png", "png"]], ids="+".join)
def test_one_format_costs_one_drawing(tmp_path, drawings, formats):
    assert misaligned.main([*SHORT, "--out", str(tmp_path), "--formats", *formats]) == 0
    assert drawings == dict.fromkeys(formats, len(FIGURES))
    endings = {*formats, "csv", *(["tex"] if "pdf" in formats else [])}
    assert {path.name for path in tmp_path.glob("figure_*")} == {f"{n}.{ending}" for n in FIGURES for ending in endings}
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    shown = "png" if "png" in formats else "svg+xml" if "svg" in formats else ""
    assert page.count("data:image/") == (len(FIGURES) if shown else 0)
    assert page.count(f"data:image/{shown};base64,") == page.count("<img ")
    assert page.count("written as PDF only") == (0 if shown else len(FIGURES))
    assert all(f'<a href="{name}.csv">data of the figure as CSV</a>' in page for name in FIGURES)


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
