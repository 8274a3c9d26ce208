"""Tables, their digits, symbols and lines; folders of results, also on a full disk; spectra."""

import csv
import io
import os
import re
import signal
import sys
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import driven_arm
import numpy as np
import pytest
from commands import refusal
from jinja2 import DictLoader, Environment
from pages import PENDULUM
from scipy.signal import welch

import sim
from experiments import excite
from experiments.document import print_table, result_folder
from experiments.document.tabular import Table, columns, decimals_of, number
from experiments.document.typography import WIDTH, pieces, wrapped
from experiments.document.writer import Card, Document, _Compiled
from experiments.reports import identify_report
from experiments.runs.workers import Checkpoint
from ident import Recording
from ident.display import plots
from ident.files.atomic import PARTIAL, replacing


def test_csv_keeps_all_digits_and_other_forms_those_that_are_shown():
    table = Table("Errors, kg", *columns(parameter=["m_1", "Ixx2"], error=[-1e-9, 1 / 3], paper=[0.5, -2]))
    assert table.csv() == "parameter,error,paper\nm_1,-1e-09,0.5\nIxx2,0.3333333333333333,-2.0\n"
    assert table.markdown() == (
        "**Errors, kg**\n\n"
        "| parameter | error | paper |\n| --- | ---: | ---: |\n| m_1 | 0.000 | 0.500 |\n| Ixx2 | 0.333 | -2.000 |\n"
    )
    tex = print_table.tex(table)
    assert r"$m_1$ & 0.000 & 0.500 \\" in tex and r"\caption{Errors, kg.}" in tex
    assert r"\begin{tabular}{@{}lS[table-format=1.3]S[table-format=-1.3]@{}}" in tex
    assert tex.count(r"\begin") == tex.count(r"\end") == 3


def test_wide_tables_go_over_the_page_and_too_wide_ones_into_several():
    notes = {"marked": frozenset(["m2rz2"]), "footnote": "Why.", "notes": ("All.",), "bodies": ("a", "shank & foot")}
    rows = [("m1", 1.0, "m1 + 0.425 m3"), ("m2rz2", 2e6, "m2rz2 - 2 Ixy3")]
    one = print_table.tex(Table("t", ("parameter", "x", "regrouping"), rows, **notes), "t")
    assert one.count(r"\begin{table*}") == 1 and r"\item[*] Why." in one and r"\item All." in one
    assert r"of \emph{shank \& foot} & \unit{\kilo\gram\metre} & 2.00e+06 & $m_{2}r_{z,2} - 2\,I_{xy,3}$ \\" in one
    floats = print_table.tex(Table("t", ("name", *map(str, range(40))), [("a", *[1.5] * 40)]), "t")
    count = floats.count(r"\begin{table")
    assert count > 2 and floats.count(r"\label") == 1
    assert floats.count("continued") == floats.count(r"\addtocounter{table}{-1}") == count - 1
    assert print_table.tex(Table("t", ("name",), [(str(k),) for k in range(100)]), "t").count(r"\toprule") == 2


def test_columns_of_one_model_share_a_head_and_long_heads_have_lines():
    rows = [("a", 1.0, 2.0, 3.0, 4.0)]
    lines = print_table.tex(Table("t", ("name", "error_full", "std_full", "error_updated_model", "true_mm"), rows))
    updated, true = (
        rf"\shortstack[c]{{\rule{{0pt}}{{2.3ex}}{both}}}"
        for both in (r"Updated\\model", r"True\\(\unit{\milli\metre})")
    )
    assert lines.splitlines()[7:10] == [
        rf" & \multicolumn{{2}}{{c}}{{Full}} & \multicolumn{{1}}{{c}}{{{updated}}} &  \\",
        r"\cmidrule(lr){2-3}\cmidrule(lr){4-4}",
        rf"Name & {{Error}} & {{S.d.}} & {{Error}} & {{{true}}} \\",
    ]
    assert [r"\begin{figure*}" in print_table.figure("f", "c", width) for width in (3.5, 7.0)] == [False, True]


