"""Figures, animation and example's log of README and of the documentation."""

from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

import scenes
from docs.tools.benchmark import AGAIN, ALL_COLUMNS, CHAIN, REGRESSOR
from docs.tools.mechanisms import PENDULUM
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS
from docs.tools.noise.estimators import low_passed
from docs.tools.noise.recordings import noisy_recording, sinusoids
from experiments.data.simulated_study import SimulatedStudy
from experiments.document import figures
from experiments.reports.identify_page import first_screen
from experiments.studies.person_on_plates import USUAL
from ident import read_log
from ident.files.atomic import replacing
from ident.files.table import vector_columns
from ident.identification import identify
from sim import mechanism
from sim.simulation.simulate import simulate

CONDITION = "person_half_degree"
"""A person who bows on a force plate, with angles measured to half a degree."""

JOINT = "hip"
SHOWN = (10.0, 16.0)
"""Times in the figure, s."""

CONTACT = "handle"
"""The contact in the animation: a hand at the end of the second link."""

WINDOW = (1.7, 7.7)
"""Times in the animation, s."""

GROUND, HAND, TOTAL, ESTIMATE = "C1", "C2", "black", "C0"

LOAD, PLACE, RADIUS = 0.5, (0.06, 0.12, 0.0), 0.03
"""Mass, kg, centre in the tool's frame, m, and radius of the load, a ball, m."""


def result_picture() -> str:
    """Channels and parameters of the report on README's arm, as one SVG drawing in the colours of pages."""
    folder = Path(scenes.__file__).parent
    arm = mechanism(folder / "arm.xml", "base")
    return standalone([*first_screen(identify(arm, read_log(folder / "arm.csv", arm)))][:2], 360, 310)


