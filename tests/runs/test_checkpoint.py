import json

import pytest

from experiments.runs.workers import Checkpoint

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
