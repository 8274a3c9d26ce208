"""Numbers that the paper prints, its mechanism, and defaults of the studies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from ident.mechanism.tree import Tree

SCENE = "double_pendulum"
"""The paper's scene."""

FORMATS = ("pdf", "png", "svg")
"""File formats of figures that are byte for byte reproducible."""

REDRAWN = {
    "all": "the excitation's and the sensors' noise, every trial being a simulation",
    "sensors": "the sensors' noise around one simulation",
    "wrench": "force and torque noise alone, with exact joint states and poses",
}
"""Noise that is drawn anew for each trial."""

TRAJECTORY_TRIALS = 100
"""Largest number of trials with the trajectory estimate: enough to detect a bias of half a standard deviation."""

CRITERIA = {
    "deviations": "the smallest predicted standard deviations of the base parameters, relative to what the model knows",
    "determinant": "the largest determinant of the information, weighted by the sensors' noise",
    "condition": "the smallest condition number of the base regressor",
}
"""Criteria that a designed excitation minimizes or maximizes."""

SENSORS = ("wrench", "torque")
"""Measurements to design for: the wrench at the base, or the torques of the excited joints."""

SECONDS, VELOCITY, ACCELERATION = 10.0, 1.0, 3.0
"""Duration of an excitation in s, and its limits in rad/s and rad/s² (m/s and m/s² of slides): modest, as models do
not contain them."""

NOISE = 0.5, 0.05
"""Standard deviations of the noise on forces in N, and on moments and torques in N m, for sensors that state none."""

MARGIN = 0.02
"""Share of a joint's range that designs keep free at each stop: servos overshoot, and zeros are off by a degree."""

RANDOM_START = "a random motion within the same limits"
"""Motion that a design is compared with where there is no other."""


TITLE = "A Geometric Approach for Deriving Multicontact Dynamic Identification Models"
AUTHORS = "R. P. Matthew, G. Venture and R. Bajcsy"

TABLE_1 = (
    ("1", "-", "-π/2", "T_x", "0", "T_y"),
    ("2", "Base", "π/2", "0", "0", "T_z"),
    ("3", "-", "0", "0", "-π/2", "0"),
    ("4", "-", "-π/2", "0", "θ_1", "0"),
    ("5", "-", "π/2", "0", "0", "0"),
    ("6", "Link 1", "0", "0", "π/2", "0"),
    ("7", "-", "0", "0", "-π/2", "l_1"),
    ("8", "-", "-π/2", "0", "θ_2", "0"),
    ("9", "-", "π/2", "0", "0", "0"),
    ("10", "Link 2", "0", "0", "π/2", "0"),
)
"""Table I: modified DH frames of the double pendulum, as frame, inertia, α, d, θ, r."""

PARAMETERS = (
    *("m1", "m1rx1", "m1ry1", "m2ry2", "m2rz2", "Ixx2", "Ixy2", "Ixz2"),
    *("m3ry3", "m3rz3", "Ixx3", "Ixy3", "Ixz3"),
)
"""Base parameters of both mechanisms."""

SIMPLIFIED = (0.00, 0.32, -0.03, -0.06, 0.06, 0.04, -1.17, -2.15, -0.09, -0.10, 0.04, -0.42, -0.55)
FULL = (0.00, -0.11, 0.00, 0.14, 0.02, 0.02, 0.13, 0.15, 0.02, 0.00, 0.03, -0.10, 0.16)
TABLE_3 = dict(zip(PARAMETERS, zip(SIMPLIFIED, FULL, strict=True), strict=True))
"""Table III: errors of the simplified and of the full model. They are absolute, in kg, kg m and kg m²."""

TRUE = (20.99, 1.33, 0.00, 0.00, 6.39, 2.41, 0.00, -0.56, 0.00, 2.66, 0.41, 0.00, 0.00)
ERRORS = (0.00, 0.00, -0.01, 0.00, 0.01, 0.08, -0.03, 0.01, 0.00, 0.00, -0.01, 0.00, 0.00)
TABLE_4 = dict(zip(PARAMETERS, zip(TRUE, ERRORS, strict=True), strict=True))
"""Table IV: true values and errors with several contacts."""