def test_headings_are_words_but_in_csv():
    for name, words in {
        "true_simplified": "true, simplified",
        "paper_error_full": "paper's error, full",
        "std_wrench_noise": "s.d. (wrench noise)",
        "predicted_std": "predicted s.d.",
        "coverage_95": "coverage, 95 %",
        "residual_rms": "residual RMS",
        "standard": "standard",
    }.items():
        table = Table("t", ("parameter", name), (("m1rx1", 1.0),))
        assert table.csv().startswith(f"parameter,{name}\n") and f"| parameter | {words} |" in table.markdown()
        assert table.text().splitlines()[1].split(maxsplit=1) == ["parameter", words]
        assert r"\_" not in print_table.tex(table) and "$m_{1}r_{x,1}$ & 1.000" in print_table.tex(table)


def written(folder, names="a", **options):
    with result_folder.results_folder(folder, **options) as temporary:
        for name in names:
            (temporary / name).write_text("second")


@pytest.mark.parametrize("obstacle", ["b", "summary"])
def test_a_folder_in_the_way_changes_nothing(tmp_path, obstacle):
    (tmp_path / obstacle).mkdir()
    (tmp_path / "a").write_text("first")
    with pytest.raises(ValueError, match=f"room for a file '{obstacle}'"):
        written(tmp_path, ["a", obstacle])
    assert (tmp_path / "a").read_text() == "first" and {path.name for path in tmp_path.iterdir()} == {"a", obstacle}


def test_outputs_of_an_earlier_run_do_not_stay_beside_new_ones(tmp_path):
    for name in ("notes.txt", "figure_2.svg", "table_4.csv", "monte_carlo.json"):
        (tmp_path / name).write_text("mine")
    written(tmp_path, ["a", "figure_2.png"], stale=result_folder.OUTPUTS)
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "a", "figure_2.png"}


@pytest.mark.parametrize("back", [True, False])
def test_files_that_cannot_be_replaced_are_put_back_or_else_kept_and_named(tmp_path, monkeypatch, back):
    (tmp_path / "a").write_text("first")
    replace, calls = Path.replace, count(1)

    def failing(path, target):
        number = next(calls)
        if number == 2 or (number > 2 and not back):
            raise OSError(5, "Input/output error", str(target))
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", failing)
    with pytest.raises(ValueError, match="could not be moved") as raised:
        written(tmp_path)
    monkeypatch.undo()
    (kept,) = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert kept.read_text() == "first" and (kept == tmp_path / "a") is back
    assert back or f"earlier files are in '{kept.parent}'" in str(raised.value)


def kill(*_, **__):
    os.kill(os.getpid(), signal.SIGKILL)


def write_and_die(out, where):
    """Writes results, and is killed within a file, before it moves the files, or after so many moves."""
    if where == "file":
        with replacing(out / "a") as temporary:
            temporary.write_text("half")
            kill()
    with result_folder.results_folder(out) as folder:
        for name in "ab":
            (folder / name).write_text("second")
        if where == "writing":
            kill()
        replace, moves = Path.replace, count()
        Path.replace = lambda path, target: kill() if next(moves) == int(where) else replace(path, target)
        result_folder.shutil.rmtree = kill


@pytest.mark.skipif(sys.platform == "win32", reason="this system has no locks on folders")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
@pytest.mark.parametrize("where", ["file", "writing", *"012345"])
def test_what_killed_runs_left_goes_with_the_next_one(tmp_path, where):
    for name in ("a", "b", ".partial-mine"):
        (tmp_path / name).write_text("first")
    child = os.fork()
    if child == 0:
        try:
            write_and_die(tmp_path, where)
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len(list(tmp_path.glob(f"{PARTIAL}*"))) == 1
    with result_folder.results_folder(tmp_path) as folder:
        # The fifth move ends all others.
        expected = dict.fromkeys("ab", "second" if where == "5" else "first")
        assert {name: (tmp_path / name).read_text() for name in "ab"} == expected
        (folder / "c").write_text("third")
    assert {path.name for path in tmp_path.iterdir()} == {*"abc", ".partial-mine"}


