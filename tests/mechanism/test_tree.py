"""Trees of bodies, from tables of modified Denavit-Hartenberg parameters, and with joints that follow others."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import GRAVITY, double_pendulum, random_phi, random_pose, random_states, random_tree, random_twist

from ident.errors import ModelError
from ident.mechanism.body import BASE, Body, Follower, ball_twist, free_joint
from ident.mechanism.dh import Frame, tree_from_mdh
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors


def test_table_2_is_a_double_pendulum():
    tree = double_pendulum(base=(0.1, 0.2, 0.3))
    q1, q2 = 0.4, -1.1
    poses = tree.poses(np.array([q1, q2]))
    end = poses[2] @ [0, 0, 1, 1]
    elbow = np.array([0.1, 0.2 - 0.425 * np.sin(q1), 0.3 + 0.425 * np.cos(q1)])
    np.testing.assert_allclose(poses[2][:3, 3], elbow, atol=1e-15)
    np.testing.assert_allclose(end[:3] - elbow, [0, -np.sin(q1 + q2), np.cos(q1 + q2)], atol=1e-15)
    assert tree.joints == ("link1", "link2")


@pytest.mark.parametrize("seed", range(6))
def test_merged_welds_need_the_same_wrench_and_torques(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, 8, kinds=("revolute", "ball", "welded", "welded"), massless=0.3)
    merged, X = tree.without_welds()
    assert sum(not body.moves for body in merged.bodies) <= 1
    assert merged.joints == tree.joints
    states, phi = random_states(rng, tree, 3), random_phi(rng, len(tree.inertial))
    for regressor in (base_wrench_regressor, joint_torque_regressor):
        expected = regressor(tree, *states, gravity=GRAVITY) @ phi
        computed = regressor(merged, *states, gravity=GRAVITY) @ (X @ phi)
        np.testing.assert_allclose(computed, expected, atol=1e-12 * max(1, abs(expected).max(initial=0)))


def test_fixed_joints_stand_still():
    """Regressors of the tree with these joints' coordinates constant and their rates zero."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        tree = random_tree(rng, massless=0.2)
        if not tree.moving:
            continue
        states = random_states(rng, tree, 4)
        still = [tree.bodies[i] for i in tree.moving if rng.uniform() < 0.5]
        names = {body.joint for body in still}
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
        np.testing.assert_allclose(fixed.poses(less[0]), tree.poses(states[0]), atol=1e-12)
        expected = base_wrench_regressor(tree, *states, gravity=GRAVITY)
        computed = base_wrench_regressor(fixed, *less, gravity=GRAVITY)
        np.testing.assert_allclose(computed, expected, atol=1e-11 * abs(expected).max())


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


def rotation(axis, angle):
    i, j = [k for k in range(3) if k != axis]
    R = np.eye(4)
    R[i, i] = R[j, j] = np.cos(angle)
    R[i, j], R[j, i] = (-np.sin(angle), np.sin(angle)) if axis != 1 else (np.sin(angle), -np.sin(angle))
    return R


def translation(axis, amount):
    T = np.eye(4)
    T[axis, 3] = amount
    return T


def test_a_row_is_khalil_and_kleinfingers_product():
    frame = Frame("1", None, "fixed", alpha=0.3, d=0.2, theta=-1.1, r=0.7, gamma=0.5, b=-0.4)
    expected = rotation(2, 0.5) @ translation(2, -0.4) @ rotation(0, 0.3) @ translation(0, 0.2)
    expected = expected @ rotation(2, -1.1) @ translation(2, 0.7)
    np.testing.assert_allclose(frame.home, expected, atol=1e-15)


@pytest.mark.parametrize(("kind", "moved"), [("revolute", "theta"), ("prismatic", "r")])
def test_the_joint_adds_to_its_angle_or_distance(kind, moved):
    row = {"alpha": 0.3, "d": 0.2, "theta": -1.1, "r": 0.7}
    tree = tree_from_mdh([Frame("1", None, kind, **row)])
    shifted = Frame("1", None, "fixed", **(row | {moved: row[moved] + 0.6}))
    np.testing.assert_allclose(tree.poses(np.array([0.6]))[0], shifted.home, atol=1e-15)


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
    q = np.array([0.3, -0.8, 0.25])
    at = {name: T for name, T in zip(tree.names, tree.poses(q), strict=True)}
    turn = translation(2, 0.5) @ rotation(0, 0.4) @ rotation(2, 0.3)
    column = turn @ translation(0, 0.3)
    right = column @ rotation(2, -0.2) @ translation(0, 0.1) @ translation(2, 0.25)
    np.testing.assert_allclose(at["column"], column, atol=1e-15)
    left = column @ rotation(2, 0.2) @ translation(0, 0.1) @ rotation(2, -0.8)
    np.testing.assert_allclose(at["left"], left, atol=1e-15)
    np.testing.assert_allclose(at["tool"], right @ rotation(2, 0.3) @ translation(2, 0.2), atol=1e-15)
    np.testing.assert_allclose(at["camera"], right @ translation(0, 0.1), atol=1e-15)


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
    every = np.stack([*q.T, third, 0.1 + 2 * third + 0.5 * q[:, 0]], axis=1)
    np.testing.assert_allclose(tree.poses(q), free.poses(every), atol=1e-12)
    upright = tree.poses(q)[:, 2, :3, 0]
    np.testing.assert_allclose(upright, np.tile([0, 0, 1.0], (5, 1)), atol=1e-12)


