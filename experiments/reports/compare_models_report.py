"""Report on models side by side: inertias of their bodies and drives of their joints."""

from collections.abc import Sequence
from math import floor, log10
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.data.model_comparison import ModelPair, Pair
from experiments.document import escape, figures, row_panels, styles, tabular
from experiments.document.decimals import LEAST
from experiments.document.document import Document
from experiments.document.layout import PAPER, Layout
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.terminal import wrapped

OUTPUTS = (*RESULTS, "comparison.json")
"""Patterns of the files that it writes."""

QUANTITIES = {
    "rotor": "rotor inertia",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "spring": "stiffness",
}
"""Names of the kinds of drives in tables and figures."""

DIGITS = 4, 6
"""Significant digits of a quantity, and as many as a small difference may add to show two of its own."""


def words(row: Pair) -> str:
    """Name of a quantity in words."""
    return QUANTITIES.get(row.quantity, row.quantity)


def table(pair: ModelPair, rows: Sequence[Pair], what: str) -> tabular.Table:
    """Quantities of both models, their difference, and that in % of the first's size."""
    first, second = pair.names
    size = "size: distance of the centre of mass, largest principal moment of inertia, else the value itself"
    return tabular.Table(
        f"{what} of {first} and of {second}",
        *tabular.columns(
            of=[row.of for row in rows],
            quantity=[words(row) for row in rows],
            unit=[row.unit for row in rows],
            first=[row.first for row in rows],
            second=[row.second for row in rows],
            difference=[row.difference for row in rows],
            percent=[row.percent for row in rows],
        ),
        decimals=1,
        digits={name: list(map(_decimals, rows)) for name in ("first", "second", "difference")},
        heads={"of": "body" if what == "Bodies" else "joint", "percent": "% of first"},
        caption=f"{what} of two models and their difference",
        notes=(f"First: {first}. Second: {second}. % of first: of its {size}.",),
    )


def _decimals(row: Pair) -> int:
    """Decimals that leave `DIGITS` of a quantity's size, and two of the difference if that needs more."""
    size = row.size or abs(row.second)
    places = [1 - floor(log10(abs(row.difference)))] if row.differs else []
    least, most = (digits - 1 - floor(log10(size)) for digits in DIGITS) if size else (0, LEAST)
    return min(max([least, *places]), most)


def figure(pair: ModelPair) -> Figure | None:
    """Masses and drives of both models, each over the larger one; the most different if too many; None without any."""
    rows = shown_rows(pair)
    if not rows:
        return None
    both = np.array([(row.first, row.second) for row in rows])
    both = both / np.abs(both).max(axis=1, keepdims=True)
    with styles.paper_style():
        labels = [escape.label(f"{words(row)} of {row.of}") for row in rows]
        drawn, panels = row_panels.row_panels(labels, "Value over the larger of both")
        for ax, own in panels:
            ax.axvline(0, color="0.8", lw=0.6)
            ax.plot(both[own, 0], own, "|", color=figures.INKS[0], ms=7, label=escape.label(pair.names[0]))
            ax.plot(both[own, 1], own, "o", color=figures.INKS[1], ms=2.5, label=escape.label(pair.names[1]))
        drawn.legend(*panels[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return drawn


def shown_rows(pair: ModelPair) -> list[Pair]:
    """Masses and drives that a page has room for: those that differ most, in the order of the tables."""
    rows = _masses_and_drives(pair)
    relative = [-abs(row.difference) / max(abs(row.first), abs(row.second)) for row in rows]
    most = sorted(range(len(rows)), key=relative.__getitem__)[: row_panels.most_rows()]
    return [rows[k] for k in sorted(most)]


def _masses_and_drives(pair: ModelPair) -> list[Pair]:
    """Masses and drives that one of the models has."""
    return [row for row in pair.bodies if row.quantity == "mass" and (row.first or row.second)] + pair.drives


def caption(pair: ModelPair) -> str:
    """Caption of the figure."""
    text = f"Masses and drives of {pair.names[0]} and of {pair.names[1]}, each over the larger one."
    shown, every = len(shown_rows(pair)), len(_masses_and_drives(pair))
    return text + f" Shown are the {shown} of {every} that differ most; the tables have all." * (shown < every)


def sentence(pair: ModelPair) -> str:
    """A sentence on how many quantities differ, and the largest relative difference of a mass or a drive."""
    every = [*pair.bodies, *pair.drives]
    differ = [row for row in every if row.differs]
    if not differ and pair.alone:
        return f"All {len(every)} quantities that {pair.names[0]} and {pair.names[1]} have in common are the same."
    if not differ:
        return f"{pair.names[0]} and {pair.names[1]} have the same bodies and drives."
    text = f"{len(differ)} of {len(every)} quantities of {pair.names[1]} differ from those of {pair.names[0]}"
    known = [row for row in differ if row.percent is not None and (row.quantity == "mass" or row in pair.drives)]
    if not known:
        return f"{text}."
    most = max(known, key=lambda row: abs(row.percent or 0.0))
    return f"{text}, relatively most the {words(most)} of {most.of}, by {most.percent:+.3g} %."


def document(compared: Sequence[ModelPair], provenance: dict[str, Any], layout: Layout = PAPER) -> Document:
    """Each model compared with the first.

    Raises:
        InputError: The layout names a table, figure or parameter that does not exist.
    """
    ends = [""] if len(compared) == 1 else [f"_{k}" for k in range(2, len(compared) + 2)]
    tables, drawn = {}, {}
    for end, pair in zip(ends, compared, strict=True):
        tables[f"table_bodies{end}"] = table(pair, pair.bodies, "Bodies")
        if drives := pair.drives:
            tables[f"table_drives{end}"] = table(pair, drives, "Drives")
        if shown := figure(pair):
            drawn[f"figure_models{end}"] = shown, caption(pair)
    layout.check([*tables, *drawn], (), ())
    sentences = [sentence(pair) for pair in compared]
    alone = list(dict.fromkeys(line for pair in compared for line in pair.alone))
    names = (compared[0].names[0], *(pair.names[1] for pair in compared))
    return Document(
        f"{' and '.join(names)}, compared",
        lines=[*sentences, *alone],
        heading="What is compared",
        tables=tables,
        figures=drawn,
        numbers={"comparison": numbers(compared), "provenance": provenance},
        screen=wrapped("\n".join([*(each.text() for each in tables.values()), *sentences, *alone])),
    )


def numbers(compared: Sequence[ModelPair]) -> dict[str, Any]:
    """All numbers for scripts."""
    return {
        "pairs": [
            {
                "first": pair.names[0],
                "second": pair.names[1],
                "bodies": [_entry(row) for row in pair.bodies],
                "drives": [_entry(row) for row in pair.drives],
                "unlike": pair.unlike,
            }
            for pair in compared
        ]
    }


def _entry(row: Pair) -> dict[str, Any]:
    """Numbers of a quantity for scripts."""
    return {**vars(row), "difference": row.difference, "percent": row.percent}
