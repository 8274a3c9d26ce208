import csv
import io
import json
import subprocess
import sys
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from mechanisms import random_tree
from scipy import signal

from experiments.document import print_table, provenance, result_folder, tabular
from experiments.reports import identify_figures
from ident.files.atomic import PARTIAL, replacing

TABLE = tabular.Table(
    "Errors, kg",
    *tabular.columns(parameter=["m_1", "Ixx2"], error=[-1e-9, 1 / 3], paper=[0.5, -2]),
)


def test_csv_keeps_all_digits():
    assert TABLE.csv() == "parameter,error,paper\nm_1,-1e-09,0.5\nIxx2,0.3333333333333333,-2.0\n"


def test_markdown():
    assert TABLE.markdown() == (
        "**Errors, kg**\n\n"
        "| parameter | error | paper |\n| --- | ---: | ---: |\n| m_1 | 0.000 | 0.500 |\n| Ixx2 | 0.333 | -2.000 |\n"
    )


def test_tex_is_escaped_and_complete():
    tex = print_table.tex(TABLE)
    assert r"$m_1$ & 0.000 & 0.500 \\" in tex
    assert r"\caption{Errors, kg.}" in tex
    assert r"\begin{tabular}{@{}lS[table-format=1.3]S[table-format=-1.3]@{}}" in tex
    assert tex.count(r"\begin") == tex.count(r"\end") == 3


def test_axes_of_joint_torques_have_units():
    tree = random_tree(np.random.default_rng(0), 12, kinds=("revolute", "prismatic", "ball"))
    prepared = SimpleNamespace(mechanism=SimpleNamespace(tree=tree))
    result = SimpleNamespace(prepared=prepared, channels=("Mz", *tree.freedoms))
    labels = [identify_figures._label(result, k, "/√Hz") for k in range(len(tree.freedoms) + 1)]
    units = ["N m" if body.twist[3:].any() else "N" for body in tree.bodies for _ in body.motions.T]
    assert {*units} == {"N", "N m"} and any(name.endswith(".z") for name in tree.freedoms)
    expected = [f"{name}\n({unit}/√Hz)" for name, unit in zip(tree.freedoms, units, strict=True)]
    assert labels == ["$M_z$ (N m/√Hz)", *expected]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("true_simplified", "true, simplified"),
        ("paper_error_full", "paper's error, full"),
        ("std_wrench_noise", "s.d. (wrench noise)"),
        ("predicted_std", "predicted s.d."),
        ("axis_std_deg", "axis s.d. (deg)"),
        ("coverage_95", "coverage, 95 %"),
        ("residual_rms", "residual RMS"),
        ("standard", "standard"),
        ("full", "full"),
    ],
)
def test_headings_are_words_but_in_csv(name, words):
    table = tabular.Table("t", ("parameter", name), (("m1rx1", 1.0),))
    assert table.csv().startswith(f"parameter,{name}\n")
    assert f"| parameter | {words} |" in table.markdown()
    assert table.text().splitlines()[1].split(maxsplit=1) == ["parameter", words]
    assert r"\_" not in print_table.tex(table) and "$m_{1}r_{x,1}$ & 1.000" in print_table.tex(table)


def test_long_headings_break_into_lines_in_tex():
    table = tabular.Table("t", ("std_wrench_noise", "peak_force_N"), ((1.0, 2.0),))
    stack = r"{\shortstack[c]{\rule{0pt}{2.3ex}"
    assert rf"{stack}S.d.\\(wrench\\noise)}}}} & {stack}Peak force\\(\unit{{\newton}})}}}} \\" in print_table.tex(table)


def test_huge_numbers_are_powers_of_ten():
    table = tabular.Table("t", ("a",), ((232976553.0,), (-1e6,), (999999.0,)))
    assert table.text().split()[2:] == ["2.33e+08", "-1.00e+06", "999999.000"]
    assert "232976553.0" in table.csv()


def test_text_is_aligned():
    assert TABLE.text() == (
        "Errors, kg\nparameter  error   paper\nm_1        0.000   0.500\nIxx2       0.333  -2.000\n"
    )


def test_empty_cells_stay_empty():
    table = tabular.Table("t", ("a", "b"), (("x", None), ("y", 2.0)))
    assert table.csv() == "a,b\nx,\ny,2.0\n"
    assert "| x |  |" in table.markdown()


