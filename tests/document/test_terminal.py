"""Terminal output is never wider than the terminal, loses nothing, and is unchanged if it fits."""

import re

import pytest

from experiments.document import tabular
from experiments.document.document import Card, Document
from experiments.document.terminal import WIDTH, wrapped

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