def standalone(shown: Iterable[str], width: int, height: int) -> str:
    """Pictures of a page, each of this size, beside each other as one SVG drawing."""
    style = (files("experiments.document") / "templates" / "shared.css").read_text(encoding="utf-8")
    size = f'width="{width}" height="{height}" preserveAspectRatio="xMidYMin"'
    placed = [svg.replace("<svg ", f'<svg x="{(width + 30) * k}" {size} ') for k, svg in enumerate(shown)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {(width + 30) * len(placed) - 30} {height}">'
    return f"{head}<style>{style} svg {{ background: var(--paper); }}</style>{''.join(placed)}</svg>\n"


def figure_estimator() -> Figure:
    """Accelerations of a joint by method over a few seconds, rad/s²."""
    who = SUBJECTS[CONDITIONS[CONDITION].subject]
    recording = noisy_recording(CONDITIONS[CONDITION], 0, 0)
    filtered, _ = low_passed(who.mechanism, recording, USUAL)
    estimate = identify(who.mechanism, recording, offsets=False, holdout=0)
    k = who.mechanism.tree.joints.index(JOINT)
    curves = (
        (f"angles, low-passed at {USUAL:.0f} Hz", filtered, figures.Line("C1", 0.7)),
        ("motion that the servos follow", who.commanded, figures.Line("black", 2.0)),
        ("trajectory estimate", estimate.prepared.samples.motion, figures.Line("C0", 1.2, "--")),
    )
    with figures.paper_style():
        figure = Figure(figsize=(6.4, 2.6))
        ax = figure.subplots()
        for label, motion, line in curves:
            ax.plot(recording.time, motion.ddq[:, k], color=line.color, lw=line.width, ls=line.style, label=label)
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
    with figures.paper_style():
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


def save_animation(result: SimulatedStudy, path: Path) -> None:
    """Writes a GIF of the mechanism from the side with its force arrows, beside the moment at the base over time.

    Args:
        result: The study with `CONTACT` alone.
        path: The file.
    """
    first, last = np.searchsorted(result.recording.time, WINDOW)
    per_second, points = 10, _points(result)
    writer = PillowWriter(per_second)
    # By Eq. 17 the total is the ground's wrench less the one that the link exerts on the hand.
    ground = result.recording.wrench("ground").values
    forces = np.stack([ground, result.measured.values - ground], axis=1)[..., 1:3]
    with figures.paper_style(), replacing(path) as temporary:
        figure = Figure(figsize=(6.4, 3.0), layout=ConstrainedLayoutEngine(h_pad=0.08))
        side, curves = figure.subplots(1, 2, width_ratios=(1, 1.3))
        cursor = _draw_curves(curves, result)
        with writer.saving(figure, temporary, dpi=100):
            for sample in range(int(first), int(last), round(result.recording.rate / per_second)):
                _draw_side(side, points[sample], forces[sample])
                cursor.set_xdata([result.recording.time[sample]] * 2)
                writer.grab_frame()
                # The layout is solved once, or the frames would jitter.
                figure.set_layout_engine("none")


def _points(result: SimulatedStudy) -> np.ndarray:
    """Both joints and the load cell in Y and Z of the base frame, m (N, 3, 2)."""
    tree = result.known.tree
    q, *_ = result.recording.noise_free.joint_states(tree.joints)
    poses = tree.poses(q)
    body, pose = result.known.sites[CONTACT]
    links = [tree.names.index(name) for name in ("link1", body)]
    cell = poses[:, links[1]] @ pose
    return np.stack([poses[:, links[0]], poses[:, links[1]], cell], axis=1)[..., 1:3, 3]


def _draw_side(ax: Axes, points: np.ndarray, forces: np.ndarray) -> None:
    """Draws one frame: the mechanism and an arrow for each force."""
    ax.clear()
    ax.set(xlim=(-0.75, 0.95), ylim=(-0.62, 1.15), aspect="equal")
    ax.set_axis_off()
    ax.plot([0, 0], [-0.45, -0.06], color="0.6", lw=8, solid_capstyle="butt")
    ax.plot(*points[:2].T, color="C0", lw=6, solid_capstyle="round")
    ax.plot(*points[1:].T, color="C4", lw=5, solid_capstyle="round")
    ax.plot(*points.T, "o", color="0.15", ms=6)
    for name, start, force, color, height in (
        ("ground", points[0], forces[0], GROUND, -0.6),
        ("hand", points[2], forces[1], HAND, -0.48),
    ):
        arrow = {"arrowstyle": "-|>,head_width=0.3", "color": color, "lw": 2.2, "shrinkA": 0, "shrinkB": 0}
        # 500 N are drawn a metre long.
        ax.annotate("", start + force / 500, start, arrowprops=arrow, annotation_clip=False)
        ax.text(0.2, height, f"{name}: {np.hypot(*force):.0f} N", color=color, fontsize=9)


def _draw_curves(ax: Axes, result: SimulatedStudy) -> Line2D:
    """Draws the moment about X over time, from the ground, with the hand, and predicted; returns the cursor."""
    component = 3
    time, (symbol, unit) = result.recording.time, figures.SYMBOLS[component]
    for label, wrench, line in (
        ("ground", result.recording.wrench("ground").values, figures.Line(GROUND, 1.0)),
        ("ground and hand", result.measured.values, figures.Line(TOTAL, 2.2)),
        (r"predicted, $Y\psi$", result.fit("contact").predicted, figures.Line(ESTIMATE, 1.2, "--")),
    ):
        ax.plot(time, wrench[:, component], color=line.color, lw=line.width, ls=line.style, label=label)
    ax.set(xlim=WINDOW, xlabel="Time (s)", ylabel=f"${symbol}$ ({unit})")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=3, handlelength=1.4, columnspacing=1.0, fontsize=7)
    return ax.axvline(WINDOW[0], color="0.5", lw=1)


DECIMALS = {"position": 5, "force": 2, "torque": 3}
"""Decimals of the log by quantity, several of them within the noise."""


def loaded_arm() -> mujoco.MjSpec:
    """The scene `arm` with the load welded to its tool."""
    spec = scenes.load("arm")
    inertia = [0.4 * LOAD * RADIUS**2] * 3
    ball = spec.body("tool").add_body(name="load", pos=PLACE)
    ball.mass, ball.ipos, ball.inertia, ball.explicitinertial = LOAD, [0, 0, 0], inertia, True
    return spec


def save_log(path: Path) -> None:
    """Writes angles, torques and the wrench of the plate at 100 Hz, along sums of sinusoids, as a controller would."""
    seconds, seed = 12, 2
    motion = sinusoids(np.random.default_rng(seed), 4, seconds)
    log = simulate(loaded_arm(), motion, samples=100 * seconds, seed=seed)
    columns, formats = {"time": log.time}, ["%.2f"]
    for name, values in log.measured.items():
        kind = name.rpartition("_")[2]
        if kind in DECIMALS:
            columns |= (parts := vector_columns(name, values))
            formats += [f"%.{DECIMALS[kind]}f"] * len(parts)
    with replacing(path) as temporary:
        rows = np.column_stack(list(columns.values()))
        np.savetxt(temporary, rows, formats, delimiter=",", header=",".join(columns), comments="", encoding="utf-8")
