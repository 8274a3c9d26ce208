"""All commands with tables or figures size them for a page of one or two columns."""

import pytest

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
