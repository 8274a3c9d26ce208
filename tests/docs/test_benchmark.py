"""The benchmark runs and compares equal results. No time is asserted."""

import json

import numpy as np
import pytest

from docs.tools import benchmark
from docs.tools.mechanisms import Pinocchio, mechanisms
from ident.parameters.base_parameters import STANDARD_GRAVITY


@pytest.mark.parametrize(("numpy", "shown"), [(2e-3, "20.0 (10.0) of 20 µs"), (None, "20.0 of 20 µs")])
def test_what_the_peer_takes_stands_beside_each_ratio(numpy, shown):
    row = {"task": benchmark.REGRESSOR, "mechanism": "tree", "bodies": 8, "samples": 1000, "ours": 1e-3}
    results = {"machine": "M", "rows": [row | {"theirs": 2e-2, "ratio": 20.0, "numpy": numpy}]}
    assert f"| tree | 8 | 1,000 | {shown} |" in benchmark.markdown(results)


@pytest.mark.extras
@pytest.mark.parametrize("mechanism", mechanisms(), ids=lambda mechanism: mechanism.name)
def test_peers_have_the_same_regressor(mechanism):
    pytest.importorskip("pinocchio", reason="Pinocchio is in the extra 'peers'")
    samples = mechanism.samples(20)
    other = Pinocchio(mechanism.tree, STANDARD_GRAVITY)
    Y = other.regressor(*other.states(samples.motion.states, samples.motion.base))
    own = mechanism.regressor(samples)
    np.testing.assert_allclose(Y[..., other.columns(range(own.shape[2]))], own, rtol=0, atol=1e-12 * abs(own).max())


def test_what_differs_is_not_timed():
    with pytest.raises(ValueError, match=r"arms: results differ by 5\.0e-01"):
        benchmark.check_agreement("arms", np.array([1.0, 2.0]), np.array([1.0, 4.0]))
    with pytest.raises(ValueError, match="nan"):
        benchmark.check_agreement("arms", np.array([np.nan]), np.array([1.0]))


@pytest.mark.slow
def test_a_quick_run_measures_everything(tmp_path, capsys):
    benchmark.main(["--quick", "--out", str(tmp_path / "benchmark.json")])
    results = json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))
    tasks = [row["task"] for row in results["rows"]]
    assert tasks[-5:] == [
        "simulate",
        "simulate_many, threads: 1",
        "simulate_many, threads: 2",
        "base parameters",
        "linearisation",
    ]
    for row in results["rows"]:
        assert row["ratio"] == pytest.approx(row["theirs"] / row["ours"]) and 0 < row["lowest"] <= row["highest"]
    if len(tasks) > 5:
        compared = {(row["task"], row["mechanism"]) for row in results["rows"]}
        assert compared >= {(task, m.name) for task in benchmark.TASKS for m in mechanisms()}
    assert "linearisation" in capsys.readouterr().out
