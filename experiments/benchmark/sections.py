"""The sections of the benchmark, and the files of their results."""

import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from experiments.benchmark import identification, machine, monte_carlo, peers, simulation, whole, words
from experiments.benchmark.figure import figure_benchmark
from experiments.benchmark.tables import tables
from experiments.benchmark.timing import Effort
from experiments.document.document import Document
from experiments.runs.workers import worker_pool

FILE = "benchmark.json"
"""File in the output folder with all numbers."""


ABOUT = (
    "Times of regressor, identification, simulation and trials beside those of other ways to the same results, taken "
    "in turns in one process with one thread for linear algebra. Machines differ, and are noisy."
)
"""The page's description of the benchmark."""


def measured(effort: Effort) -> dict[str, Any]:
    """Contents of `benchmark.json` without the provenance.

    Raises:
        ValueError: Ours and theirs differ.
        DeadWorkerError: The process that measures died.
    """
    sections: dict[str, Callable[[Effort], dict[str, Any]]] = {
        "identification": _identification,
        "simulation": _simulation,
        "Monte Carlo": _monte_carlo,
        "whole jobs": _jobs,
    }
    results: dict[str, Any] = {"machine": machine.description(), "comparisons": [], "notes": []}
    with tqdm(total=len(sections), desc="Benchmark", file=sys.stderr) as bar, worker_pool(1) as pool:
        for name, section in sections.items():
            bar.set_postfix_str(name)
            for key, value in pool.executor.submit(section, effort).result().items():
                results[key] = results[key] + value if key in ("comparisons", "notes") else value
            bar.update()
    return results


def _identification(effort: Effort) -> dict[str, Any]:
    missing = peers.missing()
    rows = [] if missing else identification.comparisons(effort)
    return {"comparisons": [asdict(row) for row in rows], "notes": list(missing)}


def _simulation(effort: Effort) -> dict[str, Any]:
    return {"simulations": [asdict(row) for row in simulation.simulations(effort)]}


def _monte_carlo(effort: Effort) -> dict[str, Any]:
    rows = [] if peers.missing() else monte_carlo.comparisons(effort)
    return {"comparisons": [asdict(row) for row in rows]}


def _jobs(effort: Effort) -> dict[str, Any]:
    return {"jobs": [asdict(job) for job in whole.jobs(effort)]}


def document(results: dict[str, Any]) -> Document:
    """Tables, all numbers, and a figure if a library to compare with is installed."""
    caption = "Time a sample over the number of samples, and over the number of bodies, ours and a peer's."
    return Document(
        "How fast it is",
        ABOUT,
        lines=[f"Measured on {words.machine(results)}.", *words.findings(results), *results["notes"]],
        tables={name: table for name, table in tables(results).items() if table.rows},
        figures={"figure_benchmark": (figure_benchmark(results), caption)} if results["comparisons"] else {},
        numbers={Path(FILE).stem: results, "provenance": results["provenance"]},
    )
