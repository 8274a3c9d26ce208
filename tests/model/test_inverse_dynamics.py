"""Wrench and torques of bodies with given parameters, against regressors times these parameters."""

import numpy as np
import pytest
from mechanisms import GRAVITY, random_phi, random_states, random_tree

from ident.mechanism.motion import BaseMotion, Motion
from ident.model.inverse_dynamics import inverse_dynamics
from ident.model.regressor import CHUNK, base_wrench_regressor, joint_torque_regressor


@pytest.mark.parametrize(("moving", "samples"), [(False, 1), (False, CHUNK + 3), (True, 7)])
def test_they_are_those_of_the_regressors(moving, samples):
    rng = np.random.default_rng(samples)
    tree = random_tree(rng)
    states = random_states(rng, tree, samples)
    base = None
    if moving:
        base = BaseMotion(np.broadcast_to(np.eye(4), (samples, 4, 4)), *rng.normal(size=(2, samples, 6)))
    phi = random_phi(rng, len(tree.inertial))
    wrench, torques = inverse_dynamics(tree, Motion(*states, base), phi, GRAVITY)
    given = {"gravity": GRAVITY, "base": base}
    np.testing.assert_allclose(wrench, base_wrench_regressor(tree, *states, **given) @ phi, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(torques, joint_torque_regressor(tree, *states, **given) @ phi, rtol=1e-11, atol=1e-11)
