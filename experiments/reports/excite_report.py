"""Report on a designed excitation: the motion as a recording, tables before and after, and a figure."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from experiments.document import escape, figures, report
from experiments.studies import criteria
from experiments.studies.excitation import Problem
from ident.mechanism.motion import Motion
from ident.recordings.recording import STATES, Recording
from sim.motion.excitation_design import Limits

PER = ("", "/s", "/s²")
"""Suffixes of units for position, velocity and acceleration."""


def recording(problem: Problem, time: np.ndarray, motion: Motion, provenance: Mapping[str, Any]) -> Recording:
    """Recording of the motion of all hinge and slide joints."""
    measured, units = {}, {}
    still = np.zeros(len(time))
    columns = {joint: k for k, joint in enumerate(problem.joints)}
    for joint in dict.fromkeys((*problem.joints, *problem.rest)):
        k = columns.get(joint)
        rest = (problem.rest[joint] + still, still, still)
        for kind, x, per, at_rest in zip(STATES, motion.states, PER, rest, strict=True):
            measured[f"{joint}_{kind}"] = at_rest if k is None else x[:, k]
            units[f"{joint}_{kind}"] = problem.units[joint] + per
    return Recording(time, measured, units=units, provenance=provenance)


def table_quality(problem: Problem, before: Motion, after: Motion) -> report.Table:
    """All criteria before and after."""
    old, new = (criteria.quality(problem, motion) for motion in (before, after))
    rows = tuple((name, old[name], new[name]) for name in old)
    names = {name: report.heading(name) for name in old} | {"log_det_information": "log det of the information"}
    return report.Table("Criteria", ("criterion", "before", "after"), rows, decimals=4, names=names)


def table_deviations(problem: Problem, before: Motion, after: Motion, title: str) -> report.Table:
    """Predicted standard deviation of each base parameter before and after, its prior one, and their geometric means.

    Decimals are such that the smallest one has two digits.
    """
    std = {f"std_{k}": criteria.predicted_deviations(problem, m) for k, m in (("before", before), ("after", after))}
    if problem.mechanism.prior is not None:
        std = {"std_known": np.linalg.norm(criteria.known_root(problem), axis=0)} | std
    names = (*problem.parameters.names, "geometric mean")
    means = {name: np.append(values, criteria.geometric_mean(values)) for name, values in std.items()}
    heads, rows = report.columns(parameter=names, **means)
    decimals = max(3, 1 - math.floor(math.log10(std["std_after"].min())))
    return report.Table(title, heads, rows, decimals=decimals, bodies=problem.mechanism.bodies)


def table_limits(problem: Problem, limits: Limits, before: Motion, after: Motion) -> report.Table:
    """Used range and limits of each joint."""
    rows: list[tuple[report.Cell, ...]] = []
    for k, joint in enumerate(problem.joints):
        unit = problem.units[joint]
        for bound, function, limit in (("lowest", np.min, limits.low), ("highest", np.max, limits.high)):
            used = (float(function(motion.q[:, k])) for motion in (before, after))
            rows.append((joint, f"{bound} position, {unit}", *used, float(limit[k])))
        rates = zip(STATES[1:], PER[1:], (limits.velocity, limits.acceleration), strict=True)
        for order, (kind, per, largest) in enumerate(rates, start=1):
            used = (float(abs(motion.states[order][:, k]).max()) for motion in (before, after))
            rows.append((joint, f"largest {kind}, {unit}{per}", *used, float(largest[k])))
    return report.Table("Limits", ("joint", "quantity", "before", "after", "limit"), tuple(rows))


def figure(problem: Problem, limits: Limits, time: np.ndarray, before: Motion, after: Motion) -> Figure:
    """Position, velocity and acceleration of each moving joint, before and after, with their limits."""
    bounds = (
        (limits.low, limits.high),
        (-limits.velocity, limits.velocity),
        (-limits.acceleration, limits.acceleration),
    )
    ratio = criteria.mean_deviation(problem, after) / criteria.mean_deviation(problem, before)
    first, last = (criteria.quality(problem, motion)["condition_number"] for motion in (before, after))
    labels = (
        f"designed: condition number {last:.1f}, s.d. {ratio:.2f} of those before",
        f"before: {first:.1f}",
        "limits",
    )
    with figures.paper_style():
        drawing = Figure(figsize=(figures.text_width(), 0.55 + 1.15 * len(problem.joints)))
        axes = drawing.subplots(len(problem.joints), 3, sharex=True, squeeze=False)
        for (k, column), ax in np.ndenumerate(axes):
            joint, (low, high) = problem.joints[k], bounds[column]
            old, new = (motion.states[column][:, k] for motion in (before, after))
            lines = _panel(ax, time, old, new, (float(low[k]), float(high[k])))
            name = f"{escape.label(joint)}\n" if column == 0 else ""
            ax.set_ylabel(f"{name}{STATES[column]} ({problem.units[joint]}{PER[column]})", labelpad=2)
        for ax in axes[-1]:
            ax.set_xlabel("Time (s)", labelpad=2)
        figures.align_ylabels(axes.flat)
        drawing.legend(lines, labels, loc="outside upper center", ncols=3)
    return drawing


def _panel(
    ax: Axes, time: np.ndarray, before: np.ndarray, after: np.ndarray, limits: tuple[float, float]
) -> list[Line2D]:
    """Draws one quantity of one joint, and returns the lines of the design, of the motion before, and of the limits."""
    bounds = [ax.axhline(limit, color="C1", lw=0.7, ls="--") for limit in limits]
    (old,) = ax.plot(time, before, color="0.6")
    (new,) = ax.plot(time, after, color="C0", lw=1.0)
    room = 0.08 * (limits[1] - limits[0])
    ax.set_ylim(limits[0] - room, limits[1] + room)
    ax.set_xlim(time[0], time[-1])
    ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    return [new, old, bounds[0]]
