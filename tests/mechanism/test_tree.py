"""Trees of bodies, from tables of modified Denavit-Hartenberg parameters, and with joints that follow others."""

from dataclasses import replace

import numpy as np
import pytest
from closeness import close
from mechanisms import GRAVITY, double_pendulum, random_phi, random_pose, random_states, random_tree, random_twist
from scipy.spatial.transform import Rotation

from ident.errors import ModelError
from ident.geometry.se3 import pose
from ident.mechanism.body import BASE, Body, Follower, ball_twist, free_joint
from ident.mechanism.dh import Frame, tree_from_mdh
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors

BOTH = (base_wrench_regressor, joint_torque_regressor)


def test_table_2_is_a_double_pendulum():
    tree, (q1, q2) = double_pendulum(base=(0.1, 0.2, 0.3)), (0.4, -1.1)
    poses = tree.poses(np.array([q1, q2]))
    elbow = np.array([0.1, 0.2 - 0.425 * np.sin(q1), 0.3 + 0.425 * np.cos(q1)])
    close(poses[2][:3, 3], elbow)
    close((poses[2] @ [0, 0, 1, 1])[:3] - elbow, np.array([0, -np.sin(q1 + q2), np.cos(q1 + q2)]))
    assert tree.joints == ("link1", "link2")


@pytest.mark.parametrize("seed", range(3))
def test_merged_welds_need_the_same_wrench_and_torques(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, 8, kinds=("revolute", "ball", "welded", "welded"), massless=0.3)
    merged, X = tree.without_welds()
    assert sum(not body.moves for body in merged.bodies) <= 1 and merged.joints == tree.joints
    states, phi = random_states(rng, tree, 3), random_phi(rng, len(tree.inertial))
    for of in BOTH:
        close(of(merged, *states, gravity=GRAVITY) @ (X @ phi), of(tree, *states, gravity=GRAVITY) @ phi)


@pytest.mark.parametrize("seed", range(4))
def test_fixed_joints_stand_still(seed):
    """Regressors of the tree with these joints' coordinates constant and their rates zero."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, 6, massless=0.2)
    states = random_states(rng, tree, 4)
    names = {tree.bodies[i].joint for i in tree.moving if rng.uniform() < 0.5}
    coordinates = {}
    dealt = [tree.body_coordinates(states[0]), *(tree.body_velocities(x) for x in states[1:])]
    for body, q, dq, ddq in zip(tree.bodies, *dealt, strict=True):
        if body.joint in names:
            q[:], dq[:], ddq[:] = q[0], 0, 0
            coordinates[body.joint] = q[0]
    fixed = tree.fixed(coordinates)
    assert set(fixed.joints) == set(tree.joints) - names
    moves = [body.joint not in names for body in tree.bodies]
    less = [np.hstack([x for x, k in zip(part, moves, strict=True) if k] or [np.empty((4, 0))]) for part in dealt]
    close(fixed.poses(less[0]), tree.poses(states[0]))
    expected = base_wrench_regressor(tree, *states, gravity=GRAVITY)
    close(base_wrench_regressor(fixed, *less, gravity=GRAVITY), expected)


def test_a_mechanism_floats_where_the_joints_of_its_first_body_leave_it_free():
    pelvis = Body("pelvis", 2, np.eye(4), ball_twist(np.ones(3)), "turn")
    slides = free_joint("root", "pelvis", -1, 0)[:3]
    free = Tree((*slides, pelvis, Body("foot", 3, np.eye(4), np.eye(6)[3], "hip")))
    assert free.floats and Tree(free_joint("root", "pelvis", -1, 0)).floats
    # Twice the same direction, a massive link in between, a second body on the base, a fixed joint.
    twice = replace(slides[2], twist=np.eye(6)[0])
    assert not Tree((*slides[:2], twice, pelvis)).floats
    assert not Tree((slides[0], replace(slides[1], massless=False), slides[2], pelvis)).floats
    assert not Tree((*free.bodies, Body("chair", -1, np.eye(4), np.zeros(6)))).floats
    assert not free.fixed({"root:x": [0.0]}).floats
    assert not random_tree(np.random.default_rng(0), 3).floats and not double_pendulum().floats


def turned(axis, angle):
    return pose(Rotation.from_euler(axis, angle).as_matrix(), np.zeros(3))


def shifted(x=0.0, z=0.0):
    return pose(np.eye(3), np.array([x, 0, z]))


def test_a_row_is_khalil_and_kleinfingers_product():
    """The joint adds to its angle or distance."""
    row = {"alpha": 0.3, "d": 0.2, "theta": -1.1, "r": 0.7, "gamma": 0.5, "b": -0.4}
    for kind, moved, by in (("fixed", "r", 0.0), ("revolute", "theta", 0.6), ("prismatic", "r", 0.6)):
        theta, r = (row[name] + by * (name == moved) for name in ("theta", "r"))
        expected = turned("z", 0.5) @ shifted(z=-0.4) @ turned("x", 0.3) @ shifted(0.2) @ turned("z", theta)
        tree = tree_from_mdh([Frame("1", None, kind, **row)])
        close(tree.poses(np.full(len(tree.joints), by))[0], expected @ shifted(z=r))


def test_fixed_frames_fold_away_on_a_branching_tree():
    tree = tree_from_mdh(
        [
            Frame("pedestal", None, "fixed", r=0.5),
            Frame("turn", "pedestal", "revolute", alpha=0.4, inertia=False),
            Frame("column", "turn", "fixed", d=0.3),
            Frame("left", "column", "revolute", gamma=0.2, d=0.1),
            Frame("right", "column", "prismatic", gamma=-0.2, d=0.1, inertia=False),
            Frame("tool", "right", "fixed", theta=0.3, r=0.2),
            Frame("camera", "right", "fixed", d=0.1),
        ]
    )
    assert tree.names == ("pedestal", "column", "left", "tool", "camera")
    assert [body.parent for body in tree.bodies] == [BASE, 0, 1, 1, 3]
    assert tree.joints == ("turn", "left", "right")
    column = shifted(z=0.5) @ turned("x", 0.4) @ turned("z", 0.3) @ shifted(0.3)
    left = column @ turned("z", 0.2) @ shifted(0.1) @ turned("z", -0.8)
    right = column @ turned("z", -0.2) @ shifted(0.1) @ shifted(z=0.25)
    tool, camera = right @ turned("z", 0.3) @ shifted(z=0.2), right @ shifted(0.1)
    close(tree.poses(np.array([0.3, -0.8, 0.25]))[1:], np.array([column, left, tool, camera]))


def test_a_parallelogram_of_dependent_joints_keeps_its_last_link_upright():
    """Khalil and Dombre's table of a parallelogram, opened: the last link turns back by what those before it turned."""
    rows = [
        Frame("1", None, "revolute", alpha=0.0),
        Frame("2", "1", "revolute", alpha=np.pi / 2, d=0.2),
        Frame("3", "2", "revolute", d=0.5, follows={"2": -1.0}, constant=np.pi / 2),
        Frame("4", "3", "revolute", d=0.4, follows={"3": 2.0, "1": 0.5}, constant=0.1),
    ]
    tree, free = tree_from_mdh(rows), tree_from_mdh([replace(row, follows={}, constant=0.0) for row in rows])
    assert tree.joints == ("1", "2") and tree.dependent == ("3", "4")
    q = np.random.default_rng(0).normal(size=(5, 2))
    third = np.pi / 2 - q[:, 1]
    close(tree.poses(q), free.poses(np.stack([*q.T, third, 0.1 + 2 * third + 0.5 * q[:, 0]], axis=1)))
    close(tree.poses(q)[:, 2, :3, 0], np.tile([0, 0, 1.0], (5, 1)))