@pytest.mark.parametrize("name", ["=1+2", "+x()", "-x|y!A0", "@SUM(A1)", "\t=x"])
def test_names_are_no_formulas_of_spreadsheets(name):
    table = Table("t", ("parameter", name), (("m1", 1.0), (name, -2.5)), bodies=(name,))
    (first, *head), *rows = csv.reader(io.StringIO(table.csv()))
    assert (first, head) == ("parameter", ["body", f"'{name}"])
    assert rows == [["m1", f"'{name}", "1.0"], [f"'{name}", "", "-2.5"]]
    assert name.strip() in table.text()


@pytest.mark.parametrize("samples", [100, 511, 1777])
def test_spectra_are_welchs(samples):
    x = np.random.default_rng(0).normal(size=samples).cumsum()
    expected = welch(x, 50.0, nperseg=min(samples, 512))
    frequency, amplitude = plots.amplitude_spectrum(x, 50.0)
    np.testing.assert_allclose(frequency, expected[0])
    np.testing.assert_allclose(amplitude**2, expected[1], atol=1e-12 * expected[1].max())


ENDS = {
    (2.5187, 0.0312): ("2.519", "0.031"),
    (2.5187, 0.0996): ("2.52", "0.10"),
    (1234.0, 123.0): ("1230", "120"),
    (-0.0001, 0.031): ("-0.0001", "0.031"),
    (3.2e-7, 740.0): ("0.0000003", "740"),
    (0.0, 0.031): ("0.000", "0.031"),
    (-143123456.0, 224000.0): ("-1.4312e+08", "220000"),
    (2.5, 3.2e-15): ("2.500000000000", "3.2e-15"),
    (2.5, 0.0): ("2.500", "0"),
    (2.5, None): ("2.500", ""),
}


def test_an_estimate_ends_with_its_standard_deviation_which_has_two_digits():
    for (value, std), shown in ENDS.items():
        table = Table("t", ("name", "x", "std"), (("a", value, std),), deviations={"x": "std"})
        assert tuple(table.texts()[0][1:]) == shown
        assert table.csv().splitlines()[1] == f"a,{value},{'' if std is None else std}"
    for std in 10.0 ** np.random.default_rng(0).uniform(-8, 5, 500):
        text = number(std, decimals_of(std))
        assert float(text) == pytest.approx(std, rel=0.051) and float(text) == float(f"{std:.1e}")
        assert len(text.replace(".", "").strip("0")) <= 2


def test_only_sums_of_several_parameters_are_marked_and_noted():
    names, sums = ("m1", "m2rz2"), ("m1 + m2", "m2rz2")
    table = Table("t", *columns(parameter=names, x=(1.0, 2.0)), bodies=("a", "b"), regrouped={"": sums})
    assert table.remarks() == [("†", "Regrouped sums: m1 + m2.")]
    assert [row[0] for row in table.texts()] == ["m1† of a", "m2rz2 of b"]
    assert not Table("t", *columns(parameter=names, x=(1.0, 2.0)), regrouped={"": names}).remarks()


def test_ratios_of_the_updated_model_are_with_the_drives_that_its_file_lacks(monkeypatch):
    result, heads = driven_arm.quick(), {"model.urdf": "ratio, updated model*", "model.xml": "ratio, updated model"}
    for file, head in heads.items():
        monkeypatch.setattr(identify_report, "updated_file", lambda _, file=file: file)
        table = identify_report.quality_table(result)
        noted = "With all drives beside its bodies. model.urdf cannot hold Ia(bend), K(lift)." * head.endswith("*")
        assert head in table.headings() and table.footnote == noted


def test_parameters_and_channels_become_symbols_and_names_stay():
    for text, expected in {
        "m2rz2 + 0.425 m3": "$m2rz,2 + 0.425 $m3",
        "Ixy2 of link1 by +3.2": "$Ixy,2 of link1 by +3.2",
        "residuals in Fx, τz (0.1)": "residuals in $Fx, $τz (0.1)",
        "offset(Mx)": "offset($Mx)",
        "-π/2": "\N{MINUS SIGN}$π/2",
        "θ_1": "$θ1",
        "m2rz3, m2x, aFx, Fxy, 'Fx', theta, left_hand": "m2rz3, m2x, aFx, Fxy, 'Fx', theta, left_hand",
        "": "",
    }.items():
        # Symbols stand here after dollars and without indices.
        shown = (plain + "$" * bool(symbol) + "".join(map("".join, symbol)) for plain, symbol in pieces(text))
        assert "".join(shown) == expected


