"""Pinocchio's regressors, column by column, on trees with all kinds of joints (extra `peers`)."""

import numpy as np
import pytest
from mechanisms import random_states, random_tree

from docs.tools.mechanisms import Pinocchio
from ident.geometry.inertia import PINOCCHIO, parameter_transform
from ident.mechanism.motion import BaseMotion
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor

pin = pytest.importorskip("pinocchio", reason="Pinocchio is in the extra 'peers'")

pytestmark = pytest.mark.extras

STATES = 3


@pytest.mark.parametrize("seed", range(300))
def test_regressors_are_equal(seed):
    rng = np.random.default_rng(seed)
    kinds = ("revolute", "prismatic", "ball", "free", "welded")
    tree = random_tree(rng, int(rng.integers(2, 31)), kinds=kinds, massless=0.1)
    gravity = 3 * rng.normal(size=3)
    peer = Pinocchio(tree, gravity)
    data = peer.model.createData()
    states = random_states(rng, tree, STATES)
    base_states = rng.uniform(-2, 2, size=(STATES, 7)), *rng.uniform(-2, 2, size=(2, STATES, 6))
    base = BaseMotion.from_free_joint(*base_states)
    Y_base = base_wrench_regressor(tree, *states, gravity=gravity, base=base)
    Y_joint = joint_torque_regressor(tree, *states, gravity=gravity, base=base)
    for k, theirs in enumerate(zip(*peer.states(states, base), strict=True)):
        Y = pin.computeJointTorqueRegressor(peer.model, data, *theirs)
        for column, i in enumerate(tree.inertial):
            in_order = parameter_transform(peer.in_joint[i])[list(PINOCCHIO)]
            expected = Y[:, 10 * (peer.joint[i] - 1) : 10 * peer.joint[i]] @ in_order
            for computed, part in ((Y_base[k], expected[:6]), (Y_joint[k], expected[peer.rows])):
                own = computed[:, 10 * column : 10 * column + 10]
                np.testing.assert_allclose(own, part, rtol=0, atol=1e-10 * abs(expected).max())