def knee(seed, free=False):
    """Thigh, a slide that follows the knee, the knee after it, a patella that follows too; independent if `free`."""
    rng = np.random.default_rng(seed)
    leads = [Follower("knee", tuple(rng.normal(size=n)), (-1.0, 2.0)) for n in (4, 3)]
    bodies = []
    for name, parent, kind, joint, follows in (
        ("thigh", -1, "revolute", "hip", None),
        ("slide", 0, "prismatic", "", leads[0]),
        ("shank", 1, "revolute", "knee", None),
        ("patella", 0, "revolute", "", leads[1]),
    ):
        given = (joint or name, name == "slide") if free else (joint, name == "slide", follows)
        bodies.append(Body(name, parent, random_pose(rng), random_twist(rng, kind), *given))
    return Tree(tuple(bodies)), leads


def as_free(leads, states):
    """States of all four joints, from those of hip and knee."""
    followed = [lead.states(*(x[:, 1] for x in states)) for lead in leads]
    return [np.stack([x[:, 0], followed[0][k], x[:, 1], followed[1][k]], axis=1) for k, x in enumerate(states)]


@pytest.mark.parametrize("seed", range(3))
def test_a_follower_moves_as_a_joint_of_its_own_would(seed):
    (tree, leads), (free, _) = knee(seed), knee(seed, free=True)
    assert tree.joints == tree.freedoms == ("hip", "knee")
    states = random_states(np.random.default_rng(seed), tree, 7)
    every = as_free(leads, states)
    close(tree.poses(states[0]), free.poses(every[0]))
    wrench, torques = (of(tree, *states, gravity=GRAVITY) for of in BOTH)
    expected, each = (of(free, *every, gravity=GRAVITY) for of in BOTH)
    close(wrench, expected)
    # Power: the leader's torque does the work of all joints that it moves.
    slide, patella = (lead.slope(states[0][:, 1])[:, None] for lead in leads)
    close(torques, np.stack([each[:, 0], each[:, 2] + slide * each[:, 1] + patella * each[:, 3]], axis=1))


@pytest.mark.parametrize("sensors", [Sensors(), Sensors(False, True), Sensors(moving_base=True)])
def test_the_regrouping_holds_at_other_states(sensors):
    (tree, _), (free, _), rng = knee(2), knee(2, free=True), np.random.default_rng(8)
    base, of_free = (find_base_parameters(Mechanism(each, GRAVITY), sensors=sensors) for each in (tree, free))
    assert base.rank <= of_free.rank
    regressor = joint_torque_regressor if sensors.joint_torques else base_wrench_regressor
    moving = BaseMotion.from_free_joint(rng.normal(size=(40, 7)), *rng.normal(size=(2, 40, 6)))
    given = {"gravity": GRAVITY, "base": moving if sensors.moving_base else None}
    Y = regressor(tree, *random_states(rng, tree, 40), **given).reshape(-1, 30)
    np.testing.assert_allclose(Y[:, base.dependent], base.reduce(Y) @ base.beta, atol=1e-8 * abs(Y).max())
    assert np.linalg.matrix_rank(base.reduce(Y)) == base.rank


def test_a_follower_needs_a_leader_and_one_axis():
    tree, _ = knee(0)
    lost = replace(tree.bodies[3], follows=Follower("ankle", (0.0, 1.0)))
    with pytest.raises(ModelError, match="follows 'ankle', which is no joint with one coordinate of its tree; "):
        Tree((*tree.bodies[:3], lost))
    with pytest.raises(ModelError, match="needs one axis and no joint"):
        replace(tree.bodies[3], joint="patella")
    with pytest.raises(ModelError, match="finite coefficients and a span"):
        Follower("knee", (0.0, np.nan))
