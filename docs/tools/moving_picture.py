"""README's animation: a double pendulum held by a hand, the forces on it, and the prediction of the estimate."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from experiments.data.simulated import SimulatedStudy
from experiments.document import figures, styles
from ident.files.atomic import replacing

CONTACT = "handle"
"""The contact in the animation: a hand at the end of the second link."""

FRAMES_PER_SECOND = 10
WINDOW = (1.7, 7.7)
"""Times in the animation, s."""

METRES_PER_NEWTON = 1 / 500
CHANNEL = 3
"""τ_x, the moment about the joints' axes."""

GROUND, HAND, TOTAL, ESTIMATE = "C1", "C2", "black", "C0"


def moving_figure(result: SimulatedStudy) -> tuple[Figure, Callable[[int], None]]:
    """The mechanism from the side with its force arrows, beside the moment at the base over time.

    Args:
        result: The study with `CONTACT` alone.

    Returns:
        The figure, and a function that draws one sample into it.
    """
    figure = Figure(figsize=(6.4, 3.0), layout=ConstrainedLayoutEngine(h_pad=0.08))
    side, curves = figure.subplots(1, 2, width_ratios=(1, 1.3))
    cursor = _draw_curves(curves, result)
    points, forces = _points(result), _forces(result)

    def drawn(sample: int) -> None:
        _draw_side(side, points[sample], forces[sample])
        cursor.set_xdata([result.recording.time[sample]] * 2)

    return figure, drawn


def save(result: SimulatedStudy, path: Path) -> None:
    """Writes the animation as a GIF."""
    first, last = np.searchsorted(result.recording.time, WINDOW)
    writer = PillowWriter(FRAMES_PER_SECOND)
    with styles.paper_style(), replacing(path) as temporary:
        figure, drawn = moving_figure(result)
        with writer.saving(figure, temporary, dpi=100):
            for sample in range(int(first), int(last), round(result.recording.rate / FRAMES_PER_SECOND)):
                drawn(sample)
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


def _forces(result: SimulatedStudy) -> np.ndarray:
    """Forces of ground and hand on the mechanism, in Y and Z of the base frame, N (N, 2, 2)."""
    ground = result.recording.wrench("ground").values
    # By Eq. 17 the total is the ground's wrench less the one that the link exerts on the hand.
    return np.stack([ground, result.measured.values - ground], axis=1)[..., 1:3]


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
        ax.annotate("", start + METRES_PER_NEWTON * force, start, arrowprops=arrow, annotation_clip=False)
        ax.text(0.2, height, f"{name}: {np.hypot(*force):.0f} N", color=color, fontsize=9)


def _draw_curves(ax: Axes, result: SimulatedStudy) -> Line2D:
    """Draws the moment about X over time, from the ground, with the hand, and predicted; returns the cursor."""
    time, (symbol, unit) = result.recording.time, figures.SYMBOLS[CHANNEL]
    for label, wrench, line in (
        ("ground", result.recording.wrench("ground").values, figures.Line(GROUND, 1.0)),
        ("ground and hand", result.measured.values, figures.Line(TOTAL, 2.2)),
        (r"predicted, $Y\psi$", result.fit("contact").predicted, figures.Line(ESTIMATE, 1.2, "--")),
    ):
        ax.plot(time, wrench[:, CHANNEL], color=line.color, lw=line.width, ls=line.style, label=label)
    ax.set(xlim=WINDOW, xlabel="Time (s)", ylabel=f"${symbol}$ ({unit})")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=3, handlelength=1.4, columnspacing=1.0, fontsize=7)
    return ax.axvline(WINDOW[0], color="0.5", lw=1)
