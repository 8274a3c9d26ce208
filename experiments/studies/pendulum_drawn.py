"""The double pendulum itself, from the scene's geometry and from the paper's Table I."""

from dataclasses import dataclass

import numpy as np

import scenes
import sim
from experiments.data import paper
from experiments.data.paper import SCENE
from ident.geometry.inertia import com_from_parameters
from ident.mechanism import dh
from ident.mechanism.tree import Tree

DRAWN_AT = np.array([0.45, 0.75])
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

    tree: Tree
    q: np.ndarray
    base: np.ndarray
    poses: np.ndarray
    masses: np.ndarray
    end: np.ndarray


def drawing() -> Drawing:
    """The scene's mechanism, and its geometry at `DRAWN_AT`."""
    model = scenes.load(SCENE).compile()
    pendulum = sim.mechanism(model, "base")
    tree, base = pendulum.tree, model.body("base").pos
    poses = tree.poses(DRAWN_AT).copy()
    poses[:, :3, 3] += base
    bodies = pendulum.known.reshape(-1, 10)
    masses = [(T @ [*com_from_parameters(phi)[1], 1])[:3] for T, phi in zip(poses, bodies, strict=True)]
    body, site = pendulum.site("end")
    end = (poses[tree.names.index(body)] @ site)[:3, 3]
    return Drawing(tree, DRAWN_AT, base, poses, np.array(masses), end)


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


def difference_of_tables(tree: Tree) -> float:
    """Largest difference between the scene's mechanism and that of Table I with the scene's dimensions."""
    return difference(tree_of_table_1(np.zeros(3), tree.bodies[2].home[2, 3]), tree)
