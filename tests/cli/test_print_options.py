"""Options of authors: all commands with tables or figures have them, and reject bad ones at once. Choices that turn out
at the end not to exist lose no results.
"""

import argparse
import re
from pathlib import Path

import pytest
from commands import refusal
from pages import options as identified

import experiments
from experiments import human, identify, mechanism, study
from experiments.__main__ import main as everything
from experiments.cli import print_options
from experiments.cli.command import COMMANDS
from experiments.document.writer import Output
from experiments.reports import index
from ident.errors import InputError

PAGE = {"page_columns", "brackets", "style"}
CHOICES = PAGE | {"caption", "parameters"}
WITHOUT = {"columns", "derive", "readme"}
"""Commands without LaTeX tables and figures of results."""

NEEDED = {
    "study": ["misaligned"],
    "validate": ["--data", "absent"],
    "identify": ["absent.xml", "absent.csv"],
    "batch": ["absent.xml", "absent.csv"],
    "stream": ["absent.xml", "absent.csv"],
    "compare": ["a", "b"],
    "angles": ["absent.xml", "absent.trc"],
    "payload": ["absent.xml", "absent.csv", "--body", "tool", "--sensor", "wrist"],
    "excite": ["double_pendulum"],
    "sweep": ["misaligned", "--over", "noise_scale", "1"],
}
"""Arguments that a command needs to start."""


def options(command):
    return {action.dest for action in command.parser()._actions}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_prints_lets_authors_choose(name):
    offered = options(COMMANDS[name]) & CHOICES
    assert offered == (set() if name in WITHOUT else PAGE if name == "paper" else CHOICES)


DREADFUL = {
    "no height": ("figure.figsize: 3, 0", "figure.figsize needs to be above 0 and at most 100 inches, got [3.0, 0.0]"),
    "a field": ("figure.figsize: 1e6, 1e6", "figure.figsize needs to be above 0"),
    "no pixels": ("savefig.dpi: 0", "savefig.dpi needs to be positive"),
    "too many": ("figure.dpi: 1e7", "figure.dpi needs to be positive and give at most 1e+08 pixels"),
    "huge letters": ("font.size: 1e9", "font.size needs to be at most 500, got 1e+09"),
    "no number": ("xtick.major.size: nan", "xtick.major.size needs to be at most 500, got nan"),
    "no colours": ("axes.prop_cycle: cycler('color', [])", "integer modulo by zero"),
    "no such map": ("image.cmap: none such", "image.cmap"),
    "margins": ("axes.xmargin: -0.7", "needs a style file of matplotlib's, but"),
    "inside out": ("figure.subplot.left: 2", "left cannot be >= right"),
    "effects": ("path.effects: [1]", "in which figures can be drawn, but"),
    "bytes": ("font.size: \x00", "needs a style file of matplotlib's, but"),
}


@pytest.mark.parametrize(("text", "message"), DREADFUL.values(), ids=DREADFUL)
def test_a_style_in_which_nothing_can_be_drawn_is_refused_before_the_work(text, message, tmp_path):
    (style := tmp_path / "mine.mplstyle").write_text(text, encoding="utf-8")
    given = argparse.Namespace(style=style, page_columns=2)
    with pytest.raises(InputError) as raised, print_options.style_of(given):
        pass
    assert "--style needs a style file of matplotlib's" in str(raised.value) and "\n" not in str(raised.value)
    assert message in str(raised.value) or text.startswith("image")


def test_a_style_may_leave_pixels_to_the_figure(tmp_path):
    (style := tmp_path / "mine.mplstyle").write_text("savefig.dpi: figure\nfigure.dpi: 50\nfont.size: 5\n")
    with print_options.style_of(argparse.Namespace(style=style, page_columns=2)):
        pass


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in WITHOUT])
def test_a_style_that_is_missing_is_refused_before_the_work(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = [*NEEDED.get(name, []), "--style", "absent.mplstyle"]
    assert "--style needs a style file of matplotlib's" in refusal(COMMANDS[name].main, given, capsys)
    assert not list(tmp_path.iterdir())


def test_everything_hands_on_what_it_says_of_the_page(tmp_path, monkeypatch):
    style, given = tmp_path / "mine.mplstyle", []

    def handed_on(*args, **_):
        given.append(next(each.choices for each in args if isinstance(each, Output)))

    style.write_text("font.size: 7\n", encoding="utf-8")
    for module in (mechanism, study, human):
        monkeypatch.setattr(module, "report", handed_on)
    monkeypatch.setattr(index, "write_index", lambda *_: None)
    assert everything(["--style", str(style), "--page-columns", "1", "--brackets", "--out", str(tmp_path)]) == 0
    assert given == 5 * [{"page_columns": 1, "brackets": True, "style": "mine.mplstyle"}]


def test_two_captions_of_one_table_are_refused_before_the_work(tmp_path, capsys):
    given = ["--caption", "table_1", "a", "--caption", "table_1", "b", "--out", str(tmp_path / "out")]
    assert "one of them is given two" in refusal(mechanism.main, given, capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("main", "given", "table"),
    [
        (lambda folder, more: mechanism.main(["--out", str(folder / "out"), *more]), ["--parameters", "m1"], "table_1"),
        (
            lambda folder, more: identify.main(identified(folder, *more)),
            ["--parameters", "m9"],
            "table_full_parameters",
        ),
        (
            lambda folder, more: identify.main(identified(folder, *more)),
            ["--caption", "table_9", "x"],
            "table_held_out",
        ),
    ],
)
def test_choices_of_what_is_not_written_lose_no_results(main, given, table, tmp_path, capsys):
    error = refusal(lambda more: main(tmp_path, more), given, capsys)
    assert f"error: All is written, with captions and parameters as by default: {given[0]} " in error
    assert f"got '{given[1]}'" in error
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"report.html", "provenance.json", f"{table}.csv", f"{table}.tex"} <= written
    rows = (tmp_path / "out" / f"{table}.csv").read_text(encoding="utf-8").count("\n")
    assert rows > 1 and (tmp_path / "out" / f"{table}.tex").read_text(encoding="utf-8").count(r"\\") >= rows


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
