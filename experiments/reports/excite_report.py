"""Report on a designed excitation: tables before and after, a figure, and the motion as a recording."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.paper import RANDOM_START
from experiments.document import tabular, typography
from experiments.document.figures import empty_figure
from experiments.document.tabular import of_deviations
from experiments.document.writer import Document, Plot, sentences
from experiments.studies.designed_excitation import Design
from ident.display.plots import Figure, add_legend, few_ticks, label_above
from ident.geometry.inertia import with_bodies
from ident.judgement.wording import NAMED
from ident.recordings.recording import STATES

PER = ("", "/s", "/s²")
"""Suffixes of units for position, velocity and acceleration."""


def table_quality(design: Design) -> tabular.Table:
    """All criteria before and after."""
    old, new = design.before.quality, design.after.quality
    rows = [(name, old[name], new[name]) for name in old]
    names = {name: tabular.heading(name) for name in old} | {"log_det_information": "log det of the information"}
    return tabular.Table("Criteria", ("criterion", "before", "after"), rows, decimals=4, names=names)


def table_deviations(design: Design) -> tabular.Table:
    """Predicted standard deviations of base parameters before and after, prior ones, and their geometric means."""
    title = (
        f"Excitation of {', '.join(design.problem.joints)}: predicted standard deviations, SI units, of {design.start} "
        "and the designed one"
    )
    std = {} if design.known is None else {"std_known": design.known}
    std |= {"std_before": design.before.std, "std_after": design.after.std}
    names = (*design.problem.names, "geometric mean")
    with np.errstate(divide="ignore"):
        means = {name: np.append(values, np.exp(np.log(values).mean())) for name, values in std.items()}
    digits = {name: of_deviations(values) for name, values in means.items()}
    columns = tabular.columns(parameter=names, **means)
    return tabular.Table(title, *columns, digits=digits, bodies=design.problem.mechanism.bodies)


def table_limits(design: Design) -> tabular.Table:
    """Used range and limits of each joint."""
    limits, both = design.limits, (design.before.motion, design.after.motion)
    rows: list[tuple[tabular.Cell, ...]] = []
    for k, joint in enumerate(design.problem.joints):
        unit = design.problem.units[joint]
        used = {f"lowest position, {unit}": ([x.q[:, k].min() for x in both], limits.low)}
        used |= {f"highest position, {unit}": ([x.q[:, k].max() for x in both], limits.high)}
        rates = zip(STATES[1:], PER[1:], (limits.velocity, limits.acceleration), strict=True)
        for order, (kind, per, largest) in enumerate(rates, start=1):
            used[f"largest {kind}, {unit}{per}"] = [abs(x.states[order][:, k]).max() for x in both], largest
        rows += [(joint, what, *map(float, (*own, limit[k]))) for what, (own, limit) in used.items()]
    return tabular.Table("Limits", ("joint", "quantity", "before", "after", "limit"), rows)


def figure(design: Design) -> Figure:
    """Position, velocity and acceleration of each moving joint, before and after, with their limits."""
    limits, joints, time = design.limits, design.problem.joints, design.time
    fastest = limits.velocity, limits.acceleration
    bounds = ((limits.low, limits.high), *((-each, each) for each in fastest))
    first, last = (f"{each.quality['condition_number']:.3g}" for each in (design.before, design.after))
    with empty_figure(0.6 + 1.05 * len(joints), wide=True) as drawing:
        axes = drawing.subplots(len(joints), 3, sharex=True, squeeze=False)
        for (k, column), ax in np.ndenumerate(axes):
            low, high = (float(bound[k]) for bound in bounds[column])
            old, new = (each.motion.states[column][:, k] for each in (design.before, design.after))
            # A longer motion before is drawn as long as the designed one.
            old = old[: len(time)]
            ax.plot(time, new, color="C0", lw=1.0, zorder=3, label=f"designed: condition number {last}")
            ax.plot(time[: len(old)], old, color="0.6", label=f"before: {first}")
            for limit in (low, high):
                ax.axhline(limit, color="C1", lw=0.7, ls="--", label="limits")
            few_ticks(ax)
            ax.set(xlim=(time[0], time[-1]), ylim=(1.08 * low - 0.08 * high, 1.08 * high - 0.08 * low))
            unit = f"{design.problem.units[joints[k]]}{PER[column]}"
            label_above(ax, f"{typography.label(joints[k])}, {STATES[column]} ({unit})")
        for ax in axes[-1]:
            ax.set_xlabel("Time (s)", labelpad=2)
        add_legend(drawing)
    return drawing


def lines(design: Design) -> list[str]:
    """Sentences for the terminal and the page, besides the tables."""
    motion, limits = design.before.motion, design.limits
    # What is faster before by more than a twentieth is said.
    beyond = abs(motion.dq).max(axis=0) > 1.05 * limits.velocity
    beyond |= abs(motion.ddq).max(axis=0) > 1.05 * limits.acceleration
    long, short = (len(each.motion.q) - 1 for each in (design.before, design.after))
    problem, own = design.problem, design.problem.parameters.names
    names = with_bodies(own, problem.mechanism.bodies) if len(own) <= NAMED else ""
    more = {"names": names, "most": NAMED, "compared": design.start != RANDOM_START}
    more |= {"fast": [name for name, fast in zip(problem.joints, beyond, strict=True) if fast], "alike": 0.1}
    return sentences("excite.txt", design=design, long=long, short=short, **more)


def document(design: Design, model: str, provenance: dict[str, Any]) -> Document:
    """Tables and a figure of a design, and its motion as a recording."""
    caption = f"Position, velocity and acceleration of the joints that move: designed, and before, {design.start}."
    return Document(
        f"Excitation of {Path(model).name}",
        lines=lines(design),
        tables={
            "table_deviations": table_deviations(design),
            "table_quality": table_quality(design),
            "table_limits": table_limits(design),
        },
        figures={"figure_excitation": Plot(partial(figure, design), caption)},
        numbers={"provenance": provenance},
        recordings=dict.fromkeys(("trajectory.csv", "trajectory.npz"), design.recording),
    )
