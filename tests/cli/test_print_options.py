"""The options of authors: every command that writes tables or figures has them, and refuses bad ones at once."""

import re
from pathlib import Path

import pytest
from commands import refusal

import experiments
from experiments.cli.command import COMMANDS

PAGE = {"page_columns", "style"}
CHOICES = PAGE | {"caption", "parameters"}
WITHOUT = {"columns", "derive", "readme"}
"""Commands that write neither tables in LaTeX nor figures of results."""

NEEDED = {
    "study": ["misaligned"],
    "in_vivo": ["--data", "absent"],
    "identify": ["absent.xml", "absent.csv"],
    "stream": ["absent.xml", "absent.csv"],
    "compare": ["a", "b"],
    "angles": ["absent.xml", "absent.trc"],
    "payload": ["absent.xml", "absent.csv", "--body", "tool", "--sensor", "wrist"],
    "excite": ["double_pendulum"],
    "sweep": ["misaligned", "--over", "noise_scale", "1"],
}
"""Arguments without which a command does not start."""


def options(command):
    return {action.dest for action in command.parser()._actions}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_prints_lets_authors_choose(name):
    found = options(COMMANDS[name]) & CHOICES
    assert found == (set() if name in WITHOUT else PAGE if name == "paper" else CHOICES)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in WITHOUT])
def test_a_style_that_is_missing_is_refused_before_the_work(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = [*NEEDED.get(name, []), "--style", "absent.mplstyle"]
    assert "--style needs a style file of matplotlib's" in refusal(COMMANDS[name].main, given, capsys)
    assert not list(tmp_path.iterdir())


def test_figures_have_one_cycle_of_colours_one_font_and_the_pages_width():
    folder = Path(experiments.__file__).parent
    drawing = [path for path in folder.rglob("*.py") if "matplotlib.figure" in path.read_text(encoding="utf-8")]
    own = {"moving_picture.py", "estimator_figure.py", "film.py"}  # the documentation's, and films
    assert len(drawing) > 10
    for path in drawing:
        text = path.read_text(encoding="utf-8")
        assert not re.findall(r"\"tab:\w+|\"#[0-9a-fA-F]{6}\"|font\.?family|fontname", text), path.name
        assert path.name in own or not re.findall(r"figsize=\(\d", text), path.name
