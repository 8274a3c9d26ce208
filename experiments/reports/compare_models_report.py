"""Report on models side by side: inertias of their bodies and drives of their joints."""

from collections.abc import Sequence
from typing import Any

from experiments.data.model_comparison import ModelPair, Pair
from experiments.document import tabular
from experiments.document.document import Document
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
"""Names of the kinds of drives in tables."""


def table(pair: ModelPair, rows: Sequence[Pair], what: str) -> tabular.Table:
    """Quantities of both models, their difference, and that in % of the first."""
    names = {key: name for key, name in QUANTITIES.items() if any(row.quantity == key for row in rows)}
    return tabular.Table(
        f"{what} of {pair.names[0]} and of {pair.names[1]}",
        *tabular.columns(
            of=[row.of for row in rows],
            quantity=[names.get(row.quantity, row.quantity) for row in rows],
            unit=[row.unit for row in rows],
            first=[row.first for row in rows],
            second=[row.second for row in rows],
            difference=[row.difference for row in rows],
            percent=[row.percent for row in rows],
        ),
        decimals=5,
        heads={"of": "body" if what == "Bodies" else "joint", "percent": "% of first"},
        caption=f"{what} of two models and their difference",
        notes=(f"First: {pair.names[0]}. Second: {pair.names[1]}.",),
    )


def sentence(pair: ModelPair) -> str:
    """A sentence on how many quantities differ, and the largest relative difference of a mass or a drive."""
    every = [*pair.bodies, *pair.drives]
    differ = [row for row in every if row.differs]
    if not differ:
        return f"{pair.names[0]} and {pair.names[1]} have the same bodies and drives."
    text = f"{len(differ)} of {len(every)} quantities of {pair.names[1]} differ from those of {pair.names[0]}"
    known = [row for row in differ if row.percent is not None and (row.quantity == "mass" or row in pair.drives)]
    if not known:
        return f"{text}."
    most = max(known, key=lambda row: abs(row.percent or 0.0))
    what = QUANTITIES.get(most.quantity, most.quantity)
    return f"{text}, relatively most the {what} of {most.of}, by {most.percent:+.3g} %."


def document(compared: Sequence[ModelPair], provenance: dict[str, Any]) -> Document:
    """Each model compared with the first."""
    ends = [""] if len(compared) == 1 else [f"_{k}" for k in range(2, len(compared) + 2)]
    tables = {}
    for end, pair in zip(ends, compared, strict=True):
        tables[f"table_bodies{end}"] = table(pair, pair.bodies, "Bodies")
        if drives := pair.drives:
            tables[f"table_drives{end}"] = table(pair, drives, "Drives")
    sentences = [sentence(pair) for pair in compared]
    alone = list(dict.fromkeys(line for pair in compared for line in pair.alone))
    names = (compared[0].names[0], *(pair.names[1] for pair in compared))
    return Document(
        f"{' and '.join(names)}, compared",
        lines=[*sentences, *alone],
        heading="What is compared",
        tables=tables,
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
                **{key: list(map(vars, rows)) for key, rows in (("bodies", pair.bodies), ("drives", pair.drives))},
            }
            for pair in compared
        ]
    }
