"""Regressors against the paper's recursion, differences and each other."""

from dataclasses import replace

import numpy as np
import pytest
from closeness import close
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, random_tree, tilted_axis

from ident import BaseMotion, InputError, Mechanism, Motion
from ident.geometry.se3 import pose
from ident.model import dim, regressor
from ident.model.regressor import CHUNK, base_wrench_regressor, inverse_dynamics, joint_torque_regressor, pulled_back

BOTH = (base_wrench_regressor, joint_torque_regressor)


def moving_base(rng, samples):
    return BaseMotion.from_free_joint(rng.normal(size=(samples, 7)), *rng.normal(size=(2, samples, 6)))


@pytest.mark.parametrize(("seed", "moving"), [(0, False), (1, True), (2, True)])
def test_regressors_are_the_papers_recursion_for_each_sample(seed, moving):
    """Long recordings run a program, short ones are evaluated sample by sample; bases rest or move."""
    rng, number = np.random.default_rng(seed), regressor.FEW
    tree, gravity = random_tree(rng), rng.normal(size=3)
    phi, states = random_phi(rng, len(tree.inertial)), random_states(rng, tree, number)
    base = moving_base(rng, number) if moving else None
    samples = Motion(*states, base)
    wholes = [of(tree, *states, gravity=gravity, base=base) for of in BOTH]
    mechanism = Mechanism(tree, gravity, phi)
    for k, sample in enumerate(samples):
        close(wholes[0][k], dim.base_wrench_regressor(mechanism, sample), 1e-12)
        close(wholes[1][k] @ phi, dim.inverse_dynamics(mechanism, sample)[1], 1e-12)
    one = samples[0:1]
    for of, whole in zip(BOTH, wholes, strict=True):
        close(of(tree, *one.states, gravity=gravity, base=one.base), whole[:1], 1e-13)


def test_what_the_geometry_makes_zero_or_constant_is_not_computed():
    """Two links that turn about X: the base's columns are constant, and forces along X and most inertias vanish."""
    straight, tilted = double_pendulum(), double_pendulum(tilted_axis(5, 10), tilted_axis(7, 40))
    few, many, constant = (
        regressor.regressor_program(Mechanism(tree, GRAVITY), range(columns), moving=False, torques=False)
        for tree, columns in ((straight, 30), (tilted, 30), (straight, 10))
    )
    assert len(few.code) < 150 < 500 < len(many.code) < 700
    assert constant.code == () and len(constant.constants) == 3
    Y = base_wrench_regressor(straight, *random_states(np.random.default_rng(0), straight, 50), gravity=GRAVITY)
    assert abs(Y[:, 0]).max() < 1e-12 < abs(Y[:, 1:]).max(axis=(0, 2)).min()


def test_memory_is_used_again_or_refused_with_what_differs():
    tree, other = double_pendulum(), double_pendulum(tilted_axis(5, 10), tilted_axis(7, 40))
    for samples in (3, 70):
        states = random_states(np.random.default_rng(0), tree, samples)
        expected, memory = (base_wrench_regressor(each, *states, gravity=GRAVITY) for each in (tree, other))
        for out in (memory, np.empty((30, 6, samples)).T):
            computed = base_wrench_regressor(tree, *states, gravity=GRAVITY, out=out)
            assert np.shares_memory(computed, out)
            np.testing.assert_array_equal(computed, expected)
    read_only = memory[:]
    read_only.flags.writeable = False
    for wrong, what in (
        (memory[:2], r"float64 \(70, 6, 30\), got float64 \(2, 6, 30\)"),
        (memory.astype(np.float32), r"got float32 \(70, 6, 30\)"),
        (memory.copy(order="C"), r"strides \(8, 560, 3360\); it has strides \(1440, 240, 8\)"),
        (read_only, "it is read-only"),
    ):
        with pytest.raises(InputError, match="what an earlier call returned.*" + what):
            base_wrench_regressor(tree, *states, gravity=GRAVITY, out=wrong)


@pytest.mark.parametrize(("moving", "samples"), [(False, 1), (False, CHUNK + 3), (True, 7)])
def test_inverse_dynamics_are_those_of_the_regressors(moving, samples):
    rng = np.random.default_rng(samples)
    tree = random_tree(rng, 4)
    states, phi = random_states(rng, tree, samples), random_phi(rng, len(tree.inertial))
    base = moving_base(rng, samples) if moving else None
    longer = rng.uniform(-0.5, 0.5, len(tree.bodies))
    own = inverse_dynamics(tree, Motion(*states, base), phi, GRAVITY, longer)
    pairs = zip(tree.bodies, 1 + longer, strict=True)
    bodies = [replace(body, home=pose(body.home[:3, :3], length * body.home[:3, 3])) for body, length in pairs]
    tree = replace(tree, bodies=tuple(bodies))
    for computed, of in zip(own, BOTH, strict=True):
        close(computed, of(tree, *states, gravity=GRAVITY, base=base) @ phi)


@pytest.mark.parametrize(("seed", "torques"), [(0, False), (1, True), (2, True)])
def test_derivatives_by_a_motion_are_differences_of_the_regressor(seed, torques):
    rng, step = np.random.default_rng(seed), 1e-6
    tree, gravity, of = random_tree(rng), rng.normal(size=3), BOTH[torques]
    states = random_states(rng, tree, 40)
    columns = rng.permutation(10 * len(tree.inertial))[: rng.integers(1, 20)].tolist()
    adjoints = rng.normal(size=of(tree, *states, gravity=gravity, columns=columns).shape)
    derivatives = pulled_back(Mechanism(tree, gravity), Motion(*states), columns, adjoints, torques=torques)
    # One direction for each sample; steps are small against quaternions too.
    direction = [rng.normal(size=x.shape) for x in states]
    near = [[x + s * step * d for x, d in zip(states, direction, strict=True)] for s in (1, -1)]
    up, down = (of(tree, *moved, gravity=gravity, columns=columns) for moved in near)
    along = sum(np.sum(own * d, axis=1) for own, d in zip(derivatives, direction, strict=True))
    close(along, np.sum(adjoints * (up - down), axis=(1, 2)) / (2 * step), 1e-6)
