"""Digits, symbols and lines of what is shown."""

import re

import numpy as np
import pytest

from experiments.document import tabular
from experiments.document.symbols import pieces
from experiments.document.tabular import Table, columns, decimals_of, number
from experiments.document.terminal import WIDTH, wrapped
from experiments.document.writer import Card, Document


def test_two_digits_of_a_standard_deviation_are_printed_whatever_its_size():
    rng = np.random.default_rng(0)
    for std in 10.0 ** rng.uniform(-8, 5, 500):
        text = number(std, decimals_of(std))
        assert float(text) == pytest.approx(std, rel=0.051) and float(text) == float(f"{std:.1e}")
        assert len(text.replace(".", "").strip("0")) <= 2


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [
        (2.5187, 0.0312, ("2.519", "0.031")),
        (2.5187, 0.0996, ("2.52", "0.10")),
        (20.3, 12.4, ("20", "12")),
        (1234.0, 123.0, ("1230", "120")),
        (-0.0001, 0.031, ("-0.0001", "0.031")),
        (3.2e-7, 740.0, ("0.0000003", "740")),
        (0.0, 0.031, ("0.000", "0.031")),
        (-143123456.0, 224000.0, ("-1.4312e+08", "220000")),
        (2.5, 3.2e-15, ("2.500000000000", "3.2e-15")),
        (2.5, 0.0, ("2.500", "0")),
        (2.5, None, ("2.500", "")),
    ],
)
def test_an_estimate_ends_with_its_standard_deviation(value, std, shown):
    table = Table("t", ("name", "x", "std"), (("a", value, std),), deviations={"x": "std"})
    assert tuple(table.texts()[0][1:]) == shown
    assert table.csv().splitlines()[1] == f"a,{value},{'' if std is None else std}"


def test_only_sums_of_several_parameters_are_marked_and_noted():
    names, sums = ("m1", "m2rz2"), ("m1 + m2", "m2rz2")
    table = Table("t", *columns(parameter=names, x=(1.0, 2.0)), bodies=("a", "b"), regrouped={"": sums})
    assert table.remarks() == [("†", "Regrouped sums: m1 + m2.")]
    assert [row[0] for row in table.texts()] == ["m1† of a", "m2rz2 of b"]
    none = {"": names}
    assert not Table("t", *columns(parameter=names, x=(1.0, 2.0)), regrouped=none).remarks()


def shown(text):
    """Text with symbols between dollars and without indices."""
    return "".join(plain + "$" * bool(symbol) + "".join(map("".join, symbol)) for plain, symbol in pieces(text))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("m2rz2 + 0.425 m3", "$m2rz,2 + 0.425 $m3"),
        ("Ixy2 of link1 by +3.2", "$Ixy,2 of link1 by +3.2"),
        ("residuals in Fx, τz (0.1)", "residuals in $Fx, $τz (0.1)"),
        ("offset(Mx)", "offset($Mx)"),
        ("-π/2", "\N{MINUS SIGN}$π/2"),
        ("θ_1", "$θ1"),
        ("m2rz3, m2x, aFx, Fxy, 'Fx', theta, left_hand", "m2rz3, m2x, aFx, Fxy, 'Fx', theta, left_hand"),
        ("theta", "theta"),
        ("", ""),
    ],
)
def test_parameters_and_channels_become_symbols_and_names_stay(text, expected):
    assert shown(text) == expected


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
