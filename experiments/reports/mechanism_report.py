"""Report on the double pendulum itself: Figure 1 and Tables I and II."""

from functools import partial
from typing import Any

import numpy as np

from experiments.data import paper
from experiments.data.paper import Drawing
from experiments.document import tabular
from experiments.document.figures import empty_figure
from experiments.document.writer import Document, Plot
from ident.display.plots import Axes, Figure
from ident.mechanism.tree import Tree

FRAME_COLORS = ("C1", "C2", "C0")


def table_1() -> tabular.Table:
    """Table I as printed."""
    columns = ("frame", "inertia", "alpha", "d", "theta", "r")
    title, heads = "Modified DH parameters of the double pendulum, as printed", {"alpha": "α", "theta": "θ"}
    return tabular.Table(title, columns, paper.TABLE_1, heads=heads)


def table_2(tree: Tree, base: np.ndarray) -> tabular.Table:
    """Table II: home pose in the world's frame and joint twist of each body."""
    home = tree.poses(np.zeros(len(tree.moving)))
    rows = []
    for i, (body, T) in enumerate(zip(tree.bodies, home, strict=True), start=1):
        turned = "1" if np.allclose(T[:3, :3], np.eye(3)) else _numbers(T[:3, :3].ravel())
        cells = map(_numbers, (T[:3, 3] + base, body.twist[:3], body.twist[3:]))
        rows.append((f"{body.name}, i = {i}", turned, *cells))
    columns = ("frame", "initial rotation", "initial position", "twist v", "twist omega")
    heads = {"initial position": "initial position (m)", "twist v": "twist v (m)", "twist omega": "twist ω"}
    return tabular.Table("Geometric model of the double pendulum", columns, rows, heads=heads)


def _numbers(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:g}" for value in values) + ")"


def figure_1(drawing: Drawing) -> Figure:
    """Figure 1: the mechanism on the left, its frames on the right."""
    with empty_figure(2.8) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        for ax in (left, right):
            _draw_links(ax, drawing)
            ax.set_aspect("equal")
            ax.set(xlabel="To the right (m)", ylabel="Upwards (m)")
            ax.set_axis_off()
        _label_mechanism(left, drawing)
        labels = {"world": (26, -8), "$g_1$, base": (-52, -8), "$g_2$, link 1": (20, 14), "$g_3$, link 2": (16, 8)}
        for T, (label, shift) in zip([np.eye(4), *drawing.poses], labels.items(), strict=True):
            _frame(right, T)
            _note(right, T[:3, 3], label, shift)
    return figure


def _flat(points: np.ndarray) -> np.ndarray:
    """Oblique projection of points (…, 3): Y to the right, Z up, X towards the reader's lower left."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    return np.stack([y - 0.45 * x, z - 0.3 * x], axis=-1)


def _draw_links(ax: Axes, drawing: Drawing) -> None:
    """Draws pedestal, links, joints and centres of mass from the front."""
    foot = drawing.base * [1, 1, 0]
    shoulder, elbow = drawing.poses[1, :3, 3], drawing.poses[2, :3, 3]
    links = {"base": (foot, shoulder, 6), "link 1": (shoulder, elbow, 4), "link 2": (elbow, drawing.end, 3)}
    for name, (a, b, width) in links.items():
        ax.plot(*_flat(np.array([a, b])).T, color="0.75", lw=width, solid_capstyle="round", label=name)
    ax.plot(*_flat(foot + np.array([[0, -0.25, 0], [0, 0.25, 0]])).T, color="0.3", lw=1, label="floor")
    for joint in (shoulder, elbow):
        ax.plot(*_flat(joint), "o", color="white", mec="black", ms=5, mew=0.8, label="joint")
    for k, (T, mass) in enumerate(zip(drawing.poses, drawing.masses, strict=True), start=1):
        ax.plot(*_flat(np.array([T[:3, 3], mass])).T, color="0.3", lw=0.6, label=f"frame to centre of mass {k}")
    ax.plot(*_flat(drawing.masses).T, "o", color="C4", ms=4, mec="black", mew=0.4, label="centre of mass")


def _label_mechanism(ax: Axes, drawing: Drawing) -> None:
    """Draws the symbols of masses, lengths and angles."""
    base, elbow = drawing.base, drawing.poses[2, :3, 3]
    _frame(ax, np.eye(4))
    _note(ax, base / 2, "$[T_x, T_y, T_z]^T$", (8, 0))
    _note(ax, (base + elbow) / 2, "$l_1$", (-14, -12))
    for i, (mass, shift) in enumerate(zip(drawing.masses, ((9, -5), (-20, 3), (-6, -10)), strict=True), start=1):
        _note(ax, mass, f"$m_{i}$", shift)
    for k, (origin, direction) in enumerate(((base, base), (elbow, elbow - base)), start=1):
        center, up = _flat(origin), _flat(direction) / np.linalg.norm(_flat(direction))
        ax.plot(*np.array([center, center + 0.36 * up]).T, color="0.4", lw=0.5, ls="--", label=f"straight on {k}")
        # A positive angle about X turns Y towards Z, counterclockwise in the figure.
        sweep = np.arctan2(up[1], up[0]) + np.linspace(0, drawing.q[k - 1], 31)
        arc = center[:, None] + 0.25 * np.array([np.cos(sweep), np.sin(sweep)])
        ax.plot(*arc, color="black", lw=0.7, label=rf"angle $\theta_{k}$")
        middle = np.mean(sweep)
        label = center + 0.34 * np.array([np.cos(middle), np.sin(middle)])
        ax.text(label[0], label[1], rf"$\theta_{k}$", ha="center", va="center")


def _note(ax: Axes, point: np.ndarray, text: str, shift: tuple[int, int]) -> None:
    ax.annotate(text, tuple(_flat(point)), xytext=shift, textcoords="offset points", va="center")


def _frame(ax: Axes, T: np.ndarray) -> None:
    """Draws the axes of a frame: x vermilion, y green, z blue."""
    origin = T[:3, 3]
    for axis, color in enumerate(FRAME_COLORS):
        arrow = {"arrowstyle": "-|>", "color": color, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tuple(_flat(origin + 0.2 * T[:3, axis])), tuple(_flat(origin)), arrowprops=arrow)


def document(drawing: Drawing, difference: float, provenance: dict[str, Any]) -> Document:
    """Both tables and the figure.

    Args:
        drawing: The mechanism.
        difference: Largest difference between it and the mechanism of Table I.
        provenance: Provenance of the results.
    """
    frames = "x vermilion, y green, z blue"
    caption = f"The double pendulum (left) and its frames (right; {frames}), drawn from the scene's geometry."
    same = (
        f"Tables I and II are the same mechanism: poses and twists differ by {difference:.0e} at 100 random postures."
    )
    return Document(
        "The mechanism of the studies (Tables I and II)",
        lines=[same],
        tables={"table_1": table_1(), "table_2": table_2(drawing.tree, drawing.base)},
        figures={"figure_1": Plot(partial(figure_1, drawing), caption)},
        numbers={"provenance": provenance},
    )