SHAPE_SIMPLIFIED = (4715, 13)
SHAPE_FULL = (5658, 13)
"""Section VI: shapes of the two base regressors."""

SAMPLES = SHAPE_FULL[0] // 6
"""Samples of the recordings, for six rows each."""

SHAPE_MULTICONTACT = (4715, 13)
"""Section VII: shape of the base regressor with several contacts."""

SECTION_6 = {
    "error": {
        "simplified": dict(zip(PARAMETERS, SIMPLIFIED, strict=True)),
        "full_on_table": dict(zip(PARAMETERS, FULL, strict=True)),
    },
    "condition_number": {"simplified": 38.1, "full": 334.2},
    "shape": {"simplified": SHAPE_SIMPLIFIED, "full": SHAPE_FULL},
}
SECTION_7 = {
    "true": dict(zip(PARAMETERS, TRUE, strict=True)),
    "error": {"contact": dict(zip(PARAMETERS, ERRORS, strict=True))},
    "condition_number": {"contact": 36.5},
    "shape": {"contact": SHAPE_MULTICONTACT},
}
"""The numbers by model, in the form of study files."""


DRAWN_AT = 0.45, 0.75
"""Joint angles of Figure 1, in rad."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A mechanism and its geometry in one posture, in metres and world axes.

    Attributes:
        tree: The mechanism.
        q: Joint angles, rad (n,).
        base: Position of the base frame (3,).
        poses: Poses of the bodies (b, 4, 4).
        masses: Positions of their centres of mass (b, 3).
        end: End of the last link (3,).
    """

    tree: "Tree"
    q: "np.ndarray"
    base: "np.ndarray"
    poses: "np.ndarray"
    masses: "np.ndarray"
    end: "np.ndarray"


def drawing() -> Drawing:
    """The scene's mechanism, and its geometry at `DRAWN_AT`."""
    import numpy as np

    import scenes
    import sim
    from ident.geometry.inertia import com_from_parameters

    model = scenes.load(SCENE).compile()
    pendulum = sim.mechanism(model, "base")
    tree, base, q = pendulum.tree, model.body("base").pos, np.array(DRAWN_AT)
    poses = tree.poses(q).copy()
    poses[:, :3, 3] += base
    bodies = pendulum.known.reshape(-1, 10)
    masses = [(T @ [*com_from_parameters(phi)[1], 1])[:3] for T, phi in zip(poses, bodies, strict=True)]
    body, site = pendulum.site("end")
    end = (poses[tree.names.index(body)] @ site)[:3, 3]
    return Drawing(tree, q, base, poses, np.array(masses), end)


def tree_of_table_1(base: "Sequence[float] | np.ndarray", length: float) -> "Tree":
    """The mechanism of Table I, with the scene's dimensions for its symbols.

    Args:
        base: `[T_x, T_y, T_z]`, m (3,).
        length: `l_1`, m.
    """
    from math import pi

    from ident.mechanism import dh

    values = {"0": 0.0, "π/2": pi / 2, "-π/2": -pi / 2, "θ_1": 0.0, "θ_2": 0.0, "l_1": length}
    values |= dict(zip(("T_x", "T_y", "T_z"), base, strict=True))
    frames, parent = [], None
    for name, body, *row in TABLE_1:
        alpha, d, theta, r = (values[symbol] for symbol in row)
        kind = "revolute" if row[2].startswith("θ") else "fixed"
        frames.append(dh.Frame(name, parent, kind, alpha, d, theta, r, inertia=body != "-"))
        parent = name
    return dh.tree_from_mdh(frames)


def difference(a: "Tree", b: "Tree") -> float:
    """Largest difference between the body poses and joint twists of two trees, over random joint angles."""
    import numpy as np

    q = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(100, len(a.moving)))
    twists = [abs(x.twist - y.twist).max() for x, y in zip(a.bodies, b.bodies, strict=True)]
    return float(max(abs(a.poses(q) - b.poses(q)).max(), *twists))


def difference_of_tables(tree: "Tree") -> float:
    """Largest difference between the scene's mechanism and that of Table I with the scene's dimensions."""
    return difference(tree_of_table_1((0, 0, 0), tree.bodies[2].home[2, 3]), tree)
