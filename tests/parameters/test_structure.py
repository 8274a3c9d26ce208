"""The structural rank and regrouping against the numeric ones and known formulas."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from mechanisms import GRAVITY, JOINTS, double_pendulum, random_pose, random_states, random_tree, regrouping_error

from ident import BaseMotion, Sensors, Tree, base_wrench_regressor, find_base_parameters, joint_torque_regressor
from ident.geometry.se3 import coAd, inverse

BASE_WRENCH, TORQUES, BOTH = Sensors(), Sensors(False, True), Sensors(True, True)


@pytest.mark.parametrize("seed", range(6))
def test_structure_equals_the_regressor_at_random_states(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, int(rng.integers(2, 9)), massless=0.2)
    gravity = 5 * rng.normal(size=3)
    states = random_states(rng, tree, 20 * len(tree.bodies))
    wrench, torques = (of(tree, *states, gravity=gravity) for of in (base_wrench_regressor, joint_torque_regressor))
    for sensors, Y in ((BASE_WRENCH, wrench), (TORQUES, torques), (BOTH, np.concatenate([wrench, torques], axis=1))):
        if not Y.any():
            continue  # Nothing that moves has a mass.
        exact = find_base_parameters(tree, gravity=gravity, sensors=sensors)
        numeric = find_base_parameters(Y, kept=exact.names)
        assert numeric.rank == exact.rank
        np.testing.assert_allclose(exact.beta, numeric.beta, rtol=0, atol=1e-9 * max(1, abs(exact.beta).max()))
        assert exact.gap[0] > 1e-6 > 1e-12 > exact.gap[1]


def test_rank_of_a_floating_chain_of_revolute_joints():
    n = 12
    tree = random_tree(np.random.default_rng(n), n, kinds=("revolute",))
    assert find_base_parameters(tree, sensors=Sensors(moving_base=True)).rank == 10 + 7 * (n - 1)


def test_exact_numbers_give_exact_coefficients():
    """Exact with fractions: a pendulum of length 17/40 has its square as a coefficient."""

    def exact(x):
        return np.vectorize(Fraction, otypes=[object])(x)

    tree = double_pendulum()
    numbers = find_base_parameters(tree)
    for coefficient in (0.425, 0.425**2, 1.0):
        assert abs(abs(numbers.beta) - coefficient).min() < 1e-15
    bodies = tuple(replace(body, home=exact(body.home), twist=exact(body.twist)) for body in tree.bodies)
    base = find_base_parameters(Tree(bodies), gravity=exact([0, 0, -1]))
    assert base.names == numbers.names and Fraction(0.425) ** 2 in base.beta
    assert "Ixx2 + (" in base.expressions()[5]
    with pytest.raises(ValueError, match="can be pinned for numbers"):
        find_base_parameters(Tree(bodies), gravity=exact([0, 0, -1]), kept=base.names)


@pytest.mark.parametrize("moving_base", [False, True], ids=["resting", "moving"])
@pytest.mark.parametrize("seed", range(6))
def test_channels_of_the_base_wrench_see_what_their_regressor_shows(seed, moving_base):
    """Ranks and regroupings of some rows of the regressor, in frames at any pose and along frame axes."""
    rng = np.random.default_rng(seed)
    kinds = ("helical", "revolute") if seed % 4 == 0 else JOINTS
    tree = random_tree(rng, int(rng.integers(2, 6)), kinds=kinds, massless=0.1)
    pose, samples = random_pose(rng) if seed % 2 else np.eye(4), 40 * len(tree.bodies)
    rows = coAd(inverse(pose))[rng.choice(6, int(rng.integers(1, 6)), replace=False)]
    states = random_states(rng, tree, samples)
    free = rng.normal(size=(samples, 7)), *rng.normal(size=(2, samples, 6))
    motion = BaseMotion.from_free_joint(*free) if moving_base else None
    Y = rows @ base_wrench_regressor(tree, *states, gravity=GRAVITY, base=motion)
    exact = find_base_parameters(tree, gravity=GRAVITY, sensors=Sensors(moving_base=moving_base, channels=rows))
    assert find_base_parameters(Y).rank == exact.rank
    assert regrouping_error(exact, Y) <= 1e-9
