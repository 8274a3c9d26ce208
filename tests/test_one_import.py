"""`import multicontact as mc`: all front doors, in any folder."""

import subprocess
import sys

import estimates
import pytest

import ident
import multicontact as mc
import scenes
import sim
from ident.display.html import PAGES
from ident.errors import InputError

HOSTILE = {"experiments/__init__.py": "raise SystemExit('the wrong experiments')", "scenes.txt": ""}
"""Files of a user's folder that has experiments of its own."""


def test_it_has_the_names_of_both_packages_and_no_others():
    assert {*mc.__all__} == {*ident.__all__, *sim.__all__, "scenes", "report"} and mc.__all__ == sorted(mc.__all__)
    for package in (ident, sim):
        assert all(getattr(mc, name) is getattr(package, name) for name in package.__all__)
    assert mc.scenes is scenes and mc.__version__ == ident.__version__ and dir(mc) == mc.__all__
    with pytest.raises(AttributeError, match="module 'multicontact' has no attribute 'robot'"):
        _ = mc.robot


def test_nothing_is_imported_before_it_is_needed():
    code = "import multicontact, sys; assert not {'mujoco', 'numpy', 'ident', 'sim', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.fixture
def folder(tmp_path):
    """A folder with experiments of its own."""
    for name, content in HOSTILE.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, encoding="utf-8")
    return tmp_path


def test_a_report_is_the_page_of_the_command_and_the_notebook_links_it(tmp_path):
    estimate = estimates.quick()
    try:
        page = mc.report(estimate, tmp_path / "arm")
        assert page == tmp_path / "arm" / "report.html" and "Replay" in estimate._repr_html_()
        names = {path.name for path in page.parent.iterdir()}
        assert {"estimate.json", "model.xml", "table_base_parameters.csv", "figure_held_out.png"} <= names
        assert not any(name.endswith((".pdf", ".svg")) for name in names)
        text = page.read_text(encoding="utf-8")
        assert "A mechanism, identified from 1 recording" in text
        arm = mc.mechanism(page.parent / "model.xml")
        assert arm.known == pytest.approx(estimate.consistent().phi, abs=1e-9)
    finally:
        PAGES.pop(estimate, None)
    for formats in ("png", [], ["gif"]):
        with pytest.raises(InputError, match="formats needs some of pdf, png, svg; got"):
            mc.report(estimate, tmp_path / "arm", formats=formats)
