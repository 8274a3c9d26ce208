"""Joints that follow others, against independent joints with the same motion, and against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import GRAVITY, random_phi, random_pose, random_states, random_twist

from ident.errors import ModelError
from ident.mechanism.body import Body, Follower
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors


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
