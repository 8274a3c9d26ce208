"""Random and well-known mechanisms for the tests."""

import numpy as np

from ident import se3
from ident.tree import Body, Tree

GRAVITY = np.array([0.0, 0.0, -9.81])
LENGTH_1 = 0.425


def unit_vector(rng):
    x = rng.normal(size=3)
    return x / np.linalg.norm(x)


def random_pose(rng):
    return se3.exp(np.concatenate([rng.normal(size=3), unit_vector(rng)]), rng.uniform(-3, 3))


def random_twist(rng, kind):
    axis = unit_vector(rng)
    return {
        "revolute": lambda: np.concatenate([np.cross(rng.normal(size=3), axis), axis]),
        "prismatic": lambda: np.concatenate([axis, np.zeros(3)]),
        "helical": lambda: np.concatenate([rng.normal(size=3), axis]),
        "welded": lambda: np.zeros(6),
    }[kind]()


def random_tree(rng, bodies=None, kinds=("revolute", "prismatic", "helical", "welded")):
    bodies = bodies or rng.integers(2, 9)
    tree = []
    for i in range(bodies):
        twist = random_twist(rng, rng.choice(kinds) if i else "welded")
        tree.append(Body(f"b{i}", int(rng.integers(-1, i)), random_pose(rng), twist, f"j{i}" if twist.any() else ""))
    return Tree(tuple(tree))


def random_states(rng, tree, samples):
    return rng.uniform(-2, 2, size=(3, samples, len(tree.moving)))


def random_phi(rng, bodies):
    """φ of physical bodies: each a cloud of ten point masses."""
    phi = []
    for _ in range(bodies):
        m, x = rng.uniform(0.1, 1, 10), rng.normal(size=(10, 3))
        inertia = sum(mk * (xk @ xk * np.eye(3) - np.outer(xk, xk)) for mk, xk in zip(m, x, strict=True))
        phi.append([m.sum(), *(m @ x), *inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])
    return np.concatenate(phi)


def double_pendulum(axis_1=(1, 0, 0), axis_2=(1, 0, 0), base=(0, 0, 0)):
    """Table II with T = base and l_1 = 0.425 m."""
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, 3] = base
    T[2, 2, 3] += LENGTH_1
    xi = np.zeros((3, 6))
    xi[1, 3:], xi[2, 3:] = axis_1, axis_2
    return Tree.from_home_poses(["base", "link1", "link2"], T, xi)


def tilted_axis(tilt_deg, azimuth_deg):
    t, a = np.radians([tilt_deg, azimuth_deg])
    return np.array([np.cos(t), np.sin(t) * np.cos(a), np.sin(t) * np.sin(a)])
