"""Report on the study of a person who bows: tables, a figure, key numbers, and the terminal's text."""

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.data.errors import HALF_WIDTH
from experiments.document import styles, symbols, tabular
from experiments.document.document import Document
from experiments.in_vivo.study import JUDGED_AT, Study
from experiments.reports.identify_replay import replay

ABOUT = (
    "A recording of a person who bows on a force plate is identified by several estimators. The tables and "
    "figures compare their parameters of legs and trunk, and their predictions of the held-out part."
)
"""The page's text on the study."""

SHOWN = ("m2rz2", "Iyy2", "m3rz3", "Iyy3")
"""Parameters that a bow excites: first moments and inertias of the legs with all above, and of the trunk."""

CHANNELS = {"Fx": "N", "Fz": "N", "My": "N m"}
"""Channels that a bow excites, and their units."""

LINES = {"scaled model": ("0.5", "D"), "trajectory estimate": ("C0", "o")}
OTHERS = (("C1", "s"), ("C2", "^"))
"""Colour and marker of each estimator."""


def looks(study: Study) -> dict[str, tuple[str, str]]:
    """Colour and marker by estimator."""
    return {**LINES, **dict(zip(study.others, OTHERS, strict=True))}


def table_parameters(study: Study) -> tabular.Table:
    """Base parameters by estimator, with their standard deviations."""
    columns: dict[str, Any] = {"parameter": study.names}
    for name, (psi, std) in study.candidates.items():
        columns[name] = psi.tolist()
        if std is not None:
            columns[f"{name}, std"] = std.tolist()
    heads = {name: _head(name) for name in columns}
    title, bodies = "Base parameters of a person who bows, SI units", study.trajectory.prepared.mechanism.bodies
    deviations = {name: f"{name}, std" for name in study.candidates if f"{name}, std" in columns}
    return tabular.Table(
        title, *tabular.columns(**columns), decimals=2, deviations=deviations, bodies=bodies, heads=heads
    )


def _head(column: str) -> str:
    """Head of a column in words; columns of one estimator are adjacent, under its name."""
    name = column.removesuffix(", std")
    return column if column == "parameter" else f"{'value' if name == column else 's.d.'}, {name}"


def table_prediction(study: Study) -> tabular.Table:
    """Residual over signal of each estimator on the held-out part."""
    rows: list[tuple[tabular.Cell, ...]] = [(name, *map(float, ratio)) for name, ratio in study.ratios.items()]
    title = (
        f"Residual of the held-out part below {JUDGED_AT:g} Hz, a constant taken out, over the signal's standard "
        "deviation"
    )
    return tabular.Table(title, ("estimator", *study.trajectory.channels), tuple(rows), decimals=3)


def figure(study: Study) -> Figure:
    """Inertias and first moments by estimator, and predictions of the held-out part."""
    with styles.paper_style():
        drawing = Figure(figsize=(styles.column_width(), 5.4))
        above, *below = drawing.subplots(1 + len(CHANNELS), 1, height_ratios=(1.5, 1, 1, 1))
        _parameters(above, study)
        time, measured, predicted = study.held_out
        for ax, (channel, unit) in zip(below, CHANNELS.items(), strict=True):
            k = study.trajectory.channels.index(channel)
            ax.plot(time, measured[:, k], color="black", lw=1.1, label="measured")
            for name, (color, _) in looks(study).items():
                ax.plot(time, predicted[name][:, k], color=color, lw=0.8, label=name)
            ax.set_ylabel(f"${channel[0]}_{channel[1]}$ ({unit})", labelpad=2)
            ax.sharex(below[-1])
            ax.tick_params(labelbottom=ax is below[-1])
        below[0].set_title(f"(b) Held-out part, below {JUDGED_AT:g} Hz")
        below[-1].set_xlabel("Time (s)", labelpad=2)
        handles, labels = below[0].get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=7)
    return drawing


def _parameters(ax: Axes, study: Study) -> None:
    """Draws the estimates of `SHOWN` over those of the scaled model."""
    places = np.arange(len(SHOWN))
    which = [study.names.index(name) for name in SHOWN]
    model = study.candidates["scaled model"][0][which]
    for number, (name, (color, marker)) in enumerate(looks(study).items()):
        psi, std = study.candidates[name]
        bars = None if std is None else HALF_WIDTH * std[which] / model
        at = places + 0.15 * (number - 1.5)
        ax.errorbar(at, psi[which] / model, bars, fmt=marker, color=color, ms=3, lw=0.9, capsize=0, label=f"_{name}")
    ax.axhline(0, color="0.8", lw=0.6, zorder=0)
    ax.set_xticks(places, [symbols.named_symbol(name, study.trajectory.prepared.mechanism.bodies) for name in SHOWN])
    ax.set_ylabel("Estimate over the model's", labelpad=2)
    ax.set_title("(a) Legs and trunk, 95 % intervals")


def numbers(study: Study) -> dict[str, Any]:
    """Key numbers for scripts."""
    parameters = {
        name: {"values": psi.tolist(), "std": None if std is None else std.tolist()}
        for name, (psi, std) in study.candidates.items()
    }
    ratios = {name: dict(zip(study.trajectory.channels, x.tolist(), strict=True)) for name, x in study.ratios.items()}
    setup = [{"name": each.name, "value": each.value, "std": each.std} for each in study.trajectory.setup]
    estimates = {"names": study.names, "parameters": parameters, "held_out": ratios}
    return {**estimates, "set_up": setup, "verdict": str(study.trajectory.verdict())}


def document(study: Study, provenance: dict[str, Any]) -> Document:
    """Tables, a figure and numbers, with verdict, findings and replay of the trajectory estimate."""
    trajectory = study.trajectory
    caption = (
        "A person who bows on a force plate (Latella et al., 2016): base parameters of several estimators over those "
        "of the scaled model, with 95 % intervals (a), and their predictions of the held-out part of the "
        "recording (b)."
    )
    return Document(
        "A person who bows",
        ABOUT,
        verdict=f"Trajectory estimate: {trajectory.verdict()}",
        findings=[(finding.text, finding.doubt) for finding in trajectory.findings],
        tables={"table_parameters": table_parameters(study), "table_prediction": table_prediction(study)},
        figures={"figure_in_vivo": (figure(study), caption)},
        numbers={"summary": numbers(study), "provenance": provenance},
        # The table is not that of the trajectory estimate alone, whose rows could be pressed.
        replay=replace(replay(trajectory), parameters=()),
    )
