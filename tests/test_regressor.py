import numpy as np
import pytest
from mechanisms import double_pendulum, random_phi, random_states, random_tree

from ident import dim, regressor


def both(tree, states, gravity):
    batched = regressor.base_wrench_regressor(tree, *states, gravity=gravity)
    single = [dim.base_wrench_regressor(tree, *x, gravity=gravity) for x in zip(*states, strict=True)]
    return batched, np.array(single)


@pytest.mark.parametrize("seed", range(40))
def test_closed_form_equals_the_papers_recursion(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    batched, single = both(tree, random_states(rng, tree, 5), rng.normal(size=3))
    np.testing.assert_allclose(batched, single, rtol=0, atol=1e-12 * abs(single).max())


@pytest.mark.parametrize("seed", range(20))
def test_joint_torques_are_those_of_the_recursion(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    phi, states, gravity = random_phi(rng, len(tree.inertial)), random_states(rng, tree, 5), rng.normal(size=3)
    found = regressor.joint_torque_regressor(tree, *states, gravity=gravity) @ phi
    each = [dim.inverse_dynamics(tree, phi, *x, gravity=gravity)[1] for x in zip(*states, strict=True)]
    np.testing.assert_allclose(found, each, rtol=0, atol=1e-12 * max(1, np.max(np.abs(each), initial=0)))


def test_chunks_join_without_a_seam():
    rng = np.random.default_rng(0)
    tree = double_pendulum()
    states = random_states(rng, tree, 2 * regressor.CHUNK + 3)
    whole = regressor.base_wrench_regressor(tree, *states, gravity=[0, 0, -9.81])
    for k in (0, regressor.CHUNK - 1, regressor.CHUNK, 2 * regressor.CHUNK + 2):
        one = regressor.base_wrench_regressor(tree, *(x[k : k + 1] for x in states), gravity=[0, 0, -9.81])
        np.testing.assert_allclose(whole[k], one[0], atol=1e-13)


def test_lapack_takes_the_matrix_without_a_copy():
    rng = np.random.default_rng(0)
    tree = double_pendulum()
    Y = regressor.base_wrench_regressor(tree, *random_states(rng, tree, 7), gravity=[0, 0, -9.81])
    assert Y.shape == (7, 6, 30)
    assert Y.transpose(2, 1, 0).flags.c_contiguous


def test_parallel_axes_leave_the_force_along_them_empty():
    rng = np.random.default_rng(0)
    tree = double_pendulum()
    Y = regressor.base_wrench_regressor(tree, *random_states(rng, tree, 50), gravity=[0, 0, -9.81])
    assert abs(Y[:, 0]).max() < 1e-12 < abs(Y[:, 1:]).max(axis=(0, 2)).min()


def test_states_of_different_shapes_are_refused():
    tree = double_pendulum()
    with pytest.raises(ValueError, match=r"shapes \(N, 2\), .* got \(5, 2\), \(4, 2\) and \(5, 2\)"):
        regressor.base_wrench_regressor(tree, np.zeros((5, 2)), np.zeros((4, 2)), np.zeros((5, 2)), gravity=[0, 0, -1])
