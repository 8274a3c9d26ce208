"""The double pendulum itself: Figure 1 and Table II from the scene's own geometry, and Table I as printed."""

import argparse
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc

import scenes
import sim
from experiments.data import paper
from experiments.data.defaults import SCENE
from experiments.document import figures, report
from experiments.document.page import Said, conclude
from experiments.document.results import Results
from ident.geometry.inertia import com_from_parameters
from ident.mechanism import dh
from ident.mechanism.tree import Tree

DRAWN_AT = np.array([0.45, 0.75])
"""Joint angles of Figure 1, in rad."""

FRAME_COLORS = ("C1", "C2", "C0")


@dataclass(frozen=True, eq=False)
class Drawing:
    """Geometry of Figure 1, in metres and world axes.

    Attributes:
        base: Position of the base frame (3,).
        poses: Poses of the bodies (3, 4, 4).
        masses: Positions of their centres of mass (3, 3).
        end: End of the last link (3,).
    """

    base: np.ndarray
    poses: np.ndarray
    masses: np.ndarray
    end: np.ndarray


def mechanism() -> tuple[Tree, Drawing]:
    """Tree of the scene, and its geometry at `DRAWN_AT`."""
    model = scenes.load(SCENE).compile()
    pendulum = sim.mechanism(model, "base")
    tree, base = pendulum.tree, model.body("base").pos
    poses = tree.poses(DRAWN_AT).copy()
    poses[:, :3, 3] += base
    bodies = pendulum.known.reshape(-1, 10)
    masses = [(T @ [*com_from_parameters(phi)[1], 1])[:3] for T, phi in zip(poses, bodies, strict=True)]
    body, site = pendulum.site("end")
    end = (poses[tree.names.index(body)] @ site)[:3, 3]
    return tree, Drawing(base, poses, np.array(masses), end)


def table_1() -> report.Table:
    """Table I as printed."""
    columns = ("frame", "inertia", "alpha", "d", "theta", "r")
    title, heads = "Modified DH parameters of the double pendulum, as printed", {"alpha": "α", "theta": "θ"}
    return report.Table(title, columns, paper.TABLE_1, heads=heads)


def table_2(tree: Tree, base: np.ndarray) -> report.Table:
    """Table II: home pose in the world's frame and joint twist of each body."""
    home = tree.poses(np.zeros(len(tree.moving)))
    rows = []
    for i, (body, T) in enumerate(zip(tree.bodies, home, strict=True), start=1):
        turned = "1" if np.allclose(T[:3, :3], np.eye(3)) else _numbers(T[:3, :3].ravel())
        cells = (turned, _numbers(T[:3, 3] + base), _numbers(body.twist[:3]), _numbers(body.twist[3:]))
        rows.append((f"{body.name}, i = {i}", *cells))
    return report.Table(
        "Geometric model of the double pendulum",
        ("frame", "initial rotation", "initial position", "twist v", "twist omega"),
        tuple(rows),
        heads={"initial position": "initial position (m)", "twist v": "twist v (m)", "twist omega": "twist ω"},
    )


def tree_of_table_1(base: np.ndarray, length: float) -> Tree:
    """The mechanism of Table I, with the scene's dimensions for its symbols.

    Args:
        base: `[T_x, T_y, T_z]`, m (3,).
        length: `l_1`, m.
    """
    values = {"0": 0.0, "π/2": np.pi / 2, "-π/2": -np.pi / 2, "θ_1": 0.0, "θ_2": 0.0, "l_1": length}
    values |= dict(zip(("T_x", "T_y", "T_z"), base, strict=True))
    frames, parent = [], None
    for name, body, *row in paper.TABLE_1:
        alpha, d, theta, r = (values[symbol] for symbol in row)
        kind = "revolute" if row[2].startswith("θ") else "fixed"
        frames.append(dh.Frame(name, parent, kind, alpha, d, theta, r, inertia=body != "-"))
        parent = name
    return dh.tree_from_mdh(frames)


def difference(a: Tree, b: Tree) -> float:
    """Largest difference between the body poses and joint twists of two trees, over random joint angles."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(100, len(a.moving)))
    twists = [abs(x.twist - y.twist).max() for x, y in zip(a.bodies, b.bodies, strict=True)]
    return float(max(abs(a.poses(q) - b.poses(q)).max(), *twists))


def _numbers(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:g}" for value in values) + ")"


def figure_1(drawing: Drawing) -> Figure:
    """Figure 1: the mechanism on the left, its frames on the right."""
    with figures.paper_style():
        figure = Figure(figsize=(figures.column_width(), 2.8))
        left, right = figure.subplots(1, 2, sharey=True)
        for ax in (left, right):
            _draw_links(ax, drawing)
            ax.set_aspect("equal")
            ax.set_axis_off()
        _label_mechanism(left, drawing)
        labels = (
            ("world", (26, -8)),
            ("$g_1$, base", (-52, -8)),
            ("$g_2$, link 1", (20, 14)),
            ("$g_3$, link 2", (16, 8)),
        )
        for T, (label, shift) in zip([np.eye(4), *drawing.poses], labels, strict=True):
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
    for a, b, width in ((foot, shoulder, 6), (shoulder, elbow, 4), (elbow, drawing.end, 3)):
        ax.plot(*_flat(np.array([a, b])).T, color="0.75", lw=width, solid_capstyle="round")
    ax.plot(*_flat(foot + np.array([[0, -0.25, 0], [0, 0.25, 0]])).T, color="0.3", lw=1)
    for joint in (shoulder, elbow):
        ax.plot(*_flat(joint), "o", color="white", mec="black", ms=5, mew=0.8)
    for T, mass in zip(drawing.poses, drawing.masses, strict=True):
        ax.plot(*_flat(np.array([T[:3, 3], mass])).T, color="0.3", lw=0.6)
    ax.plot(*_flat(drawing.masses).T, "o", color="C4", ms=4, mec="black", mew=0.4)


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
        ax.plot(*np.array([center, center + 0.36 * up]).T, color="0.4", lw=0.5, ls="--")
        # A positive angle about X turns Y towards Z, counterclockwise in the figure.
        start = np.degrees(np.arctan2(up[1], up[0]))
        sweep = start, start + np.degrees(DRAWN_AT[k - 1])
        ax.add_patch(Arc((center[0], center[1]), 0.5, 0.5, theta1=sweep[0], theta2=sweep[1], lw=0.7))
        middle = np.radians(np.mean(sweep))
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


def results(tree: Tree, drawing: Drawing) -> Results:
    """Both tables and the figure."""
    frames = "x vermilion, y green, z blue"
    caption = f"The double pendulum (left) and its frames (right; {frames}), drawn from the scene's geometry."
    return Results(
        tables={"table_1": table_1(), "table_2": table_2(tree, drawing.base)},
        figures={"figure_1": (figure_1(drawing), caption)},
    )


def run(args: argparse.Namespace) -> Results:
    """Writes and prints the mechanism."""
    tree, drawing = mechanism()
    origin = report.provenance({"formats": args.formats}, {"scene": SCENE})
    length = tree.bodies[2].home[2, 3]
    apart = difference(tree_of_table_1(np.zeros(3), length), tree)
    same = f"Tables I and II are the same mechanism: poses and twists differ by {apart:.0e} at 100 random postures."
    said = Said("The mechanism of the studies (Tables I and II)", lines=[same])
    return conclude(args, results(tree, drawing), said, origin)
