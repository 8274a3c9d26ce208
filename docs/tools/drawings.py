"""Figures of the documentation: what the trajectory estimate does, and how fast the regressor is."""

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import scenes
from docs.tools.benchmark import AGAIN, ALL_COLUMNS, CHAIN, REGRESSOR
from docs.tools.mechanisms import PENDULUM
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS
from docs.tools.noise.recordings import noisy_recording
from experiments.document import figures, styles
from experiments.reports.identify_page import first_screen
from experiments.studies.competitors import USUAL, low_passed
from ident import read_log
from ident.identification import identify
from sim import mechanism

CONDITION = "person_half_degree"
"""A person who bows on a force plate, with angles measured to half a degree."""

JOINT = "hip"
SHOWN = (10.0, 16.0)
"""Times in the figure, s."""


def result_picture() -> str:
    """The first screen of the report on README's arm, as one SVG drawing in the colours of pages."""
    folder = Path(scenes.__file__).parent
    arm = mechanism(folder / "arm.xml", "base")
    shown = first_screen(identify(arm, read_log(folder / "arm.csv", arm)))
    style = (files("experiments.document") / "templates" / "shared.css").read_text(encoding="utf-8")
    placed = (svg.replace("<svg ", f'<svg x="{390 * k}" width="360" height="260" ') for k, svg in enumerate(shown))
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1140 260">'
    return f"{head}<style>{style} svg {{ background: var(--paper); }}</style>{''.join(placed)}</svg>\n"


def accelerations() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times, s (N,), and accelerations of a joint by method, rad/s² (N,)."""
    who = SUBJECTS[CONDITIONS[CONDITION].subject]
    recording = noisy_recording(CONDITIONS[CONDITION], 0, 0)
    filtered, _ = low_passed(who.mechanism, recording, USUAL)
    estimate = identify(who.mechanism, recording, offsets=False, holdout=0)
    k = who.mechanism.tree.joints.index(JOINT)
    return recording.time, {
        f"angles, low-passed at {USUAL:.0f} Hz": filtered.ddq[:, k],
        "motion that the servos follow": who.commanded.ddq[:, k],
        "trajectory estimate": estimate.prepared.samples.motion.ddq[:, k],
    }


def figure_estimator() -> Figure:
    """The accelerations over a few seconds."""
    time, curves = accelerations()
    lines = (figures.Line("C1", 0.7), figures.Line("black", 2.0), figures.Line("C0", 1.2, "--"))
    with styles.paper_style():
        figure = Figure(figsize=(6.4, 2.6))
        ax = figure.subplots()
        for (label, values), line in zip(curves.items(), lines, strict=True):
            ax.plot(time, values, color=line.color, lw=line.width, ls=line.style, label=label)
        ax.set(xlim=SHOWN, xlabel="Time (s)", ylabel=f"Acceleration of the {JOINT} (rad/s²)")
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure


def figure_benchmark(results: dict[str, Any]) -> Figure:
    """Time a sample over the number of samples of the pendulum and over the bodies of an arm, ours and Pinocchio's."""
    lines = (
        (0, PENDULUM, REGRESSOR, "samples", "o-", ("$Y$, ours", "$Y$, Pinocchio's loop")),
        (0, PENDULUM, ALL_COLUMNS, "samples", "s--", (r"$\psi$, ours", r"$\psi$, loop and lstsq")),
        (1, CHAIN, AGAIN, "bodies", "o-", ("", "")),
    )
    with styles.paper_style():
        figure = Figure()
        panels = figure.subplots(2, 1)
        for panel, mechanism, task, key, style, labels in lines:
            rows = [row for row in results["rows"] if (row["mechanism"], row["task"]) == (mechanism, task)]
            rows.sort(key=lambda row: row[key])
            for side, color, label in zip(("ours", "theirs"), ("C0", "C1"), labels, strict=True):
                times = [1e6 * row[side] / row["samples"] for row in rows]
                panels[panel].loglog([row[key] for row in rows], times, style, color=color, ms=2.5, label=label or None)
        for ax, label in zip(panels, ("Samples, double pendulum of 3 bodies", "Bodies of an arm"), strict=True):
            ax.set(xlabel=label, ylabel="Time a sample (µs)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure
