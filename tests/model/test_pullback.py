"""A reverse sweep over the equations gives the numerical differences of the regressor."""

import numpy as np
import pytest
from mechanisms import random_states, random_tree

from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.pullback import pulled_back
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor

STEP = 1e-6
SAMPLES = 40


@pytest.mark.parametrize("torques", [False, True])
@pytest.mark.parametrize("seed", range(15))
def test_derivatives_by_a_motion_are_differences_of_the_regressor(seed, torques):
    rng = np.random.default_rng(seed)
    tree, gravity = random_tree(rng), rng.normal(size=3)
    of = joint_torque_regressor if torques else base_wrench_regressor
    states = random_states(rng, tree, SAMPLES)
    columns = rng.permutation(10 * len(tree.inertial))[: rng.integers(1, 20)].tolist()
    adjoints = rng.normal(size=of(tree, *states, gravity=gravity, columns=columns).shape)
    derivatives = pulled_back(Mechanism(tree, gravity), Motion(*states), columns, adjoints, torques=torques)
    # One direction for each sample; steps are small against quaternions too.
    direction = [rng.normal(size=x.shape) for x in states]
    up, down = (
        of(tree, *(x + s * STEP * d for x, d in zip(states, direction, strict=True)), gravity=gravity, columns=columns)
        for s in (1, -1)
    )
    expected = np.sum(adjoints * (up - down), axis=(1, 2)) / (2 * STEP)
    along = sum(np.sum(own * d, axis=1) for own, d in zip(derivatives, direction, strict=True))
    np.testing.assert_allclose(along, expected, rtol=1e-6, atol=1e-6 * max(1, abs(expected).max()))
