"""The structural rank and regrouping against the numeric ones, OpenSYMORO's, and known formulas."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from mechanisms import (
    GRAVITY,
    JOINTS,
    double_pendulum,
    random_pose,
    random_states,
    random_tree,
    regrouping_error,
    tilted_axis,
)

from ident.geometry.se3 import coAd, inverse
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors

BASE_WRENCH, TORQUES, BOTH = Sensors(), Sensors(False, True), Sensors(True, True)


def test_coefficients_are_exact():
    base = find_base_parameters(double_pendulum())
    coefficients = {round(abs(c), 9): abs(c) for c in base.beta[base.beta != 0]}
    for exact in (0.425, 0.425**2, 1.0):
        assert abs(coefficients[round(exact, 9)] - exact) < 1e-15


@pytest.mark.parametrize("seed", range(9))
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


def test_ranks_of_axes_that_are_not_parallel():
    tree = double_pendulum(tilted_axis(5, 0), tilted_axis(5, 90))
    assert find_base_parameters(tree).rank == 15
    assert find_base_parameters(tree, sensors=TORQUES).rank == 10


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_rank_of_a_floating_chain_of_revolute_joints(n):
    rng = np.random.default_rng(n)
    tree = random_tree(rng, n, kinds=("revolute",))
    assert find_base_parameters(tree, sensors=Sensors(moving_base=True)).rank == 10 + 7 * (n - 1)


def test_exact_numbers_give_exact_coefficients():
    """Exact with fractions: a pendulum of length 17/40 has its square as a coefficient."""

    def exact(x):
        return np.vectorize(Fraction, otypes=[object])(x)

    tree = double_pendulum()
    bodies = tuple(replace(body, home=exact(body.home), twist=exact(body.twist)) for body in tree.bodies)
    base = find_base_parameters(Tree(bodies), gravity=exact([0, 0, -1]))
    assert base.names == find_base_parameters(tree).names
    assert Fraction(0.425) ** 2 in base.beta
    assert "Ixx2 + (" in base.expressions()[5]
    with pytest.raises(ValueError, match="can be pinned for numbers"):
        find_base_parameters(Tree(bodies), gravity=exact([0, 0, -1]), kept=base.names)


@pytest.mark.parametrize("moving_base", [False, True], ids=["resting", "moving"])
def test_channels_of_the_base_wrench_see_what_their_regressor_shows(moving_base):
    """Ranks and regroupings of some rows of the regressor, in frames at any pose and along frame axes, 24 trees."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        kinds = ("helical", "revolute") if seed % 4 == 0 else JOINTS
        tree = random_tree(rng, int(rng.integers(2, 6)), kinds=kinds, massless=0.1)
        pose = random_pose(rng) if seed % 2 else np.eye(4)
        rows = coAd(inverse(pose))[rng.choice(6, int(rng.integers(1, 6)), replace=False)]
        samples = 40 * len(tree.bodies)
        states = random_states(rng, tree, samples)
        free = rng.normal(size=(samples, 7)), *rng.normal(size=(2, samples, 6))
        motion = BaseMotion.from_free_joint(*free) if moving_base else None
        Y = rows @ base_wrench_regressor(tree, *states, gravity=GRAVITY, base=motion)
        if not Y.any():
            continue
        sensors = Sensors(moving_base=moving_base, channels=rows)
        exact = find_base_parameters(tree, gravity=GRAVITY, sensors=sensors)
        assert find_base_parameters(Y).rank == exact.rank, seed
        assert regrouping_error(exact, Y) <= 1e-9, seed
