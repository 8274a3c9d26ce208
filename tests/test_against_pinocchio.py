"""Pinocchio's regressors, column by column, on trees with all kinds of joints (extra `peers`)."""

import numpy as np
import pytest
from mechanisms import random_states, random_tree

from ident import se3
from ident.body import BASE
from ident.inertia import PINOCCHIO, parameter_transform
from ident.regressor import base_wrench_regressor, joint_torque_regressor
from ident.tree import BaseMotion

pin = pytest.importorskip("pinocchio", reason="Pinocchio is in the extra 'peers'")

STATES = 3


def pinocchio_model(tree, gravity):
    """The tree on a free-flyer, and for every body its joint's index and the pose of the body in that joint's frame.

    Pinocchio's joints turn about their own origins, so that a joint's frame sits on its axis.
    """
    model = pin.Model()
    model.gravity.linear = gravity
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    joint, in_joint = {BASE: root}, {BASE: np.eye(4)}
    for i, body in enumerate(tree.bodies):
        home = in_joint[body.parent] @ body.home
        if not body.moves:
            joint[i], in_joint[i] = joint[body.parent], home
            continue
        v, w = body.twist[:3], body.twist[3:]
        if body.is_ball:
            center, kind = np.array([v[2, 1], v[0, 2], v[1, 0]]), pin.JointModelSpherical()
        elif w.any():
            center, kind = np.cross(w, v), pin.JointModelRevoluteUnaligned(w)
        else:
            center, kind = np.zeros(3), pin.JointModelPrismaticUnaligned(v)
        placement = home @ se3.pose(np.eye(3), center)
        joint[i] = model.addJoint(joint[body.parent], kind, pin.SE3(placement[:3, :3], placement[:3, 3]), f"joint{i}")
        in_joint[i] = se3.pose(np.eye(3), -center)
    return model, joint, in_joint


def pinocchio_state(tree, model, joint, base, states):
    """Pinocchio's q, v and a: quaternions are `x, y, z, w` there, and its joints stand in another order."""
    q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    q[:7] = pin.SE3ToXYZQUAT(pin.SE3(base.T[:3, :3], base.T[:3, 3]))
    v[:6], a[:6] = base.V, base.dV
    rows = []
    own = tree.body_coordinates(states[0]), tree.body_velocities(states[1]), tree.body_velocities(states[2])
    for i, (x, dx, ddx) in enumerate(zip(*own, strict=True)):
        if tree.bodies[i].moves:
            at = model.joints[joint[i]]
            q[at.idx_q : at.idx_q + at.nq] = np.roll(x, -1) / np.linalg.norm(x) if tree.bodies[i].is_ball else x
            v[at.idx_v : at.idx_v + at.nv], a[at.idx_v : at.idx_v + at.nv] = dx, ddx
            rows += range(at.idx_v, at.idx_v + at.nv)
    return (q, v, a), rows


@pytest.mark.parametrize("seed", range(300))
def test_regressors_are_equal(seed):
    rng = np.random.default_rng(seed)
    kinds = ("revolute", "prismatic", "ball", "free", "welded")
    tree = random_tree(rng, int(rng.integers(2, 31)), kinds=kinds, massless=0.1)
    gravity = 3 * rng.normal(size=3)
    model, joint, in_joint = pinocchio_model(tree, gravity)
    data = model.createData()
    states = random_states(rng, tree, STATES)
    base_states = rng.uniform(-2, 2, size=(STATES, 7)), *rng.uniform(-2, 2, size=(2, STATES, 6))
    base = BaseMotion.from_free_joint(*base_states)
    Y_base = base_wrench_regressor(tree, *states, gravity=gravity, base=base)
    Y_joint = joint_torque_regressor(tree, *states, gravity=gravity, base=base)
    for k in range(STATES):
        sample = BaseMotion(base.T[k], base.V[k], base.dV[k])
        theirs, rows = pinocchio_state(tree, model, joint, sample, [x[k] for x in states])
        Y = pin.computeJointTorqueRegressor(model, data, *theirs)
        for column, i in enumerate(tree.inertial):
            in_order = parameter_transform(in_joint[i])[list(PINOCCHIO)]
            expected = Y[:, 10 * (joint[i] - 1) : 10 * joint[i]] @ in_order
            for found, part in ((Y_base[k], expected[:6]), (Y_joint[k], expected[rows])):
                own = found[:, 10 * column : 10 * column + 10]
                np.testing.assert_allclose(own, part, rtol=0, atol=1e-10 * abs(expected).max())
