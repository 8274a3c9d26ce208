from dataclasses import replace

import numpy as np
import pytest
from mechanisms import (
    GRAVITY,
    double_pendulum,
    random_phi,
    random_pose,
    random_states,
    random_tree,
    random_twist,
    tilted_axis,
)

from ident.errors import InputError
from ident.geometry.se3 import coAd, pose
from ident.mechanism.body import BASE, Body, free_joint
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model import dim, regressor
from ident.model.adjoint import pulled_back
from ident.model.inverse_dynamics import inverse_dynamics
from ident.model.regressor import CHUNK, base_wrench_regressor, joint_torque_regressor


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_closed_form_equals_the_papers_recursion(seed, moving):
    rng = np.random.default_rng(seed)
    tree, base_states = random_tree(rng), (rng.normal(size=(5, 7)), *rng.normal(size=(2, 5, 6)))
    base = BaseMotion.from_free_joint(*base_states) if moving else None
    phi, states, gravity = random_phi(rng, len(tree.inertial)), random_states(rng, tree, 5), rng.normal(size=3)
    mechanism, samples = Mechanism(tree, gravity, phi), list(Motion(*states, base))
    computed = base_wrench_regressor(tree, *states, gravity=gravity, base=base)
    expected = np.array([dim.base_wrench_regressor(mechanism, sample) for sample in samples])
    np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-12 * abs(expected).max())
    computed = joint_torque_regressor(tree, *states, gravity=gravity, base=base) @ phi
    expected = np.array([dim.inverse_dynamics(mechanism, sample)[1] for sample in samples])
    np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-12 * max(1, np.max(np.abs(expected), initial=0)))