def knee(seed, free=False):
    """Thigh, a slide that follows the knee, the knee after it, a patella that follows too; independent if `free`."""
    rng = np.random.default_rng(seed)
    leads = [Follower("knee", tuple(rng.normal(size=n)), (-1.0, 2.0)) for n in (4, 3)]
    rows = [("thigh", -1, "revolute", "hip"), ("slide", 0, "prismatic", leads[0]), ("shank", 1, "revolute", "knee")]
    bodies = []
    for name, parent, kind, joint in (*rows, ("patella", 0, "revolute", leads[1])):
        body = Body(name, parent, random_pose(rng), random_twist(rng, kind), "", name == "slide")
        follows = None if isinstance(joint, str) else joint
        named = replace(body, joint=name if free and follows else joint if isinstance(joint, str) else "")
        bodies.append(named if free else replace(named, follows=follows))
    return Tree(tuple(bodies)), leads, random_phi(rng, 3)


def as_free(leads, q, dq, ddq):
    """States of all four joints, from those of hip and knee."""
    columns = []
    for k, x in enumerate((q, dq, ddq)):
        slide, patella = (lead.states(q[:, 1], dq[:, 1], ddq[:, 1])[k] for lead in leads)
        columns.append(np.stack([x[:, 0], slide, x[:, 1], patella], axis=1))
    return columns


@pytest.mark.parametrize("seed", range(5))
def test_a_follower_moves_as_a_joint_of_its_own_would(seed):
    tree, leads, _ = knee(seed)
    free = knee(seed, free=True)[0]
    assert tree.joints == tree.freedoms == ("hip", "knee")
    q, dq, ddq = states = random_states(np.random.default_rng(seed), tree, 7)
    np.testing.assert_allclose(tree.poses(q), free.poses(as_free(leads, *states)[0]), atol=1e-12)
    Y = base_wrench_regressor(tree, q, dq, ddq, gravity=GRAVITY)
    expected = base_wrench_regressor(free, *as_free(leads, *states), gravity=GRAVITY)
    np.testing.assert_allclose(Y, expected, atol=1e-12 * abs(expected).max())
    # Power: the leader's torque does the work of all joints that it moves.
    torques = joint_torque_regressor(tree, q, dq, ddq, gravity=GRAVITY)
    each = joint_torque_regressor(free, *as_free(leads, *states), gravity=GRAVITY)
    slopes = [lead.slope(q[:, 1])[:, None] for lead in leads]
    np.testing.assert_allclose(torques[:, 0], each[:, 0], atol=1e-12 * abs(each).max())
    together = each[:, 2] + slopes[0] * each[:, 1] + slopes[1] * each[:, 3]
    np.testing.assert_allclose(torques[:, 1], together, atol=1e-12 * abs(each).max())


@pytest.mark.parametrize("sensors", [Sensors(), Sensors(False, True), Sensors(moving_base=True)])
def test_the_regrouping_holds_at_other_states(sensors):
    tree, _, _ = knee(2)
    mechanism = Mechanism(tree, GRAVITY)
    base = find_base_parameters(mechanism, sensors=sensors)
    assert base.rank <= find_base_parameters(Mechanism(knee(2, free=True)[0], GRAVITY), sensors=sensors).rank
    regressor = joint_torque_regressor if sensors.joint_torques else base_wrench_regressor
    rng = np.random.default_rng(8)
    q, dq, ddq = random_states(rng, tree, 40)
    free = rng.normal(size=(40, 7)), *rng.normal(size=(2, 40, 6))
    moving = BaseMotion.from_free_joint(*free) if sensors.moving_base else None
    Y = regressor(tree, q, dq, ddq, gravity=GRAVITY, base=moving).reshape(-1, 30)
    np.testing.assert_allclose(Y[:, base.dependent], base.reduce(Y) @ base.beta, atol=1e-8 * abs(Y).max())
    assert np.linalg.matrix_rank(base.reduce(Y)) == base.rank


def test_a_follower_needs_a_leader_and_one_axis():
    tree, _, _ = knee(0)
    lost = replace(tree.bodies[3], follows=Follower("ankle", (0.0, 1.0)))
    with pytest.raises(ModelError, match="follows 'ankle', which is no joint with one coordinate; those are hip, knee"):
        Tree((*tree.bodies[:3], lost))
    with pytest.raises(ModelError, match="needs one axis and no joint"):
        replace(tree.bodies[3], joint="patella")
    with pytest.raises(ModelError, match="finite coefficients and a span"):
        Follower("knee", (0.0, np.nan))
