"""Figure 1 and the tables of the paper's mechanism, and all studies on one page."""

import re
import shutil

import numpy as np
import pytest
from commands import entries_of, rows_of
from mechanisms import double_pendulum
from persons import briefly
from stand_ins import Here, leave_undrawn, use_truth

from experiments.__main__ import main as everything
from experiments.data import paper
from experiments.document.figures import SHEET
from experiments.reports import paper_report
from experiments.runs import workers
from experiments.studies import person_on_plates
from ident.geometry.se3 import exp
from multicontact.__main__ import main

OPTIONS = ["--formats", "svg", "--trials", "4", "--trajectory-trials", "2", "--redraw", "sensors"]
STUDIES = ("mechanism", "misaligned", "multicontact", "several_contacts", "human")
DRAWING = paper.drawing()


def test_figure_1_is_drawn_from_the_scene():
    q1, q2 = paper.DRAWN_AT
    elbow = np.array([0, -0.425 * np.sin(q1), 1 + 0.425 * np.cos(q1)])
    np.testing.assert_allclose(DRAWING.poses[2][:3, 3], elbow, atol=1e-12)
    end = elbow + 0.4 * np.array([0, -np.sin(q1 + q2), np.cos(q1 + q2)])
    np.testing.assert_allclose(DRAWING.end, end, atol=1e-12)
    arm = exp([0, 0, 0, 1, 0, 0], q1 + q2)[:3, :3] @ [0.1, 0, 0.2]
    np.testing.assert_allclose(DRAWING.masses[2], elbow + arm, atol=1e-12)
    bodies, frames = ({text.get_text() for text in ax.texts} for ax in paper_report.figure_1(DRAWING).axes[:2])
    assert {"$m_1$", "$m_2$", "$m_3$", "$l_1$", r"$\theta_1$", r"$\theta_2$"} <= bodies
    assert {"$g_1$, base", "$g_2$, link 1", "$g_3$, link 2"} <= frames


def test_tables_1_and_2_are_those_of_the_paper():
    still, turning = ("(0, 0, 0)", "(0, 0, 0)"), ("(0, 0, 0)", "(1, 0, 0)")
    rows = paper_report.table_2(DRAWING.tree, DRAWING.base).rows
    assert [(row[0], *row[2:]) for row in rows] == [
        ("base, i = 1", "(0, 0, 1)", *still),
        ("link1, i = 2", "(0, 0, 1)", *turning),
        ("link2, i = 3", "(0, 0, 1.425)", *turning),
    ]
    tree = paper.tree_of_table_1(DRAWING.base, 0.425)
    assert tree.names == ("2", "6", "10") and tree.joints == ("4", "8")
    assert paper.difference(tree, double_pendulum(base=DRAWING.base)) < 1e-14
    assert paper.difference(paper.tree_of_table_1(np.zeros(3), 0.4), DRAWING.tree) > 0.01


def test_the_command_prints_the_check(tmp_path, capsys):
    assert main(["mechanism", "--out", str(tmp_path), "--formats", "pdf"]) == 0
    assert "Tables I and II are the same mechanism" in capsys.readouterr().out
    assert f"/MediaBox [ 0 0 {72 * SHEET.column:g} ".encode() in (tmp_path / "figure_1.pdf").read_bytes()
    assert entries_of(tmp_path / "provenance.json")["options"] == {"formats": ["pdf"]}


def run(folder, *more):
    """Runs all studies, with empty files in place of figures, the truth of trajectory estimates, and a quick person."""
    with pytest.MonkeyPatch.context() as patched:
        leave_undrawn(patched)
        patched.setattr(workers, "Processes", Here)
        use_truth(patched)
        patched.setattr(person_on_plates, "study", lambda *_, **__: briefly())
        assert everything([*OPTIONS, "--out", str(folder), *more]) == 0
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return run(tmp_path_factory.mktemp("everything") / "results")


@pytest.mark.slow
def test_everything_on_one_page(out):
    assert {path.name for path in out.iterdir()} == {*STUDIES, "index.html"}
    page = (out / "index.html").read_text(encoding="utf-8")
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
    for row in rows_of(out / "several_contacts" / "table_contacts.csv"):
        assert f"<td>{float(row['peak_force_N']):.3f}</td>" in page
    errors = "error, ignoring pad", "error, ignoring handle", "error, ignoring all"
    estimates = (f"trajectory {name}" for name in ("error, simplified", "error, full", "s.d.", "error, ignoring all"))
    assert [name for name in (*errors, *estimates) if f'<th scope="col">{name}</th>' not in page] == []
    texts = [*(f"Figure {k}" for k in range(1, 6)), "Table I,", "Table II,", "Table III", "* The paper put inertias"]
    texts += ["<var>m</var><sub>2</sub><var>r</var><sub>z,2</sub>", "scene_sha256", "true, simplified"]
    assert [text for text in texts if text not in page] == [] and "m2rz2" not in page
    assert page.count("data:image/svg+xml;base64,") == 12
    assert page.count("from joint angles and wrenches alone") > 6


@pytest.mark.slow
def test_everything_resumes_what_was_interrupted(out, tmp_path):
    again = shutil.copytree(out, tmp_path / "results")
    (again / "multicontact" / "trials.npz").unlink()
    (again / "index.html").unlink()
    run(again, "--resume")
    assert (again / "index.html").read_bytes() == (out / "index.html").read_bytes()