@pytest.mark.parametrize("torques", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_recorded_equations_are_those_of_one_sample(seed, torques):
    """Long recordings run a program, short ones are evaluated sample by sample; bases rest or move."""
    rng = np.random.default_rng(seed)
    tree, samples = random_tree(rng), regressor.FEW
    of = joint_torque_regressor if torques else base_wrench_regressor
    states, gravity = random_states(rng, tree, samples), rng.normal(size=3)
    moving = BaseMotion.from_free_joint(rng.normal(size=(samples, 7)), *rng.normal(size=(2, samples, 6)))
    for base in (None, moving):
        whole = of(tree, *states, gravity=gravity, base=base)
        for k in range(samples):
            sample = None if base is None else BaseMotion(base.T[k : k + 1], base.V[k : k + 1], base.dV[k : k + 1])
            one = of(tree, *(x[k : k + 1] for x in states), gravity=gravity, base=sample)
            np.testing.assert_allclose(whole[k], one[0], rtol=0, atol=1e-13 * max(1, np.max(abs(one), initial=0)))


def test_what_the_geometry_makes_zero_or_constant_is_not_computed():
    """Two links that turn about X: the base's columns are constant, and forces along X and most inertias vanish."""
    tree = double_pendulum()
    program = regressor.regressor_program(Mechanism(tree, GRAVITY), range(30), moving=False, torques=False)
    tilted = tree.with_twists([[0, 0, 0, *tilted_axis(5, 10)], [0, 0, 0, *tilted_axis(7, 40)]])
    general = regressor.regressor_program(Mechanism(tilted, GRAVITY), range(30), moving=False, torques=False)
    assert len(program.code) < 150 < 500 < len(general.code) < 700
    base_only = regressor.regressor_program(Mechanism(tree, GRAVITY), range(10), moving=False, torques=False)
    assert base_only.code == () and len(base_only.constants) == 3


@pytest.mark.parametrize("samples", [3, 70])
def test_memory_is_used_again(samples):
    rng = np.random.default_rng(0)
    tree, other = double_pendulum(), double_pendulum(tilted_axis(5, 10), tilted_axis(7, 40))
    states = random_states(rng, tree, samples)
    expected = base_wrench_regressor(tree, *states, gravity=GRAVITY)
    memory = base_wrench_regressor(other, *states, gravity=GRAVITY)
    computed = base_wrench_regressor(tree, *states, gravity=GRAVITY, out=memory)
    assert np.shares_memory(computed, memory)
    np.testing.assert_array_equal(computed, expected)


def test_memory_that_cannot_be_used_again_is_refused_with_what_differs():
    rng = np.random.default_rng(0)
    tree = double_pendulum()
    states = random_states(rng, tree, 70)
    memory = base_wrench_regressor(tree, *states, gravity=GRAVITY)
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
    right = np.empty((30, 6, 70)).T
    np.testing.assert_array_equal(base_wrench_regressor(tree, *states, gravity=GRAVITY, out=right), memory)


def test_parallel_axes_leave_the_force_along_them_empty():
    tree = double_pendulum()
    Y = base_wrench_regressor(tree, *random_states(np.random.default_rng(0), tree, 50), gravity=[0, 0, -9.81])
    assert abs(Y[:, 0]).max() < 1e-12 < abs(Y[:, 1:]).max(axis=(0, 2)).min()


def test_a_moving_base_is_a_free_joint_seen_from_the_body():
    """Cut at a free joint, the rest needs the joint's forces as a wrench in the body's frame."""
    rng = np.random.default_rng(0)
    arm = Body("arm", 3, random_pose(rng), random_twist(rng, "revolute"), "elbow")
    whole = Tree((*free_joint("root", "b", BASE, 0), arm))
    cut = Tree((Body("b", BASE, np.eye(4), np.zeros(6)), replace(arm, parent=0)))
    q, dq, ddq = random_states(rng, whole, 5)
    base = BaseMotion.from_free_joint(q[:, :7], dq[:, :6], ddq[:, :6])
    expected = base_wrench_regressor(whole, q, dq, ddq, gravity=GRAVITY)
    computed = base_wrench_regressor(cut, q[:, 7:], dq[:, 6:], ddq[:, 6:], gravity=GRAVITY, base=base)
    np.testing.assert_allclose(coAd(base.T) @ computed, expected, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize(("moving", "samples"), [(False, 1), (False, CHUNK + 3), (True, 7)])
def test_they_are_those_of_the_regressors(moving, samples):
    rng = np.random.default_rng(samples)
    tree = random_tree(rng)
    states = random_states(rng, tree, samples)
    base = None
    if moving:
        base = BaseMotion(np.broadcast_to(np.eye(4), (samples, 4, 4)), *rng.normal(size=(2, samples, 6)))
    phi = random_phi(rng, len(tree.inertial))
    longer = rng.uniform(-0.5, 0.5, len(tree.bodies))
    wrench, torques = inverse_dynamics(tree, Motion(*states, base), phi, GRAVITY, longer)
    pairs = zip(tree.bodies, 1 + longer, strict=True)
    bodies = [replace(body, home=pose(body.home[:3, :3], length * body.home[:3, 3])) for body, length in pairs]
    tree = replace(tree, bodies=tuple(bodies))
    given = {"gravity": GRAVITY, "base": base}
    np.testing.assert_allclose(wrench, base_wrench_regressor(tree, *states, **given) @ phi, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(torques, joint_torque_regressor(tree, *states, **given) @ phi, rtol=1e-11, atol=1e-11)


STEP = 1e-6
SAMPLES = 40


@pytest.mark.parametrize("torques", [False, True])
@pytest.mark.parametrize("seed", range(5))
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
    near = [[x + s * STEP * d for x, d in zip(states, direction, strict=True)] for s in (1, -1)]
    up, down = (of(tree, *moved, gravity=gravity, columns=columns) for moved in near)
    expected = np.sum(adjoints * (up - down), axis=(1, 2)) / (2 * STEP)
    along = sum(np.sum(own * d, axis=1) for own, d in zip(derivatives, direction, strict=True))
    np.testing.assert_allclose(along, expected, rtol=1e-6, atol=1e-6 * max(1, abs(expected).max()))