def test_a_failing_block_changes_nothing(tmp_path):
    out = tmp_path / "out"
    with result_folder.results_folder(out) as folder:
        (folder / "a").write_text("first")

    def fail():
        with result_folder.results_folder(out) as folder:
            (folder / "a").write_text("second")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert [(file.name, file.read_text()) for file in out.iterdir()] == [("a", "first")]


def test_other_files_in_the_folder_are_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with result_folder.results_folder(tmp_path) as folder:
        (folder / "a").write_text("new")
    assert {file.name for file in tmp_path.iterdir()} == {"notes.txt", "a"}


def test_provenance_is_json(tmp_path):
    result_folder.write_json(tmp_path / "p.json", provenance.provenance({"seed": 1}, {"scene": "s"}))
    assert json.loads((tmp_path / "p.json").read_text())["options"] == {"seed": 1}


@pytest.mark.parametrize("obstacle", ["b", "summary"])
def test_a_folder_in_the_way_changes_nothing(tmp_path, obstacle):
    (tmp_path / obstacle).mkdir()
    (tmp_path / "a").write_text("first")

    def run():
        with result_folder.results_folder(tmp_path) as folder:
            for name in ("a", obstacle):
                (folder / name).write_text("second")

    with pytest.raises(ValueError, match=f"room for a file '{obstacle}'"):
        run()
    assert (tmp_path / "a").read_text() == "first"
    assert {path.name for path in tmp_path.iterdir()} == {"a", obstacle}


def test_a_move_that_fails_midway_is_undone(tmp_path, monkeypatch):
    for name in "abc":
        (tmp_path / name).write_text("first")
    replace = type(tmp_path).replace
    calls = []

    def failing(path, target):
        calls.append(path)
        if len(calls) == 5:
            raise OSError(28, "No space left on device", str(target))
        return replace(path, target)

    def run():
        with result_folder.results_folder(tmp_path, stale=["c"]) as folder:
            for name in "abd":
                (folder / name).write_text("second")
            monkeypatch.setattr(type(tmp_path), "replace", failing)

    with pytest.raises(ValueError, match="could not be moved"):
        run()
    monkeypatch.undo()
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys("abc", "first")


def test_files_that_cannot_be_put_back_are_kept_and_named(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("first")
    replace = type(tmp_path).replace
    calls = []

    def failing(path, target):
        calls.append(path)
        if len(calls) > 1:
            raise OSError(5, "Input/output error", str(target))
        return replace(path, target)

    def run():
        with result_folder.results_folder(tmp_path) as folder:
            (folder / "a").write_text("second")
            monkeypatch.setattr(type(tmp_path), "replace", failing)

    with pytest.raises(ValueError, match="could not be moved") as raised:
        run()
    monkeypatch.undo()
    (kept,) = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert kept.read_text() == "first"
    assert f"earlier files are in '{kept.parent}'" in str(raised.value)


def test_a_folder_that_cannot_be_made_leaves_none(tmp_path, monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(result_folder.tempfile, "mkdtemp", full)
    with pytest.raises(ValueError, match="No space left"), result_folder.results_folder(tmp_path / "a" / "b"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_provenance_is_of_this_repository_only(monkeypatch, tmp_path):
    monkeypatch.setenv("GIT_DIR", str(tmp_path))
    assert provenance.provenance({}, {})["git_commit"] != ""
    monkeypatch.delenv("GIT_DIR")
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "experiments" / "document" / "provenance.py"))
    assert provenance.provenance({}, {})["git_commit"] is None


def test_an_input_is_neither_replaced_nor_cleared_away(tmp_path):
    for name in ("a", "table_mine"):
        (tmp_path / name).write_text("input")
        with (
            pytest.raises(ValueError, match=f"would replace '{tmp_path / name}', which is the input"),
            result_folder.results_folder(tmp_path, stale=["table_*"], inputs=[tmp_path / name]) as folder,
        ):
            (folder / "a").write_text("result")
        assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: "input"}
        (tmp_path / name).unlink()


KILLED = """
import os, signal, sys
from pathlib import Path
from experiments.document import result_folder
from ident.files.atomic import PARTIAL, replacing

def stop(*_, **__):
    os.kill(os.getpid(), signal.SIGKILL)

def run(out, where):
    if where == "file":
        with replacing(out / "a") as temporary:
            temporary.write_text("half")
            stop()
    with result_folder.results_folder(out) as folder:
        for name in "ab":
            (folder / name).write_text("second")
        if where == "waiting":
            print("ready", flush=True)
            input()
        if where == "writing":
            stop()
        replace, calls = Path.replace, []
        def until(path, target):
            calls.append(path)
            return stop() if len(calls) > int(where) else replace(path, target)
        Path.replace, result_folder.shutil.rmtree = until, stop

for out in map(Path, sys.argv[1:]):
    if out.name == "waiting" or os.fork() == 0:
        run(out, out.name)
    _, status = os.wait()
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL
"""

