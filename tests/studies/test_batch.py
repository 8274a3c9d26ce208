"""Many logs, each identified by itself: one table, failures by name, and nothing done twice."""

import errno
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import BrokenExecutor
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import driven_arm
import numpy as np
import pytest
from commands import entries_of, refusal
from stand_ins import Here

from experiments import batch, identify
from experiments.data.comparison import LogOutcome, agreement, spreads
from experiments.reports import batch_report
from experiments.runs import workers
from ident.files.atomic import PARTIAL, unwritten
from ident.mechanism.body import BASE, Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree

pytestmark = pytest.mark.usefixtures("undrawn")
OPTIONS = ["--estimator", "weighted", "--cutoff", "8", "--formats", "png"]
FIRST, BOTH = (["arm.xml", *logs, "--out", "out", *OPTIONS] for logs in (["run0.csv"], ["run0.csv", "run1.csv"]))
OUT = Path("out")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    out = tmp_path_factory.mktemp("recorded")
    (out / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    for seed in range(2):
        driven_arm.log(4.0, 50.0, seed=seed).save(out / f"run{seed}.csv")
    (out / "bad.csv").write_text("time,q\n0,1\n", encoding="utf-8")
    return out


@pytest.fixture(autouse=True)
def folder(recorded, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)
    monkeypatch.setattr(workers, "worker_pool", lambda number: nullcontext(Here()))


def logs():
    return entries_of(OUT / "batch.json")["logs"]


@pytest.mark.slow
def test_every_log_has_results_and_a_failure_is_a_row(capsys):
    assert batch.main(["arm.xml", "run0.csv", "bad.csv", "run1.csv", "--out", "out", *OPTIONS]) == 2
    shown = capsys.readouterr()
    assert "3 logs: " in shown.out and "error: 1 of 3 logs failed: bad.csv." in shown.err
    assert "bad.csv failed: a log needs at least" in shown.out.replace("\n", " ")
    first, bad, second = logs()
    assert bad["error"].startswith("bad.csv: a log needs at least 10 samples") and not bad["folder"]
    assert (first["folder"], second["folder"]) == ("run0", "run1") and second["verdict"] in ("usable", "not")
    # The same as of the command for one log.
    assert identify.main(["arm.xml", "run1.csv", "--out", "alone", "--name", "x", *OPTIONS[:-2]]) == 0
    assert entries_of(OUT / "run1" / "estimate.json") == entries_of(Path("alone/x/estimate.json"))
    files = ("report.html", "table_logs.csv", "table_parameters.csv")
    page, table, parameters = ((OUT / name).read_text(encoding="utf-8") for name in files)
    predicted, missed = len(second["predicted"]), len(second["missed"])
    assert {*second["predicted"], *second["missed"]} <= set(second["ratios"]) and predicted
    assert f"{predicted} of {predicted + missed}" in table
    assert (OUT / "run0" / "model.xml").exists() and not list((OUT / "run0").glob("*.pdf"))
    assert '<p class="verdict partly">' in page and "1: run0.csv" in page and "3: run1.csv" in page
    assert "Fc(bend),,2," in parameters and "m3rx3,fore,2," in parameters
    assert (OUT / "figure_logs.png").exists() and "The 2 logs agree within " in shown.out


def test_a_run_that_ends_early_goes_on_with_what_is_left(capsys, monkeypatch):
    """Ended by an interrupt, a dead worker, a full disk, and one without room even for the outcomes."""
    tries, one = [], batch.outcome_of

    def with_error(task, error=None):
        tries.append(task.name)
        if error and task.name == "run1":
            raise error
        return one(task)

    def unsaved(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    def full(task, out):
        with unwritten(out):
            unsaved()

    def ended(*options, code=2, error=None, **patches):
        """Error output of a run with an error in its second task, or other functions, which ends with a code."""
        with monkeypatch.context() as patched:
            patched.setattr(batch, "outcome_of", partial(with_error, error=error) if not patches else one)
            for name, replaced in patches.items():
                patched.setattr(identify, name, replaced)
            assert batch.main([*BOTH, *options]) == code
        return capsys.readouterr().err

    OUT.mkdir()
    page = OUT / "report.html"
    page.write_text("earlier", encoding="utf-8")
    assert "run again with --resume" in ended(error=KeyboardInterrupt(), code=130)
    shown = ended("--resume", error=BrokenExecutor())
    assert "error: run1.csv: A worker process died" in shown
    shown = ended("--resume", identified_from=full)
    assert "error: run1.csv: " in shown and "run1' could not be written (No space left on device)" in shown
    assert "run again with --resume" in shown and {errno.EDQUOT, errno.EFBIG, errno.EROFS} <= batch.FULL
    assert "logs failed" not in shown and page.read_text(encoding="utf-8") == "earlier"
    ended("--resume", code=0)
    assert tries == ["run0", "run1", "run1", "run1"] and [each["folder"] for each in logs()] == ["run0", "run1"]
    before = (OUT / batch.PROGRESS).read_bytes()
    with monkeypatch.context() as patched:
        patched.setattr(workers, "save_arrays", unsaved)
        assert "--resume" not in ended(error=batch.FullDiskError("run1.csv: full"))
    assert (OUT / batch.PROGRESS).read_bytes() == before
    assert "are of another run: options differ; leave out --resume" in ended("--resume", "--holdout", "0.3")
    driven_arm.log(4.0, 50.0, seed=5).save(Path("run1.csv"))
    assert "are of another run: files (run1.csv) differ" in ended("--resume")


def test_damaged_outcomes_are_not_resumed(capsys):
    args = batch.parser().parse_args(BOTH)
    identity = json.dumps(batch._identity(args, batch.check_shared(args)))
    done = LogOutcome("run0.csv", "run0", "usable").to_dict()
    OUT.mkdir()
    for text, reason in (
        (json.dumps(done)[:-20], "Unterminated string"),
        ("[]", "must be a mapping"),
        (json.dumps(done | {"more": 1}), "unexpected keyword argument 'more'"),
        (json.dumps(done | {"values": [1]}), "an outcome is damaged: values needs a mapping"),
    ):
        np.savez(OUT / batch.PROGRESS, identity=identity, outcomes=np.frombuffer(text.encode(), np.uint8))
        error = refusal(batch.main, [*BOTH, "--resume"], capsys)
        assert "--resume needs the logs of an earlier run in " in error and reason in error


def test_a_fault_of_the_program_is_a_row_as_well(capsys, monkeypatch):
    def faulty(task, out):
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(identify, "identified_from", faulty)
    assert batch.main(FIRST) == 2
    shown = capsys.readouterr().err
    assert "Traceback" in shown and "error: 1 of 1 logs failed: run0.csv." in shown
    assert logs()[0]["error"] == "This is a fault of multicontact: LinAlgError: singular"


@pytest.mark.slow
def test_results_that_are_not_as_they_were_written_are_done_again(monkeypatch):
    assert batch.main(BOTH) == 0
    file, other = (OUT / "run1" / name for name in ("estimate.json", "table_base_parameters.csv"))
    before = file.read_bytes()
    file.unlink()
    other.write_bytes(b"")
    # What others put there does not count.
    (OUT / "run0" / "note.txt").write_text("mine", encoding="utf-8")
    again, one = [], batch.outcome_of
    monkeypatch.setattr(batch, "outcome_of", lambda task: again.append(task.name) or one(task))
    for _ in range(2):
        assert batch.main([*BOTH, "--resume"]) == 0
        assert again == ["run1"] and len(file.read_bytes()) == pytest.approx(len(before), rel=0.01)
        assert other.read_bytes()


@pytest.mark.skipif(os.name != "posix", reason="needs locks of files")
def test_one_batch_at_a_time_writes_into_a_folder(capsys):
    hold = "import pathlib, ident.files.atomic as a\nwith a.alone(pathlib.Path('out')): print(1, flush=True); input()"
    OUT.mkdir()
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        assert batch.main(FIRST) == 2
        assert "Another run is writing into 'out'; wait until it has ended" in capsys.readouterr().err
        assert [path.name for path in OUT.iterdir()] == [f"{PARTIAL}running"]
        other.kill()
    assert batch.main(FIRST) == 0 and not list(OUT.glob(f"{PARTIAL}*"))


def test_the_spread_over_logs_tells_if_their_deviations_are_right():
    rng, given = np.random.default_rng(0), {"std": {"m1": 0.1}, "units": {"m1": "kg"}}
    outcomes = [LogOutcome(f"{k}", "x", values={"m1": 2 + 0.1 * rng.normal()}, **given) for k in range(400)]
    (spread,) = spreads([*outcomes, LogOutcome("bad", error="No.")])
    assert spread.logs == 400 and spread.unit == "kg" and abs(spread.mean - 2) < 3 * spread.std
    assert spread.std == pytest.approx(0.1 / 20) and spread.between == pytest.approx(0.1, rel=0.1)
    assert spread.rms_z == pytest.approx(1, rel=0.1)
    (alone,) = spreads(outcomes[:1])
    assert np.isnan(alone.between) and np.isnan(alone.rms_z) and alone.mean == outcomes[0].values["m1"]


NAMES = ("m1", "m2rz2", "Fc(hip)")
MIXED = np.array([[4.0, 1.9, 0.0], [1.9, 1.0, 0.0], [0.0, 0.0, 1e-12]]) * 1e-2


def drawn(rng, count, moved=(), std=1.0):
    """Logs around one truth, some of them with another second value, and the covariances that they state."""
    x = std * rng.multivariate_normal([20.0, 3.0, 1e-5], MIXED, count)
    x[list(moved), 1] += 1.0
    return [dict(zip(NAMES, each, strict=True)) for each in x.tolist()], [MIXED] * count


SHANK = Body("shank", BASE, np.eye(4), np.eye(6)[3], "hip")
LEG = Mechanism(Tree((Body("base", BASE, np.eye(4), np.zeros(6)), SHANK)), np.zeros(3))
GIVEN = {"std": dict.fromkeys(NAMES, 1.0), "units": dict.fromkeys(NAMES, "u")}


@pytest.mark.parametrize("moved", [(3,), (0, 4, 9, 12, 17), tuple(range(9))])
def test_logs_that_differ_are_named_with_what_they_differ_in(moved):
    values, covariances = drawn(np.random.default_rng(1), 20, moved)
    agreed = agreement(values, covariances)
    assert np.flatnonzero(agreed.differ).tolist() == list(moved) and agreed.spread < 1.5
    given = GIVEN | {"doubts": ["weight_differs", "setup_axis"]}
    outcomes = [LogOutcome(f"run{k}.csv", f"run{k}", "usable", values=x, **given) for k, x in enumerate(values)]
    failed = LogOutcome("bad.csv", error="bad.csv: no.")
    document = batch_report.document(Path("arm.xml"), [failed, *outcomes], agreed, LEG, {})
    (_, sentence, doubt), (_, failure, _) = document.findings
    assert failure == "bad.csv failed: no." and document.lines[-1].endswith("0 unusable, 1 failed.")
    assert doubt and f"{len(moved)} of 20 logs differ" in sentence.replace("differs", "differ")
    assert f" from the others: {', '.join(f'run{k}.csv' for k in moved)}. χ² is " in sentence
    assert "most in m2rz2 of shank by +" in sentence and "identify these logs apart" in sentence
    assert all(f"{k + 2}: run{k}.csv" in document.pictures[0] for k in moved)
    groups = document.tables["table_parameters"].groups()
    assert [(body, len(rows)) for body, _, rows in groups] == [("base", 1), ("shank", 2)]
    assert document.title == "arm.xml, identified from each of 21 logs"
    table = document.tables["table_logs"]
    assert "Weight differs; Set-up error: axis" in " ".join(table.markdown().split())
    assert ["m2rz2 of shank by +" in row for row in table.csv().splitlines()[2:]] == agreed.differ.tolist()
    numbers = document.numbers["batch"]["agreement"]["logs"]
    assert [name for name, each in numbers.items() if each["differs"]] == [f"run{k}.csv" for k in moved]


def test_what_all_logs_differ_by_is_said_of_all():
    agreed = agreement(*drawn(np.random.default_rng(2), 12, std=20.0))
    assert not agreed.differ.any() and agreed.spread > 10
    outcomes = [LogOutcome(f"{k}", f"{k}", "usable") for k in range(12)]
    sentence, doubt = batch_report.verdict(outcomes, agreed, ("base", "shank"))
    assert doubt == "Differ" and "differ from each other by" in sentence and "None stands out" in sentence


def test_copies_of_a_log_do_not_agree():
    values, covariances = drawn(np.random.default_rng(3), 3)
    values.append(values[1])
    agreed = agreement(values, [*covariances, MIXED])
    outcomes = [LogOutcome(f"run{k}", f"{k}", "usable", values=x, **GIVEN) for k, x in enumerate(values)]
    document = batch_report.document(Path("arm.xml"), outcomes, agreed, LEG, {})
    ((title, sentence, _),) = document.findings
    assert (document.headline.word, title) == ("Copies", "Copies of a log")
    assert sentence.startswith("run3 (as run1) has the estimate of another log but for rounding.")
    rounded = {name: x + 1e-12 for name, x in values[1].items()}
    outcomes[3] = LogOutcome("later", "3", "usable", values=rounded, std=dict.fromkeys(rounded, 1e-3))
    assert batch_report.verdict(outcomes, agreed, ("base", "shank"))[0].startswith("later (as run1) has")
    assert batch_report.verdict(outcomes[:3], agreement(values[:3], covariances), ("base", "shank"))[1] == ""
