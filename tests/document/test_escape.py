"""Hostile names are shown literally, by readers of each format that are written for these tests."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

import scenes
from experiments import excite, identify
from experiments.document import figures, print_table, symbols, tabular
from ident.recordings.recording import Recording
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

EVIL = [
    r"\input{/etc/passwd}",
    r"\write18{ls}",
    "<script>alert(1)</script>",
    "$x",
    "$\\foo$",
    "a|b",
    "&%$#_{}~^\\",
    "[1cm] *star* `code` ![x](y) __b__ _i_ ~~s~~",
    "a--b---c",
    "two\nlines\r\t",
    "Größe, \N{ARABIC LETTER ALEF}",
]
TEXTS = st.one_of(st.text("\\{}$&#%_^~|[]*`<>!-ab \n", max_size=12), st.sampled_from(EVIL))

COMMANDS = {
    "textbackslash": "\\",
    "textasciitilde": "~",
    "textasciicircum": "^",
    "textless": "<",
    "textgreater": ">",
    "textbar": "|",
}


def shown_by_tex(source):
    """Text that TeX typesets; any command raises an error."""
    out, rest = "", source
    while rest:
        if match := re.match(r"\\([&%$#_{}])|\\([a-z]+)\{\}|\{([\[*]?)\}|([^&%$#_{}~^\\])", rest):
            out += match[1] or (match[2] and COMMANDS[match[2]]) or match[3] or match[4] or ""
            rest = rest[match.end() :]
        else:
            raise AssertionError(f"TeX would act on {rest!r}")
    assert "--" not in source and not re.match(r" *[\[*]", source)
    return out


def shown_by_markdown(source):
    """Text that a Markdown table shows; any markup raises an error."""
    within_words = re.sub(r"(?<=[^\W_])_(?=[^\W_])", r"\\_", source)
    out, rest = "", within_words
    while rest:
        match = re.match(r"\\([!-/:-@\[-`{-~])|([^\\`*_{}\[\]<>|~$&#!\n])", rest)
        assert match, f"Markdown would act on {rest!r}"
        out, rest = out + (match[1] or match[2]), rest[match.end() :]
    return out


def in_a_line(text):
    return re.sub(r"[\n\r\t]+", " ", text)


@settings(max_examples=300, deadline=None)
@given(TEXTS)
@example("_a_")
def test_all_letters_are_shown_and_none_is_acted_on(text):
    assert shown_by_tex(symbols.tex(text)) == in_a_line(text)
    assert shown_by_markdown(symbols.markdown(text)) == in_a_line(text)


def test_matplotlib_draws_the_letters():
    for text in EVIL:
        figure = Figure()
        shown = figure.text(0, 0, symbols.label(text))
        assert shown._preprocess_math(shown.get_text()) == (in_a_line(text), False)
        figure.draw_without_rendering()


def test_tables_keep_their_cells_and_their_symbols():
    rows = tuple((name, 1.0, "Ixx2 + 0.4 m3") for name in EVIL)
    table = tabular.Table(EVIL[0], ("name_of", "x", "what"), rows, marked=frozenset([EVIL[0]]), footnote=EVIL[2])
    lines = [line for line in table.markdown().splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(EVIL) and all(len(re.findall(r"(?<!\\)\|", line)) == 4 for line in lines)
    head, _, body = (
        print_table.tex(table).partition("\\toprule\n")[2].partition("\\bottomrule")[0].partition("\\midrule\n")
    )
    cells = [row.split(" & ") for row in body.split(" \\\\\n")[:-1]]
    assert [shown_by_tex(row[0].removesuffix("*")) for row in cells] == list(map(in_a_line, EVIL))
    assert {row[2] for row in cells} == {r"$I_{xx,2} + 0.4\,m_{3}$"}
    assert cells[0][0].endswith("*") and head.startswith("Name of & {$x$} & What")
    assert not re.search(r"\\(input|write)", print_table.tex(table)) and "<script>" not in table.markdown()


@pytest.fixture
def hostile(tmp_path):
    """The double pendulum with hostile names, and its recording."""
    names = {"link1": r"\input{/etc/passwd}", "link2": "<script>$|", "joint1": "$\\foo$", "joint2": "`b` & <i>"}
    spec = scenes.load("double_pendulum")
    spec.compile()
    root = ET.fromstring(spec.to_xml())
    for element in root.iter():
        element.attrib.update({key: names[x] for key, x in element.attrib.items() if x in names})
    path = tmp_path / "$evil$.xml"
    ET.ElementTree(root).write(path)
    original = simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=400)
    measured = {"ground_force": original["ground_force"], "ground_torque": original["ground_torque"]}
    for joint in ("joint1", "joint2"):
        for kind in ("position", "velocity", "acceleration"):
            measured[f"{names[joint]}_{kind}"] = original[f"{joint}_{kind}"]
        measured[f"{names[joint]}_torque"] = np.random.default_rng(0).normal(size=400)
    Recording(original.time, measured).save(tmp_path / "log.npz")
    return path, tmp_path / "log.npz"


@pytest.mark.slow
def test_commands_go_through_with_hostile_names(hostile, tmp_path, monkeypatch):
    model, log = map(str, hostile)
    # Letters are laid out once for all formats.
    save = figures.save
    monkeypatch.setattr(figures, "save", lambda figure, folder, name, formats: save(figure, folder, name, formats[-1:]))
    given = [model, log, "--base", "base", "--name", "out", "--out", str(tmp_path)]
    assert identify.main(given) == 0
    given = [model, "--base", "base", "--position", "-1", "1", "--starts", "1", "--iterations", "1", "--harmonics", "2"]
    assert excite.main([*given, "--seconds", "2", "--formats", "png", "--out", str(tmp_path / "moved")]) == 0
    evil = {".tex": r"\\(input|foo\b)", ".md": r"(?<!\\)[<$]", ".html": r"<script>[$a]|<i>"}
    for file in [*(tmp_path / "out").iterdir(), *(tmp_path / "moved").iterdir()]:
        if file.suffix in evil:
            assert not re.search(evil[file.suffix], file.read_text(encoding="utf-8")), file
