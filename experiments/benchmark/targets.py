"""Targets of the benchmark beside its results."""

from collections.abc import Mapping
from typing import Any

from experiments.benchmark import identification, monte_carlo
from experiments.benchmark.mechanisms import ARM, PENDULUM, TILTED, TREE
from experiments.data import paper
from experiments.document import tabular

Results = Mapping[str, Any]
"""Contents of `benchmark.json`."""

LARGE, FEW = 100_000, 10_000
"""Numbers of samples of the targets; the smaller one where `np.linalg.lstsq` has no memory for the larger."""

AT_LEAST: tuple[tuple[str, str, int, float | None, float], ...] = (
    (identification.REGRESSOR, PENDULUM, LARGE, 10, 12),
    (identification.REGRESSOR, TILTED, LARGE, 5, 7),
    (identification.REGRESSOR, ARM, LARGE, 5, 6),
    (identification.REGRESSOR, TREE, LARGE, 5, 6),
    (identification.AGAIN, PENDULUM, LARGE, None, 30),
    (identification.AGAIN, TILTED, LARGE, None, 12),
    (identification.AGAIN, ARM, LARGE, None, 11),
    (identification.AGAIN, TREE, LARGE, None, 10),
    (identification.ACCUMULATION, PENDULUM, LARGE, 7, 30),
    (identification.ACCUMULATION, TILTED, LARGE, 5, 20),
    (identification.ACCUMULATION, ARM, LARGE, 4, 12),
    (identification.ACCUMULATION, TREE, LARGE, 2.5, 5),
    (identification.ALL_COLUMNS, PENDULUM, LARGE, 20, 60),
    (identification.ALL_COLUMNS, TILTED, LARGE, 15, 45),
    (identification.ALL_COLUMNS, ARM, LARGE, 12, 30),
    (identification.ALL_COLUMNS, TREE, FEW, 8, 15),
    (identification.ALL_COLUMNS, PENDULUM, paper.SAMPLES, 5, 15),
    (monte_carlo.ALL_COLUMNS, PENDULUM, paper.SAMPLES, 6, 12),
)
"""Task, mechanism, number of samples, and the least ratio with numpy alone and with compiled code."""

NATIVE = 0.9
"""Least ratio of a recorded simulation's steps per second to a bare loop's."""

MEMORY = 6.0
"""Largest peak memory of an identification above its inputs, MB."""

ERROR = 2.0
"""Largest ratio of the error of ψ to that of LAPACK's Householder QR."""


def table_targets(results: Results) -> tabular.Table:
    """All targets beside the results; empty where this run did not measure one."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for task, mechanism, number, plain, compiled in AT_LEAST:
        what = f"ratio, {task}, {mechanism}, N = {number}"
        measured = _ratios(results, task, mechanism, number)
        for way, target, ratio in zip(("numpy", "compiled"), (plain, compiled), measured, strict=True):
            rows += [(f"{what}, {way}", "at least", float(target), ratio)] if target else []
    simulated = [row["ratio"] for row in results["simulations"] if row["task"] == "simulate"]
    peaks = [max(row["streamed"], row["in_memory"]) for row in results["peaks"]]
    errors = [row["ours"] / row["qr"] for row in results["accuracies"]]
    rows += [
        ("steps a second, recorded simulation to bare loop", "at least", NATIVE, max(simulated, default=None)),
        ("peak memory of a stream, MB", "at most", MEMORY, max(peaks, default=None)),
        ("error of the estimates to that of Householder's QR", "at most", ERROR, max(errors, default=None)),
    ]
    return tabular.Table("Targets", ("what", "bound", "wanted", "measured"), tuple(rows), decimals=2)


def missed(results: Results) -> list[str]:
    """Missed targets, in words."""
    sentences = []
    for what, bound, target, measured in table_targets(results).rows:
        if isinstance(target, float | int) and isinstance(measured, float | int):
            fails = measured < target if bound == "at least" else measured > target
            sentences += [f"Missed: {what}: {measured:.2f} where {bound} {target:g} is wanted"] * fails
    return sentences


def _ratios(results: Results, task: str, mechanism: str, number: int) -> tuple[float | None, float | None]:
    """Ratios of numpy alone and of compiled code; None where not measured."""
    for row in results["comparisons"]:
        if (row["task"], row["mechanism"], row["samples"]) == (task, mechanism, number):
            return (row["theirs"] / row["numpy"], row["ratio"]) if row["numpy"] else (row["ratio"], None)
    return None, None
