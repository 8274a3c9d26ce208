import csv
import json
import re
import shutil

import numpy as np
import pytest
from mechanisms import double_pendulum
from persons import at_a_rail
from stand_ins import Here, leave_undrawn, use_truth

from experiments.__main__ import main as everything
from experiments.data import paper
from experiments.document.figures import SHEET
from experiments.mechanism import main
from experiments.reports import mechanism_report
from experiments.runs import workers
from experiments.studies import pendulum_drawn, person_on_plates
from ident.geometry.se3 import exp

OPTIONS = ["--formats", "svg", "--trials", "4", "--trajectory-trials", "2", "--redraw", "sensors"]
STUDIES = ("mechanism", "misaligned", "multicontact", "several_contacts", "human")


def test_figure_1_is_drawn_from_the_scene():
    drawing = pendulum_drawn.drawing()
    q1, q2 = pendulum_drawn.DRAWN_AT
    elbow = np.array([0, -0.425 * np.sin(q1), 1 + 0.425 * np.cos(q1)])
    np.testing.assert_allclose(drawing.poses[2][:3, 3], elbow, atol=1e-12)
    end = elbow + 0.4 * np.array([0, -np.sin(q1 + q2), np.cos(q1 + q2)])
    np.testing.assert_allclose(drawing.end, end, atol=1e-12)
    arm = exp([0, 0, 0, 1, 0, 0], q1 + q2)[:3, :3] @ [0.1, 0, 0.2]
    np.testing.assert_allclose(drawing.masses[2], elbow + arm, atol=1e-12)
    figure = mechanism_report.figure_1(drawing)
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert {"$m_1$", "$m_2$", "$m_3$", "$l_1$", r"$\theta_1$", r"$\theta_2$"} <= texts
    assert {"$g_1$, base", "$g_2$, link 1", "$g_3$, link 2"} <= {text.get_text() for text in figure.axes[1].texts}


def test_table_2_is_that_of_the_paper():
    drawing = pendulum_drawn.drawing()
    rows = mechanism_report.table_2(drawing.tree, drawing.base).rows
    assert [row[0] for row in rows] == ["base, i = 1", "link1, i = 2", "link2, i = 3"]
    assert [row[2] for row in rows] == ["(0, 0, 1)", "(0, 0, 1)", "(0, 0, 1.425)"]
    assert [row[3:] for row in rows] == [("(0, 0, 0)", "(0, 0, 0)"), *[("(0, 0, 0)", "(1, 0, 0)")] * 2]


def test_table_1_as_printed_is_the_double_pendulum():
    drawing = pendulum_drawn.drawing()
    tree = pendulum_drawn.tree_of_table_1(drawing.base, 0.425)
    expected = double_pendulum(base=drawing.base)
    assert tree.names == ("2", "6", "10")
    assert tree.joints == ("4", "8")
    assert pendulum_drawn.difference(tree, expected) < 1e-14
    assert pendulum_drawn.difference(pendulum_drawn.tree_of_table_1(np.zeros(3), 0.4), drawing.tree) > 0.01


def test_the_command_prints_the_check(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--formats", "pdf"]) == 0
    assert "Tables I and II are the same mechanism" in capsys.readouterr().out
    assert f"/MediaBox [ 0 0 {72 * SHEET.column:g} ".encode() in (tmp_path / "figure_1.pdf").read_bytes()
    options = json.loads((tmp_path / "provenance.json").read_text())["options"]
    assert options == {"formats": ["pdf"]}


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Results of the run of all studies, with empty files in place of figures."""
    folder = tmp_path_factory.mktemp("everything") / "results"
    with pytest.MonkeyPatch.context() as patched:
        leave_undrawn(patched)
        patched.setattr(workers, "Processes", Here)
        use_truth(patched)
        person = at_a_rail()
        patched.setattr(person_on_plates, "study", lambda *args, **kwargs: person)
        assert everything([*OPTIONS, "--out", str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_everything_on_one_page(out):
    assert {path.name for path in out.iterdir()} == {*STUDIES, "index.html"}
    page = (out / "index.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == 12
    targets = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)|url\(([^)]*)""", page)
    links = {link for pair in targets for link in pair if link and not link.startswith("data:")}
    sections = {link for link in links if link.startswith("#")}
    assert len(sections) == page.count('<details class="section"')
    assert all(f'id="{link[1:]}"' in page for link in sections)
    # All files of a study are beside the page, and all tables and figures are linked.
    written = {path.relative_to(out).as_posix() for path in out.glob("*/*")}
    assert links - sections == {name for name in written if re.search(r"(csv|md|tex|svg|png|html)$", name)}
    # Tables are sorted by a script of the page's own.
    assert re.findall(r"<script[^>]*>", page) == ["<script>"]
    for number in ("Figure 1", "Figure 2", "Figure 3", "Figure 4", "Figure 5", "Table I,", "Table II,", "Table III"):
        assert number in page
    for study, column in (("multicontact", "true_scene"), ("several_contacts", "true")):
        for row in csv.DictReader((out / study / "table_4.csv").read_text().splitlines()):
            assert any(f">{float(row[column]):.{k}f}<".replace("-", "\N{MINUS SIGN}") in page for k in range(2, 7))
    for column in ("error, ignoring pad", "error, ignoring handle", "error, ignoring all"):
        assert f'<th scope="col">{column}</th>' in page
    for row in csv.DictReader((out / "several_contacts" / "table_contacts.csv").read_text().splitlines()):
        assert f"<td>{float(row['peak_force_N']):.3f}</td>" in page
    assert f"{paper.CONDITION_NUMBER_MULTICONTACT:g}" in page
    assert "scene_sha256" in page
    assert 'name="viewport"' in page and "@media print" in page and "prefers-color-scheme: dark" in page
    assert "<var>m</var><sub>2</sub><var>r</var><sub>z,2</sub>" in page and "m2rz2" not in page
    for column in ("error, simplified", "error, full", "s.d.", "error, ignoring all"):
        assert f'<th scope="col">trajectory {column}</th>' in page
    assert page.count("from joint angles and wrenches alone") > 6
    assert "true, simplified" in page and "* The paper put inertias" in page


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "no_trajectory", "here")
def test_everything_resumes_what_was_interrupted(out, tmp_path, monkeypatch):
    person = at_a_rail()
    monkeypatch.setattr(person_on_plates, "study", lambda *args, **kwargs: person)
    again = shutil.copytree(out, tmp_path / "results")
    (again / "multicontact" / "trials.npz").unlink()
    (again / "index.html").unlink()
    assert everything([*OPTIONS, "--out", str(again), "--resume"]) == 0
    assert (again / "index.html").read_bytes() == (out / "index.html").read_bytes()