def test_long_sentences_and_tables_fit_and_break_below_what_they_begin_with():
    short, sentence = "A line that fits stays  as it is.", "word " * 60 + "end."
    first, *lines = wrapped(f"{short}\n  - {sentence}").split("\n")
    assert first == short and max(map(len, lines)) <= WIDTH and " ".join(lines).split() == ["-", *sentence.split()]
    assert lines[0].startswith("  - word") and all(re.match(r"    \S", line) for line in lines[1:])
    sums = "m1" + "".join(f" + 0.0{k} m{k}rz{k} - Ixx{k}" for k in range(11, 60))
    for cells in (("x", None), ("y", 2.0)):
        wide = Table("title " * 40, ("a", "b" * 40, "c", "d"), ((*cells, sums, sums),), footnote="note " * 40)
        assert max(map(len, wide.text().splitlines())) <= WIDTH


def test_doubts_stand_below_the_verdict_that_counts_them():
    verdict = "Not usable as it is: one finding below speaks against it."
    findings = [Card("Logs", "Logs disagree.", True), Card("More", "A remark.", False)]
    shown = Document(verdict=verdict, findings=findings, lines=["36 of 159."]).text()
    assert shown.splitlines()[-3:] == [verdict, "  ! Logs disagree.", "36 of 159."]


WRITTEN = r"could not be written .* and is as it was; make room or write elsewhere, and run again\."


@contextmanager
def limited(size):
    resource = pytest.importorskip("resource", reason="this system has no limits on files")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    # A module that is imported meanwhile must not be cached incompletely.
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        sys.dont_write_bytecode = before


def contents(folder):
    return {str(path.relative_to(folder)): path.is_file() and path.read_bytes() for path in folder.rglob("*")}


def save_recording(path):
    Recording(np.arange(500.0), {"a": np.random.default_rng(0).normal(size=(500, 3))}).save(path)


def save_trials(path):
    Checkpoint("trials", path, {"seed": 0}).collect([dict.fromkeys(range(20), str([0.5] * 52))], [""] * 20)


def save_model(path):
    sim.write_model(path, sim.mechanism(PENDULUM, "base"), sim.mechanism(PENDULUM, "base").known)


@pytest.mark.parametrize(
    ("write", "name"),
    [(save_recording, "r.csv"), (save_recording, "r.npz"), (save_trials, "trials.npz"), (save_model, "m.xml")],
)
def test_a_file_that_does_not_fit_leaves_the_old_one(tmp_path, write, name):
    path = tmp_path / name
    path.write_text("earlier")
    with limited(1000), pytest.raises(OSError, match=rf"^'{path}' {WRITTEN}"):
        write(path)
    assert contents(tmp_path) == {name: b"earlier"}
    write(path)
    assert path.stat().st_size > 1000


@pytest.mark.usefixtures("undrawn")
def test_a_command_ends_in_a_sentence_and_goes_through_once_there_is_room(tmp_path, capsys):
    out = tmp_path / "new" / "results"
    options = ["double_pendulum", "--starts", "1", "--iterations", "1", "--formats", "png", "--out", str(out)]
    with limited(4000):
        error = refusal(excite.main, options, capsys)
    assert f"error: '{out}' could not be written (" in error and contents(tmp_path) == {}
    assert excite.main(options) == 0
    before = contents(tmp_path)
    with limited(4000):
        refusal(excite.main, options, capsys)
    assert contents(tmp_path) == before


def test_a_compiled_template_that_was_cut_off_is_compiled_again(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    loader = DictLoader({"a": "{{ 1 + 1 }}"})
    for cut in (60, 0, None):
        kept = _Compiled(str(tmp_path), "%s.jinja")
        assert Environment(bytecode_cache=kept, loader=loader, autoescape=True).get_template("a").render() == "2"
        (path,) = tmp_path.glob("*.jinja")
        whole = path.read_bytes()
        path.write_bytes(whole[:cut])
