"""Random and well-known mechanisms for the tests."""

import numpy as np
from scipy.spatial.transform import Rotation

from ident.geometry import se3
from ident.mechanism.body import Body, ball_twist, free_joint
from ident.mechanism.tree import Tree

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
        "ball": lambda: ball_twist(rng.normal(size=3)),
        "welded": lambda: np.zeros(6),
    }[kind]()


JOINTS = ("revolute", "prismatic", "helical", "ball", "free", "welded")
SCREWS = ("revolute", "prismatic", "helical", "welded")


def random_tree(rng, bodies=None, kinds=JOINTS, massless=0.0, chain=False):
    """A base and bodies on it, each on the previous one in a `chain`; `massless`: probability of a massless link."""
    bodies = bodies or rng.integers(2, 9)
    tree, ends = [], [-1]
    for i in range(bodies):
        kind = str(rng.choice(kinds)) if i else "welded"
        parent = ends[-1] if chain else int(rng.choice(ends))
        if kind == "free":
            tree += free_joint(f"j{i}", f"b{i}", parent, len(tree))
        else:
            twist, light = random_twist(rng, kind), bool(i and rng.uniform() < massless)
            tree.append(Body(f"b{i}", parent, random_pose(rng), twist, f"j{i}" if twist.any() else "", light))
        ends.append(len(tree) - 1)
    return Tree(tuple(tree))


def random_states(rng, tree, samples):
    """q, q̇ and q̈; quaternions of any length."""
    q, dq, ddq = (rng.uniform(-2, 2, size=(samples, len(tree.freedoms))) for _ in range(3))
    if any(body.is_ball for body in tree.bodies):
        q = rng.uniform(-2, 2, size=(samples, sum(body.coordinates for body in tree.bodies)))
    return q, dq, ddq


def moved_states(tree, q, dq, ddq, t):
    """q and q̇ after a time t at constant accelerations; for balls right to second order in t."""
    parts = []
    for body, x, dx, ddx in zip(
        tree.bodies, tree.body_coordinates(q), tree.body_velocities(dq), tree.body_velocities(ddq), strict=True
    ):
        step = dx * t + ddx * t**2 / 2
        if body.is_ball:
            turned = Rotation.from_quat(x, scalar_first=True) * Rotation.from_rotvec(step)
            parts.append(turned.as_quat(scalar_first=True))
        else:
            parts.append(x + step)
    return np.concatenate(parts), dq + ddq * t


def random_phi(rng, bodies):
    """φ of physical bodies: each a cloud of ten point masses."""
    phi = []
    for _ in range(bodies):
        m, x = rng.uniform(0.1, 1, 10), rng.normal(size=(10, 3))
        inertia = sum(mk * (xk @ xk * np.eye(3) - np.outer(xk, xk)) for mk, xk in zip(m, x, strict=True))
        phi.append([m.sum(), *(m @ x), *inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])
    return np.concatenate(phi)


def regrouping_error(base, Y):
    """Largest error of a regressor's dependent columns (…, P) formed from the kept ones, over its largest entry."""
    return abs(Y[..., base.dependent] - base.reduce(Y) @ base.beta).max(initial=0) / abs(Y).max()


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


def unhat(matrix):
    return np.array([*matrix[:3, 3], matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def by_joint(joints, **kinds):
    """Channels of joints from an array (N, n) for each kind."""
    return {f"{joint}_{kind}": x for kind, every in kinds.items() for joint, x in zip(joints, every.T, strict=True)}


def sines(time, size, rate, phase):
    """Sums over the last axis of sines at times (N,), and their first and second derivatives, (N, …) each."""
    angle = time.reshape(-1, *np.ndim(size) * (1,)) * rate + phase
    return tuple((size * x).sum(axis=-1) for x in (np.sin(angle), rate * np.cos(angle), -(rate**2) * np.sin(angle)))
