"""Findings of the benchmark as text, for the terminal and docs/speed.md, from the contents of `benchmark.json`."""

from collections.abc import Iterator

from experiments.benchmark import identification, monte_carlo
from experiments.benchmark.mechanisms import PENDULUM
from experiments.benchmark.tables import Results, table_overview

EMPTY = (
    "Empty: not compared; np.linalg.lstsq would take minutes there, and a stream of pieces has its accumulation only"
)


def readme_block(results: Results) -> str:
    """Generated part of docs/speed.md: machine, table, explanation of its columns, and other findings.

    Raises:
        InputError: Nothing was compared.
    """
    both = any(row.get("numpy") for row in results["comparisons"])
    brackets = ", in brackets without compiled code" if both else ""
    tasks = [f"*{task}*: {what}" for task, what in identification.TASKS.items()]
    return "\n".join(
        [
            f"Measured on {machine(results)}. Times of the loop over times of ours{brackets}, "
            "and what the loop takes a sample:\n",
            table_overview(results).markdown(),
            *(f"- {line}." for line in (*tasks, EMPTY, *findings(results))),
            "",
        ]
    )


def machine(results: Results) -> str:
    """Description of the machine in one line."""
    computer = results["machine"]
    memory = f", {computer['memory_gb']:.0f} GB" if computer["memory_gb"] else ""
    versions = ", ".join(f"{name} {version}" for name, version in computer["versions"].items())
    where = f"{computer['processor']}, {computer['cores']} cores{memory}, {computer['system']}"
    return f"{where}; {versions}; {computer['blas']} with one thread"


def findings(results: Results) -> list[str]:
    """Findings of the tables, a line for each."""
    return [
        *_times(results),
        *_trials(results),
        _simulations(results),
        *_jobs(results),
    ]


def _times(results: Results) -> Iterator[str]:
    """Times behind the ratios, at the largest number of samples for which all tasks were compared."""
    rows = [row for row in results["comparisons"] if row["mechanism"] == PENDULUM]
    largest = max((row["samples"] for row in rows if row["task"] == identification.BASE_COLUMNS), default=0)
    for row in rows:
        if row["samples"] == largest and row["task"] in (identification.REGRESSOR, identification.ALL_COLUMNS):
            ours, theirs = (1e6 * row[key] / largest for key in ("ours", "theirs"))
            yield f"{row['task']}, {PENDULUM}, {largest:,} samples: {ours:.2f} µs a sample against {theirs:.2f} µs"


def _trials(results: Results) -> Iterator[str]:
    for row in results["comparisons"]:
        if row["task"] in monte_carlo.TASKS:
            yield (
                f"{row['task']} ({monte_carlo.TASKS[row['task']]}): {row['ratio']:.1f} times as many trials, "
                f"{1 / row['ours']:.0f} a second of {row['samples']} samples"
            )


def _simulations(results: Results) -> str:
    rates = ", ".join(
        f"{row['ratio']:.2f} of it with `{row['task']}` in {row['threads']} thread{'s' * (row['threads'] > 1)}"
        for row in results["simulations"]
    )
    native = results["simulations"][0]["native"] / 1e3
    return f"recorded simulations: a bare loop makes {native:.0f} thousand steps a second; {rates}"


def _jobs(results: Results) -> Iterator[str]:
    for row in results.get("jobs", ()):
        yield f"{row['job']}, {row['size']:,}: {row['ratio']:.2g} of the time of {row['beside']}, {row['ours']:.2g} s"
