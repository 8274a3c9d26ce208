"""A quick run of the benchmark: everything is measured and compared. No time is asserted."""

import json

import numpy as np
import pytest
from quick_benchmark import written as benchmark

from experiments.benchmark import identification, monte_carlo, sections, tables, whole, words
from experiments.benchmark.mechanisms import mechanisms

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("benchmark")
    assert benchmark("--formats", "png", "--out", str(out)) == 0
    written = json.loads((out / sections.FILE).read_text(encoding="utf-8"))
    for name in [name for name, table in tables.tables(written).items() if table.rows]:
        for suffix in ("csv", "md", "tex"):
            assert (out / f"{name}.{suffix}").stat().st_size
    assert (out / "figure_benchmark.png").exists() == bool(written["comparisons"])
    return written


def numbers(node):
    if isinstance(node, dict):
        node = list(node.values())
    if isinstance(node, list):
        return [x for part in node for x in numbers(part)]
    return [node] if isinstance(node, float) else []


def test_a_quick_run_measures_everything(results):
    assert np.isfinite(numbers(results)).all()
    assert min(numbers([results[key] for key in ("simulations", "jobs")])) > 0
    assert [row["threads"] for row in results["simulations"]] == [1, 1, 2]
    assert [row["job"] for row in results["jobs"]] == [whole.STREAM, whole.REGROUPING, whole.LINEARISATION]
    assert results["machine"]["cores"] >= 1
    assert results["machine"]["blas_threads"] == "1"
    assert set(results["machine"]["versions"]) >= {"python", "numpy", "mujoco"}


def test_a_quick_run_compares_every_task_on_every_mechanism(results):
    pytest.importorskip("pinocchio", reason="Pinocchio is in the extra 'peers'")
    compared = {(row["task"], row["mechanism"]) for row in results["comparisons"]}
    assert compared >= {(task, m.name) for task in identification.TASKS for m in mechanisms()}
    assert compared >= {(task, "double pendulum") for task in monte_carlo.TASKS}
    for row in results["comparisons"]:
        assert row["ratio"] == pytest.approx(row["theirs"] / row["ours"])
        assert 0 < row["lowest"] <= row["highest"]
    assert not results["notes"]


def test_results_are_shown_without_anything_to_compare_with(results):
    alone = results | {"comparisons": []}
    assert all(table.text() for table in tables.tables(alone).values())
    assert "recorded simulations" in " ".join(words.findings(alone))
    for shown in (tables.table_overview, words.readme_block):
        with pytest.raises(ValueError, match="extra 'peers'"):
            shown(alone)