needs_locks = pytest.mark.skipif(sys.platform == "win32", reason="this system has no locks on folders")


@needs_locks
def test_what_killed_runs_left_goes_with_the_next_one(tmp_path):
    folders = [tmp_path / where for where in ("file", "writing", *"012345")]
    for folder, name in product(folders, "ab"):
        folder.mkdir(exist_ok=True)
        (folder / name).write_text("first")
    (folders[0] / ".partial-mine").write_text("somebody else's")
    subprocess.run([sys.executable, "-c", KILLED, *map(str, folders)], check=True)
    for out in folders:
        assert len(list(out.glob(f"{PARTIAL}*"))) == 1
        with result_folder.results_folder(out) as folder:
            # The fifth move ends all others.
            expected = dict.fromkeys("ab", "second" if out.name == "5" else "first")
            assert {name: (out / name).read_text() for name in "ab"} == expected
            (folder / "c").write_text("third")
        (out / ".partial-mine").unlink(missing_ok=out != folders[0])
        assert {path.name for path in out.iterdir()} == set("abc")


@needs_locks
def test_what_belongs_to_a_run_that_is_alive_stays(tmp_path):
    out = tmp_path / "waiting"
    command = [sys.executable, "-c", KILLED, str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as alive:
        assert alive.stdout.readline() == b"ready\n"
        with result_folder.results_folder(out) as folder, replacing(out / "d") as temporary:
            (folder / "c").write_text("third")
            temporary.write_text("fourth")
        assert len(list(out.glob(f"{PARTIAL}*"))) == 1
        alive.kill()
    with replacing(out / "d") as temporary:
        temporary.write_text("fifth")
    with result_folder.results_folder(out):
        pass
    assert {path.name for path in out.iterdir()} == set("cd")


def test_columns_without_cells_are_in_the_csv_file_alone():
    table = tabular.Table("t", *tabular.columns(name=["a", "b"], empty=[None, np.nan], note=["", ""], x=[1.0, 2.0]))
    assert table.csv().startswith("name,empty,note,x\na,,,1.0\n")
    assert table.filled().columns == ("name", "x")
    for shown in (table.markdown(), table.text(), print_table.tex(table)):
        assert "mpty" not in shown and "2.000" in shown


@pytest.mark.parametrize("counts", [[3, 40], np.array([3, 40])])
def test_counts_have_no_decimals_unless_numbers_stand_beside_them(counts):
    table = tabular.Table("t", *tabular.columns(name=["a", "b"], count=counts, mixed=[True, 0.5]))
    assert table.texts() == [["a", "3", "1.000"], ["b", "40", "0.500"]] and table.numeric() == [False, True, True]
    assert "S[table-format=2.0]S[table-format=1.3]" in print_table.tex(table)


def test_first_cells_have_words_for_readers_and_names_in_the_csv_file():
    table = tabular.Table(
        "t", ("number", "x"), (("axis_error_deg", 1.0),), names={"axis_error_deg": "axis error (deg)"}
    )
    assert table.csv() == "number,x\naxis_error_deg,1.0\n"
    assert table.texts() == [["axis error (deg)", "1.000"]]


@pytest.mark.parametrize("name", ["=1+2", "+x()", "-x|y!A0", "@SUM(A1)", "\t=x"])
def test_names_are_no_formulas_of_spreadsheets(name):
    table = tabular.Table("t", ("parameter", name), (("m1", 1.0), (name, -2.5)), bodies=(name,))
    (first, *head), *rows = csv.reader(io.StringIO(table.csv()))
    assert (first, head) == ("parameter", ["body", f"'{name}"])
    assert rows == [["m1", f"'{name}", "1.0"], [f"'{name}", "", "-2.5"]]
    assert name.strip() in table.text()


@pytest.mark.parametrize("samples", [100, 511, 1777])
def test_spectra_are_welchs(samples):
    x = np.random.default_rng(0).normal(size=samples).cumsum()
    frequency, amplitude = identify_figures.amplitude_spectrum(x, 50.0)
    expected = signal.welch(x, 50.0, nperseg=min(samples, 512))
    np.testing.assert_array_equal(frequency, expected[0])
    np.testing.assert_allclose(amplitude**2, expected[1], atol=1e-12 * expected[1].max())
