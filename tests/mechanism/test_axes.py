"""Screws and axes recovered from noisy poses."""

import numpy as np
import pytest
from mechanisms import double_pendulum, random_pose, random_twist, tilted_axis, unit_vector
from scipy.spatial.transform import Rotation

from ident.geometry import se3
from ident.mechanism.body import BASE, Body
from ident.mechanism.recovered_axes import estimate_screw, recover_axes
from ident.mechanism.tree import Tree

TIME = np.arange(400) / 100
ANGLES = np.stack([0.8 * np.sin(3 * TIME) - 1, np.sin(5 * TIME + 1) + 1], axis=1)
DESIGN, AXIS = double_pendulum(), tilted_axis(5, 120)
POSES = double_pendulum(AXIS, AXIS).poses(ANGLES)


def noisy(poses, rng):
    """Poses with noise of half a degree and a millimetre."""
    out = poses.copy()
    turn = Rotation.from_rotvec(np.radians(0.5) * rng.normal(size=(np.prod(poses.shape[:-2]), 3))).as_matrix()
    out[..., :3, :3] = poses[..., :3, :3] @ turn.reshape(*poses.shape[:-2], 3, 3)
    out[..., :3, 3] += 1e-3 * rng.normal(size=out[..., :3, 3].shape)
    return out


@pytest.mark.parametrize("seed", range(3))
def test_exact_poses_give_the_exact_screw(seed):
    rng = np.random.default_rng(seed)
    twist = random_twist(rng, "revolute")
    screw = estimate_screw(se3.exp(twist, rng.normal(size=50)), twist[3:] + 0.1 * rng.normal(size=3))
    np.testing.assert_allclose(screw.axis.vector, twist[3:], atol=1e-12)
    np.testing.assert_allclose(screw.point, np.cross(twist[3:], twist[:3]), atol=1e-12)
    assert screw.axis.std < 1e-12


def test_standard_deviation_is_the_spread():
    rng = np.random.default_rng(0)
    twist = random_twist(rng, "revolute")
    exact = se3.exp(twist, ANGLES[:, 0])
    screws = [estimate_screw(noisy(exact, rng), twist[3:]) for _ in range(400)]
    errors = np.array([s.axis.vector - twist[3:] for s in screws])
    spread = np.sqrt(np.mean(np.sum(errors**2, axis=1)) / 2)
    # 800 independent components determine their standard deviation to 2.5 %.
    assert np.isclose(np.mean([s.axis.std for s in screws]), spread, rtol=0.1)
    assert np.linalg.norm(errors.mean(axis=0)) < 4 * spread * np.sqrt(2 / 400)


def test_parallel_axes_come_out_as_one_direction():
    recovered = recover_axes(DESIGN, noisy(POSES, np.random.default_rng(0)))
    assert recovered.groups == ((0, 1),)
    np.testing.assert_array_equal(recovered.tree.bodies[1].twist, recovered.tree.bodies[2].twist)
    assert np.arccos(recovered.axes[0].vector @ AXIS) < 4 * recovered.axes[0].std < np.radians(0.2)
    first, second = (d.vector for d in recovered.separate)
    assert 0 < np.linalg.norm(first - second) < np.radians(0.2)
    assert abs(recovered.points).max() < 2e-3


def test_each_axis_is_compared_with_the_next_one_towards_the_base():
    twists, home = np.eye(6)[[3, 4, 4]], se3.pose(np.eye(3), np.array([0, 0, 0.3]))
    tree = Tree(tuple(Body(f"b{k}", k - 1, home, twist, f"j{k}") for k, twist in enumerate(twists)))
    poses = noisy(tree.poses(np.c_[ANGLES, ANGLES[:, 0]]), np.random.default_rng(0))
    assert recover_axes(tree, poses).groups == ((0,), (1, 2))


def test_p_values_of_parallel_axes_are_uniform():
    rng, trials = np.random.default_rng(0), 200
    p = np.sort([recover_axes(DESIGN, noisy(POSES, rng)).p_values[1] for _ in range(trials)])
    # Kolmogorov-Smirnov distance at the level of 1 %.
    assert abs(p - np.arange(0.5, trials) / trials).max() < 1.63 / np.sqrt(trials)


def test_axes_in_turned_frames_off_the_origin_and_on_branches():
    """The direction turns; the point of the design's axis nearest to the origin stays on it."""
    rng = np.random.default_rng(1)
    true = [Body("base", BASE, np.eye(4), np.zeros(6))]
    design = list(true)
    for i, parent in enumerate((0, 1, 0)):
        axis, point, home = unit_vector(rng), rng.normal(size=3), random_pose(rng)
        off = axis + 0.05 * rng.normal(size=3)
        for bodies, own in ((true, axis), (design, off / np.linalg.norm(off))):
            bodies.append(Body(f"b{i}", parent, home, np.concatenate([np.cross(point, own), own]), f"j{i}"))
    recovered = recover_axes(Tree(tuple(design)), Tree(tuple(true)).poses(rng.normal(size=(50, 3))), significance=1e-4)
    assert recovered.groups == ((0,), (1,), (2,))
    assert np.isnan(recovered.p_values[[0, 2]]).all()
    own, exact, nominal = (np.array([body.twist for body in x[1:]]) for x in (recovered.tree.bodies, true, design))
    np.testing.assert_allclose(own[:, 3:], exact[:, 3:], atol=1e-12)
    points = np.cross(nominal[:, 3:], nominal[:, :3])
    np.testing.assert_allclose(own[:, :3], np.cross(points, own[:, 3:]), atol=1e-12)
