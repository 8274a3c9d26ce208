"""What the benchmark should show, beside what it has shown."""

from collections.abc import Mapping
from typing import Any

from experiments.benchmark import identification, monte_carlo
from experiments.benchmark.mechanisms import ARM, PENDULUM, TREE
from experiments.output import report
from experiments.studies import paper

Results = Mapping[str, Any]
"""What `benchmark.json` holds."""

AT_LEAST: tuple[tuple[str, str, int, float, float | None], ...] = (
    (identification.REGRESSOR, PENDULUM, 100_000, 3, 5),
    (identification.REGRESSOR, ARM, 100_000, 4, None),
    (identification.REGRESSOR, TREE, 100_000, 3.5, None),
    (identification.ACCUMULATION, PENDULUM, 100_000, 4, 6),
    (identification.ALL_COLUMNS, PENDULUM, 100_000, 10, 15),
    (identification.BASE_COLUMNS, PENDULUM, 100_000, 5, 8),
    *((task, PENDULUM, number, 1.5, 3.0) for number in (1000, paper.SAMPLES) for task in identification.TASKS),
    *((task, PENDULUM, paper.SAMPLES, 5, None) for task in monte_carlo.TASKS),
)
"""Task, mechanism and number of samples of a comparison, the ratio that it should reach at least, and a better one."""

NATIVE = 0.9
"""Steps a second of a recorded simulation, at least, against a bare loop of them."""

MEMORY = 10.0
"""Peak memory of an identification above its inputs, at most, MB."""

ERROR = 10.0
"""Error of ψ, at most, against that of LAPACK's Householder QR."""


def table_targets(results: Results) -> report.Table:
    """Every target beside what was measured; empty where this run did not measure it."""
    rows: list[tuple[report.Cell, ...]] = []
    for task, mechanism, number, required, better in AT_LEAST:
        measured = _ratio(results, task, mechanism, number)
        rows.append((f"ratio, {task}, {mechanism}, N = {number}", "at least", required, better, measured))
    simulated = [row["ratio"] for row in results["simulations"] if row["task"] == "simulate"]
    peaks = [max(row["streamed"], row["in_memory"]) for row in results["peaks"]]
    errors = [row["ours"] / row["qr"] for row in results["accuracies"]]
    rows += [
        ("steps a second, recorded simulation to bare loop", "at least", NATIVE, None, max(simulated, default=None)),
        ("peak memory of a stream, MB", "at most", MEMORY, None, max(peaks, default=None)),
        ("error of the estimates to that of Householder's QR", "at most", ERROR, None, max(errors, default=None)),
    ]
    return report.Table("Targets", ("what", "bound", "required", "better", "measured"), tuple(rows), decimals=2)


def missed(results: Results) -> list[str]:
    """Targets that were measured and missed, in words."""
    found = []
    for what, bound, required, _, measured in table_targets(results).rows:
        if isinstance(required, float | int) and isinstance(measured, float | int):
            fails = measured < required if bound == "at least" else measured > required
            found += [f"Missed: {what}: {measured:.2f} where {bound} {required:g} is wanted"] * fails
    return found


def _ratio(results: Results, task: str, mechanism: str, number: int) -> float | None:
    which = (task, mechanism, number)
    found = (row for row in results["comparisons"] if (row["task"], row["mechanism"], row["samples"]) == which)
    return min((row["ratio"] for row in found), default=None)
