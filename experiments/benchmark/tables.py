"""The benchmark's tables, from the contents of `benchmark.json`."""

from collections.abc import Iterable, Mapping
from typing import Any

from experiments.benchmark.identification import CHAIN, TASKS
from experiments.document.tabular import Cell, Table
from ident.errors import InputError

Results = Mapping[str, Any]
"""Contents of `benchmark.json`."""


def tables(results: Results) -> dict[str, Table]:
    """All tables by file name."""
    return {
        "table_ratios": table_ratios(results),
        "table_simulation": table_simulation(results),
        "table_jobs": table_jobs(results),
    }


def table_overview(results: Results) -> Table:
    """Ratios of all tasks, formatted by `_ratio`; a row for each mechanism and number of samples.

    Raises:
        InputError: Nothing was compared.
    """
    compared = [row for row in results["comparisons"] if row["task"] in TASKS and row["mechanism"] != CHAIN]
    if not compared:
        raise InputError("This table needs results of a benchmark with a library to compare with (extra 'peers').")
    ratios: dict[tuple[str, int, int], dict[str, Cell]] = {}
    for row in compared:
        ratios.setdefault((row["mechanism"], row["bodies"], row["samples"]), {})[row["task"]] = _ratio(row)
    order = list(dict.fromkeys(mechanism for mechanism, *_ in ratios))
    rows = (
        (mechanism, str(bodies), f"{samples:,}", *map(ratios[mechanism, bodies, samples].get, TASKS))
        for mechanism, bodies, samples in sorted(ratios, key=lambda key: (order.index(key[0]), key[2]))
    )
    return Table("", ("mechanism", "bodies", "samples", *TASKS), tuple(rows), decimals=1)


def _ratio(row: Mapping[str, Any]) -> str:
    """A ratio, in brackets the ratio without compiled code, and the peer's time per sample, on which both depend."""
    alone = "" if row.get("numpy") is None else f" ({row['theirs'] / row['numpy']:.1f})"
    return f"{row['ratio']:.1f}{alone} of {1e6 * row['theirs'] / row['samples']:.3g} µs"


def table_ratios(results: Results) -> Table:
    """All comparisons with their spread."""
    return _table(
        "Times a sample in microseconds, medians; their ratios, and the extremes of neighbouring repetitions",
        ("task", "mechanism", "bodies", "N", "peer", "ours", "theirs", "numpy alone", "ratio", "lowest", "highest"),
        (
            (
                *_cells(row, "task mechanism bodies samples peer"),
                *(time and 1e6 * time / row["samples"] for time in (row["ours"], row["theirs"], row.get("numpy"))),
                *_numbers(row, "ratio lowest highest"),
            )
            for row in results["comparisons"]
        ),
    )


def table_simulation(results: Results) -> Table:
    """Rates of recorded simulations beside the bare loop."""
    return _table(
        "Thousand steps a second of recorded simulations, and of a bare loop of mj_step in one thread",
        ("call", "threads", "ours", "loop", "ratio", "lowest", "highest"),
        (
            (
                *_cells(row, "task threads"),
                *(rate / 1e3 for rate in _numbers(row, "ours native")),
                *_numbers(row, "ratio lowest highest"),
            )
            for row in results["simulations"]
        ),
    )


def table_jobs(results: Results) -> Table:
    """Whole jobs beside a part or another way of them; empty for results of a version that did not time them."""
    return _table(
        "Whole jobs: times in seconds, medians; their ratios, and the extremes of neighbouring repetitions",
        ("job", "samples or bodies", "beside", "job, s", "other, s", "ratio", "lowest", "highest"),
        (
            (*_cells(row, "job size beside"), *_numbers(row, "ours theirs ratio lowest highest"))
            for row in results.get("jobs", ())
        ),
    )


def _table(title: str, columns: tuple[str, ...], rows: Iterable[tuple[Cell, ...]]) -> Table:
    return Table(title, columns, tuple(rows), decimals=2)


def _numbers(row: Mapping[str, Any], names: str) -> tuple[float, ...]:
    return tuple(float(row[name]) for name in names.split())


def _cells(row: Mapping[str, Any], names: str) -> tuple[Cell, ...]:
    return tuple(row[name] for name in names.split())
