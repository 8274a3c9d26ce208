"""Pages, and hostile names in them, read by readers of each format that are written for these tests."""

import re
from html.parser import HTMLParser

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from experiments import __main__ as index
from experiments.document import pictures, typography
from experiments.document.tabular import Table
from experiments.document.writer import Card, Document, Headline, Output, Plot, environment, written

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


class Cells(HTMLParser):
    def __init__(self):
        super().__init__()
        self.rows, self.tags, self.caption, self._into = [], [], "", None

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")
        self._into = tag if tag in ("th", "td", "caption") else self._into

    def handle_endtag(self, tag):
        self._into = None if tag == self._into else self._into

    def handle_data(self, data):
        if self._into == "caption":
            self.caption += data
        elif self._into:
            self.rows[-1][-1] += data


def read(table, folder):
    bars = {key: [pictures.Interval(EVIL[2], 0, 1.0, 0.1, 0.1, None)] for key in EVIL}
    drawn = [
        pictures.candidates(EVIL, {"estimate": np.full(len(EVIL), 0.1)}),
        pictures.parameters(bars, (), 1),
        pictures.curves(np.arange(9.0), {text: (np.zeros(9), np.ones(9)) for text in EVIL}),
    ]
    shown = Document(
        EVIL[2],
        EVIL[2],
        verdict=EVIL[2],
        findings=[Card(text, text, True) for text in EVIL],
        lines=EVIL,
        tables={"table": table},
        figures={"figure": Plot(lambda: Figure(figsize=(1, 1)), EVIL[2])},
        headline=Headline(EVIL[2], EVIL[2], "not"),
        pictures=drawn,
        numbers={"provenance": {"given": EVIL}},
    )
    written(shown, Output(folder, ["png"]))
    cells = Cells()
    cells.feed((folder / "report.html").read_bytes().decode())
    return cells


def test_hostile_texts_are_shown_and_do_nothing(tmp_path):
    for table, shown in (
        (Table(EVIL[2], ("what",), tuple((text,) for text in EVIL)), lambda page: [row[0] for row in page.rows[1:]]),
        (Table(EVIL[2], tuple(EVIL), (tuple(EVIL),)), lambda page: page.rows[-1]),
    ):
        page = read(table, tmp_path)
        assert page.tags.count("script") == 1 and page.caption.startswith(EVIL[2]) and shown(page) == EVIL


def test_rows_stand_in_groups_whose_heads_have_their_units(tmp_path):
    """A drive stands beside the body that its joint moves; sums are folded."""
    rows = (("m1", 2.0, "m1 + m2"), ("m2rz2", 1.0, "m2rz2"), ("Fc(a)", 0.5, ""), ("Fc(b) of log 2", 0.1, ""))
    names = {"bodies": ("arm", "hand"), "units": ("kg", "kg m", "N m", "N m"), "carriers": {"a": "arm", "b": "hand"}}
    table = Table("Title", ("parameter", "estimate", "regrouping"), rows, **names)
    assert table.groups() == [("arm", "kg, N m", [0, 2]), ("hand", "kg m, N m", [1, 3])]
    head, *shown = read(table, tmp_path).rows
    assert head == ["parameter", "estimate", "regrouping"]
    expected = ["arm kg, N m", "m1", "Fc(a)", "hand kg m, N m", "m2rz,2", "Fc(b) of log 2"]
    assert [row[0] for row in shown] == expected and (shown[1][2], shown[4][2]) == ("summ1 + m2", "")
    full = Table("t", ("body", "quantity", "unit", "x"), (("arm", "mass", "kg", 1.0), ("arm", "centre", "m", 2.0)))
    assert full.groups() == [("arm", "kg, m", [0, 1])] and read(full, tmp_path).rows[0] == ["quantity", "x"]
    alone = Table("t", ("channel", "x"), (("Fx", 1.0), ("Mx", 2.0)), units=("N", "N m"))
    assert alone.groups() == [("", "N", [0]), ("", "N m", [1])] and read(alone, tmp_path).rows[0] == ["channel", "x"]


def test_the_papers_columns_stand_alone_beside_ours():
    columns = ("name", "true_scene", "true_paper", "error", "paper_error", "std")
    table = Table("", columns, (("a", 1.0, 1.0, 0.123, 0.1, 9.0),), caption="Errors", digits={"paper_error": (1,)})
    shown = index.printed(table)
    assert shown.columns == ("name", "true_paper", "true_scene", "paper_error", "error") and shown.title == "Errors"
    assert shown.headings() == ["name", "true, paper", "true, ours", "error, paper", "error, ours"]
    assert shown.texts()[0][3:] == ["0.1", "0.1"]
    full = Table("", ("name", "error_full", "paper_error_full"), (("a", 3.0, 1.0), ("b", 1.0, None)))
    compared = index.compared(full)
    assert compared.columns[3:] == ("deviation_full",) and [row[3] for row in compared.rows] == [2.0, None]
    assert index.compared(compared).columns[:4] == compared.columns


def test_numbers_and_options_to_copy_are_as_typed():
    shown = environment().get_template("parts.html").make_module({}).prose("by -2, gain = -1, --base-rpy 0 -90 0")
    assert "by \u22122, gain = -1, <code" in shown and ">--base-rpy</code> 0 -90 0" in shown


TEXTS = st.one_of(st.text("\\{}$&#%_^~|[]*`<>!-ab \n", max_size=12), st.sampled_from(EVIL))

COMMANDS = dict(zip(("backslash", "asciitilde", "asciicircum", "less", "greater", "bar"), "\\~^<>|", strict=True))


def shown_by_tex(source):
    """Text that TeX typesets; any command raises an error."""
    out, rest = "", source
    while rest:
        if match := re.match(r"\\([&%$#_{}])|\\([a-z]+)\{\}|\{([\[*]?)\}|([^&%$#_{}~^\\])", rest):
            out += match[1] or (match[2] and COMMANDS[match[2].removeprefix("text")]) or match[3] or match[4] or ""
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


@settings(max_examples=150, deadline=None)
@given(TEXTS)
@example("_a_")
def test_all_letters_are_shown_and_none_is_acted_on(text):
    in_a_line = re.sub(r"[\n\r\t]+", " ", text)
    assert shown_by_tex(typography.tex(text)) == shown_by_markdown(typography.markdown(text)) == in_a_line
