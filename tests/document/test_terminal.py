"""Terminal output is never wider than the terminal, loses nothing, and is unchanged if it fits."""

import re

import pytest

from experiments.document import tabular
from experiments.document.document import Card, Document
from experiments.document.terminal import WIDTH, table, wrapped

SUM = "m1" + "".join(f" + 0.0{k} m{k}rz{k} - Ixx{k}" for k in range(11, 60))


def words(lines):
    return " ".join(lines).split()


def test_long_sentences_break_below_what_they_begin_with():
    sentence = "word " * 60 + "end."
    short = "A line that fits stays  as it is."
    lines = wrapped(f"{short}\n  - {sentence}").split("\n")
    assert lines[0] == short and max(map(len, lines)) <= WIDTH
    assert lines[1].startswith("  - word") and all(re.match(r"    \S", line) for line in lines[2:])
    assert words(lines[1:]) == ["-", *sentence.split()]


def test_long_cells_break_and_a_factor_stays_beside_its_parameter():
    lines = table(
        ["parameter", "estimate", "regrouping"], [["m1", "1.5", SUM], ["m2", "22.5", "m2"]], [False, True, False]
    )
    assert max(map(len, lines)) <= WIDTH and "".join(words(lines[1:-1])) == "m11.5" + SUM.replace(" ", "")
    left = lines[0].index("regrouping")
    assert all(line[:left].strip() == "" for line in lines[2:-1]) and lines[-1].split() == ["m2", "22.5", "m2"]
    assert not any(re.search(r"( [-+]|0\.0\d\d?)$", line) for line in lines)


def test_columns_that_do_not_fit_stand_below_with_the_first():
    heads = ["channel", *(f"ratio, model {k} as it came" for k in range(20)), "note"]
    rows = [["Fx", *["1234.567"] * 20, ""], ["Fy", *["0.001"] * 20, "not explained by this motion"]]
    lines = table(heads, rows, [False, *[True] * 20, False])
    assert max(map(len, lines)) <= WIDTH and lines.count("") >= 1
    assert words(lines).count("1234.567") == words(lines).count("0.001") == 20
    parts = "\n".join(lines).split("\n\n")
    assert all("\nFy" in part for part in parts)
    # Below, rows that would be empty are left out.
    numbers = ["1"] * 8
    rows = [["Fx", *numbers, ""], ["Fy", *numbers, "y"]]
    alone = table(["channel", *["x" * 12] * 8, "note " * 12], rows, [False] * 10)
    assert sum(line.startswith("Fx") for line in alone) == sum(line.startswith("Fy") for line in alone) - 1


@pytest.mark.parametrize("cells", [("x", None), ("y", 2.0)])
def test_tables_and_their_titles_fit(cells):
    wide = tabular.Table("title " * 40, ("a", "b" * 40, "c", "d"), ((*cells, SUM, SUM),), footnote="note " * 40)
    assert max(map(len, wide.text().splitlines())) <= WIDTH


def test_doubts_stand_below_the_verdict_that_counts_them():
    shown = Document(
        verdict="Not usable as it is: one finding below speaks against it.",
        findings=[Card("Logs", "Logs disagree.", True), Card("More", "A remark.", False)],
        lines=["36 of 159."],
    ).text()
    assert shown.splitlines()[-3:] == [
        "Not usable as it is: one finding below speaks against it.",
        "  ! Logs disagree.",
        "36 of 159.",
    ]
