"""All commands with tables or figures size them for a page of one or two columns."""

import re
from pathlib import Path

import pytest

import experiments
from experiments import human, mechanism, study
from experiments.__main__ import main as everything
from experiments.cli.command import COMMANDS
from experiments.document.writer import Output
from experiments.reports import index

WITHOUT = {"columns", "derive"}
"""Commands without LaTeX tables and figures of results."""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_prints_has_the_columns_of_the_page(name):
    offered = {action.dest for action in COMMANDS[name].parser()._actions}
    assert ("page_columns" in offered) == (name not in WITHOUT)


def test_everything_is_for_the_chosen_page(tmp_path, monkeypatch):
    given = []

    def handed_on(*args, **_):
        given.append(next(each.choices for each in args if isinstance(each, Output)))

    for module in (mechanism, study, human):
        monkeypatch.setattr(module, "report", handed_on)
    monkeypatch.setattr(index, "write_index", lambda *_: None)
    assert everything(["--page-columns", "1", "--out", str(tmp_path)]) == 0
    assert given == 5 * [{"page_columns": 1}]


def test_figures_have_one_cycle_of_colours_one_font_and_the_pages_width():
    folder = Path(experiments.__file__).parent
    drawing = [path for path in folder.rglob("*.py") if "matplotlib.figure" in path.read_text(encoding="utf-8")]
    own = {"moving_picture.py", "estimator_figure.py"}  # the documentation's
    tutorials = list((folder.parent / "docs" / "tutorials").glob("*.py"))
    own |= {path.name for path in tutorials}
    assert len(drawing) > 10 and tutorials
    for path in (*drawing, *tutorials):
        text = path.read_text(encoding="utf-8")
        assert not re.findall(r"\"tab:\w+|\"#[0-9a-fA-F]{6}\"|font\.?family|fontname", text), path.name
        assert path.name in own or not re.findall(r"figsize=\(\d", text), path.name
