import json
import re

import numpy as np
import pytest

from experiments.runs.checkpoint import Checkpoint

OUTCOMES = [json.dumps([k, k**2]) for k in range(6)]


def batches(outcomes, size=2):
    return [outcomes[k : k + size] for k in range(0, len(outcomes), size)]


def failing(outcomes, error):
    yield from batches(outcomes)
    raise error


@pytest.fixture
def run(tmp_path):
    return Checkpoint("runs", tmp_path / "runs.npz", {"seed": 1, "scale": (0.5, 1)})


def test_outcomes_are_kept_as_they_came(run):
    assert run.collect(batches(OUTCOMES), 6) == OUTCOMES
    assert run.done() == OUTCOMES


@pytest.mark.parametrize("error", [ValueError("refused"), KeyboardInterrupt(), MemoryError()])
def test_whatever_fails_the_outcomes_are_kept(run, capsys, error):
    with pytest.raises(type(error)):
        run.collect(failing(OUTCOMES[:4], error), 6)
    assert run.done() == OUTCOMES[:4]
    assert f"The runs done so far are in {run.file}; run again with --resume" in capsys.readouterr().err
    assert run.collect(batches(OUTCOMES[4:]), 6, done=run.done()) == OUTCOMES
    assert run.done() == OUTCOMES


def test_a_run_that_has_done_nothing_promises_nothing(run, capsys):
    with pytest.raises(ValueError, match="refused"):
        run.collect(failing([], ValueError("refused")), 6)
    assert not run.file.exists()
    assert "--resume" not in capsys.readouterr().err


def test_a_full_disk_leaves_what_was_saved_before(run, capsys, monkeypatch):
    monkeypatch.setattr("experiments.runs.checkpoint.SAVE_EVERY", 0)
    savez, saved = np.savez, []

    def full(*args, **named):
        saved.append(len(bytes(named["outcomes"]).splitlines()))
        if saved[-1] > 2:
            raise OSError(28, "No space left on device")
        savez(*args, **named)

    with monkeypatch.context() as patched:
        patched.setattr(np, "savez", full)
        with pytest.raises(OSError, match=r"runs\.npz' could not be written \(No space left on device\)"):
            run.collect(batches(OUTCOMES), 6)
    assert saved == [2, 4, 4]
    assert run.done() == OUTCOMES[:2]
    assert [file.name for file in run.file.parent.iterdir()] == ["runs.npz"]
    assert "--resume" in capsys.readouterr().err
    assert run.collect(batches(OUTCOMES[2:]), 6, done=run.done()) == OUTCOMES


def test_an_earlier_run_is_set_aside(run):
    run.collect(batches(OUTCOMES), 6)
    run.collect(batches(OUTCOMES[:2]), 2)
    assert run.done() == OUTCOMES[:2]
    before = Checkpoint("runs", run.file.with_stem("runs_before"), run.identity)
    assert before.done() == OUTCOMES


@pytest.mark.parametrize(
    ("changed", "message"),
    [([3], "files (log3.csv) differ"), (range(1, 8), "files (log1.csv, log2.csv, log3.csv and 4 more) differ")],
)
def test_differing_files_are_named(tmp_path, changed, message):
    files = [{"file": f"log{k}.csv", "sha256": "a"} for k in range(9)]
    run = Checkpoint("logs", tmp_path / "logs.npz", {"files": files})
    run.collect(batches(OUTCOMES), 6)
    other = [each | {"sha256": "b"} if k in changed else each for k, each in enumerate(files)]
    with pytest.raises(ValueError, match=re.escape(message)):
        Checkpoint("logs", run.file, {"files": other}).done()


def test_another_run_is_not_resumed(run):
    run.collect(batches(OUTCOMES), 6)
    with pytest.raises(ValueError, match="are of another run: seed, more differ"):
        Checkpoint("runs", run.file, run.identity | {"seed": 2, "more": 0, "scale": [0.5, 1]}).done()
