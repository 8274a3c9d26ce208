"""Tables and figures for print, compiled if LaTeX is installed."""

import re
import shutil
import subprocess

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from test_escape import EVIL
from truth import use_truth

from experiments.document import figures, print_table, sheet, styles, tabular
from experiments.document.document import Document
from experiments.document.print_table import PACKAGES
from experiments.document.tabular import Regrouped
from experiments.document.writer import Output, write_parts
from experiments.reports import study_figures, study_tables
from experiments.studies.simulated import study

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

UNCERTAIN = tabular.Table(
    "Estimates",
    *tabular.columns(
        parameter=(*NAMES, "offset(Fx)"),
        estimated=[20.9933, -0.55764, 1.2e4, 0.0],
        std=[0.0044, 0.000750, 310.0, 0.0],
        paper_error=[0.3, -0.1, 0.0, np.nan],
        model=[20.99, -0.565, 12100.0, np.nan],
        regrouping=["m1 + m2 + m3", "m2rz2 + 0.425 m3 + 0.1806 m3 - 0.425 m3rx3 + 0.1 m3", "Ixy3", ""],
    ),
    digits={"paper_error": (2, 2, 2, 2)},
    deviations={"estimated": "std"},
    regrouped=Regrouped({"": ("m1 + m2 + m3", "m2rz2 + 0.425 m3")}),
    bodies=BODIES,
    units=("kg", "kg m", "kg m²", "N"),
)
"""A table of estimates of very different standard deviations."""

MISSING = [name for name in ("latexmk", "pdflatex", "kpsewhich") if shutil.which(name) is None]
MISSING += [
    f"{package}.sty"
    for package in (*PACKAGES.split(","), "geometry", "lmodern")
    if not MISSING and not subprocess.run(["kpsewhich", f"{package}.sty"], capture_output=True).stdout
]


def test_parameters_have_bodies_units_and_symbols():
    tex = print_table.tex(TABLE, "table_a")
    assert r"\caption{True parameters and errors.}\label{tab:table_a}" in tex
    assert r"$m_{1}$ of \emph{base} & \unit{\kilo\gram} & 1.000 & 0.000 & $m_{1} + 0.425\,m_{3}$ \\" in tex
    assert r"$m_{2}r_{z,2}$* of \emph{left\_thigh} & \unit{\kilo\gram\metre} & -12.500" in tex
    assert r"\emph{shank \& foot} & \unit{\kilo\gram\metre\squared} &  & 2.00e+06" in tex
    assert r"\multicolumn{2}{c}{Full}" in tex and r"\cmidrule(lr){3-4}" in tex
    assert r"S[table-format=-2.3]S[table-format=1.3e1]l" in tex
    assert r"\item[*] Why." in tex and r"\item Full: all of it." in tex
    assert not re.search(r"m2rz2|SI units|_\w+simplified", tex)


def test_standard_deviations_have_columns_of_their_own():
    tex = print_table.tex(UNCERTAIN, "t")
    assert r"\unit{\kilo\gram} & 20.9933 & 0.0044 & 0.30 & " in tex
    assert r"S[table-format=-5.5]S[table-format=3.5]S[table-format=-1.2]" in tex
    assert r"$m_{1}$$^\dagger$ of" in tex and r"\item[$^\dagger$] Regrouped" in tex


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


SUMS = tabular.Table(
    "Sums",
    *tabular.columns(
        parameter=[f"m{k}" for k in range(1, 61)],
        estimate=[float(k) for k in range(60)],
        regrouping=["m1" + "".join(f" + 0.0{j + 11} m{j}rz{j}" for j in range(1, 40)) for _ in range(60)],
    ),
    bodies=[f"body{k}" for k in range(1, 61)],
)
"""A table with cells that break into many lines."""


