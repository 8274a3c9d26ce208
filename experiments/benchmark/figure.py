"""The benchmark's chart, from the contents of `benchmark.json`."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from experiments.benchmark.identification import ALL_COLUMNS, CHAIN, REGRESSOR
from experiments.benchmark.mechanisms import PENDULUM
from experiments.benchmark.tables import Results
from experiments.document import styles
from ident.errors import InputError

Row = dict[str, Any]
BLUE, RED = "C0", "C1"


def figure_benchmark(results: Results) -> Figure:
    """Time per sample over the number of samples and over the number of bodies; one IEEE column wide.

    Raises:
        InputError: Nothing was compared.
    """
    rows = results["comparisons"]
    if not rows:
        raise InputError("This chart needs results of a benchmark with a library to compare with (extra 'peers').")
    peer = rows[0]["peer"]
    with styles.paper_style():
        figure = Figure()
        above, below = figure.subplots(2, 1)
        of_pendulum = [row for row in rows if row["mechanism"] == PENDULUM]
        for task, style, ours, theirs in (
            (REGRESSOR, "o-", "$Y$, ours", f"$Y$, {peer}'s loop"),
            (ALL_COLUMNS, "s--", r"$\psi$, ours", r"$\psi$, loop and lstsq"),
        ):
            by_samples = sorted((row for row in of_pendulum if row["task"] == task), key=lambda row: row["samples"])
            # The smallest number is the recording's, close to the next.
            _lines(above, "samples", by_samples[1:], style, (ours, theirs))
        arms = [row for row in rows if row["mechanism"] == CHAIN]
        _lines(below, "bodies", arms, "o-", ("$Y$, ours", f"$Y$, {peer}'s loop"))
        above.set_xlabel("Samples, double pendulum of 3 bodies", labelpad=2)
        below.set_xlabel("Bodies of an arm, memory used again", labelpad=2)
        for ax in (above, below):
            ax.set_ylabel("Time a sample (µs)", labelpad=2)
        handles, labels = above.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _lines(ax: Axes, key: str, rows: Sequence[Row], style: str, labels: tuple[str, str]) -> None:
    """Draws our times and theirs over a field of the comparisons."""
    x = [row[key] for row in rows]
    for side, color, label in (("ours", BLUE, labels[0]), ("theirs", RED, labels[1])):
        times = [1e6 * row[side] / row["samples"] for row in rows]
        ax.loglog(x, times, style, color=color, ms=2.5, label=label)
    ax.yaxis.set_major_locator(LogLocator(10))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:,g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    # The limits of the axis would stay those of the first lines.
    low, high = ax.dataLim.intervaly
    ax.set_ylim(min(low / 1.3, 0.09), max(high * 1.3, 11))
    ax.set_xticks(x, labels=[f"{number:,}" for number in x])
    ax.xaxis.set_minor_locator(NullLocator())