@pytest.mark.parametrize("extension", ["svg", "png"])
def test_what_a_user_has_of_matplotlib_leaves_the_papers_figures_as_they_are(extension):
    def drawing():
        with styles.paper_style():
            figure = Figure(figsize=(1, 1))
            figure.subplots().plot([0, 1])
            return figures.drawn(figure, extension)

    own = {"axes.facecolor": "black", "lines.linestyle": "--", "font.size": 30}
    expected = drawing()
    with mpl.rc_context(own):
        assert drawing() == expected
        assert mpl.rcParams["font.size"] == own["font.size"]


def test_drawings_are_small_and_the_same(tmp_path):
    with styles.paper_style():
        figure = Figure(figsize=(1, 1))
        figure.subplots().plot(np.random.default_rng(0).normal(size=500))
    figures.save(figure, tmp_path, "x", ["svg"])
    svg = (tmp_path / "x.svg").read_text()
    paths = re.findall(r' d="([^"]*)"', svg)
    assert len(svg) < 40_000 and not any(re.search(r"\d\.\d{3}", path) for path in paths)


@pytest.fixture(scope="module")
def studies():
    """Short runs of the studies with the most content, with the truth as trajectory estimates."""
    made = [study(name, samples=100) for name in ("misaligned", "several_contacts")]
    with pytest.MonkeyPatch.context() as patched:
        use_truth(patched)
        for each in made:
            for model in each.file.models:
                each.trajectory(model)
    return made


def preamble(columns, journal):
    """Class and page of a document: IEEEtran's if it is a journal of it, else like it, as not every TeX has it."""
    if journal:
        return r"\documentclass[journal]{IEEEtran}"
    kind = "twocolumn" if columns == 2 else "onecolumn"
    size = r"\usepackage[textwidth=516pt,columnsep=12pt,textheight=696pt]{geometry}" if columns == 2 else ""
    return rf"\documentclass[10pt,{kind}]{{article}}{size}\usepackage[T1]{{fontenc}}\usepackage{{lmodern}}"


def compiled(folder, names, start):
    """Compiles everything in a folder, and returns the log's complaints."""
    body = "\n".join(rf"\input{{{name}}}\clearpage" for name in names)
    text = rf"{start}\usepackage{{graphicx,{PACKAGES}}}\begin{{document}}{body}\end{{document}}"
    (folder / "all.tex").write_text(text, encoding="utf-8")
    command = ["latexmk", "-pdf", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    assert done.returncode == 0, done.stdout[-3000:]
    # IEEEtran has no font for the italics of its captions, and takes another.
    complaints = r"(?:Overfull|Float too large|Missing character|(?<!' )undefined).*"
    return re.findall(complaints, (folder / "all.log").read_text(errors="replace"))


@pytest.mark.slow
@pytest.mark.skipif(bool(MISSING), reason=f"LaTeX is not complete here: {', '.join(MISSING)} is missing")
@pytest.mark.parametrize(("columns", "journal"), [(1, False), (2, False), (2, True)])
def test_every_table_and_figure_compiles_without_overfull_boxes(tmp_path, studies, columns, journal):
    if journal and not subprocess.run(["kpsewhich", "IEEEtran.cls"], capture_output=True).stdout:
        pytest.skip("LaTeX has no IEEEtran here")
    drawn, tables = {}, {"table_own": TABLE, "table_sums": SUMS, "table_uncertain": UNCERTAIN}
    # pdfLaTeX has no Arabic letters.
    evil = [text for text in EVIL if "\N{ARABIC LETTER ALEF}" not in text]
    hostile = tuple((name, 1.0, name) for name in evil)
    tables["table_evil"] = tabular.Table(EVIL[1], ("name", EVIL[2], EVIL[6]), hostile, notes=tuple(evil))
    with sheet.page(columns):
        for each in studies:
            tables |= {f"{name}_{each.several}": study_tables.table(each, name) for name in each.file.tables}
            for name, entry in each.file.figures.items():
                drawn[f"{name}_{each.several}"] = study_figures.figure(each, name), entry["caption"]
        write_parts(Document(tables=tables, figures=drawn), Output(tmp_path, ["pdf"]))
    assert compiled(tmp_path, [*tables, *drawn], preamble(columns, journal)) == []
